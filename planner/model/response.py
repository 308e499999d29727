"""How the joint answers a trajectory of requests: Equation 3 for numbers and arrays, run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, InvalidTrajectory, NoSteadyCycle
from planner.model.joint import JointModel, SpeedLaw, Window, checked_model
from planner.model.load import Loads, checked_load
from planner.trajectory import LARGEST, SAME, Array, Mask, as_trajectory, steps
from planner.validation import as_flag, as_number, shown

CYCLE_TOLERANCE = 1e-12
"""A cycle is closed when its ends agree to this [rad], relative to angles beyond 1 rad."""

FIXED_POINT_CYCLES = 3
"""First cycles that start where the one before ended, where the secant method has no slope;
afterwards bisection takes its place."""

SECANT_CYCLES = 10
"""Cycles of the secant method alone; afterwards every other cycle is a bisection."""

MOST_CYCLES = 200
"""Cycles after which a response that still drifts is given up; bisection ends well before."""

MOST_TICKS = 20_000_000
"""Longest simulation [ticks]: more than two days at 100 Hz."""


def simulate(
    model: JointModel,
    requests: npt.ArrayLike,
    *,
    cyclic: bool = True,
    start: float | None = None,
    load: npt.ArrayLike | None = None,
) -> Array:
    """Angles of the joint under ``requests``: the exact model, Equation 3, which judges every plan.

    Cyclic, the answer is the steady cycle, whose ends agree to 1e-12 rad; it is found by the secant
    method on the angle at which a cycle starts. With a dead band there may be many: the answer is
    the one nearest to where the first request holds the joint, into which the motion from there
    settles (``docs/math.md``, section 1). From rest, the requests before the first are taken to
    have been the first.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the requests repeat for ever.
        start: From rest only: angle one tick before the first request [rad]. By default the joint
            rests where the first request holds it, at request + offset, in the middle of the dead
            band.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape
            (n,); entry k acts in the request period that ends in sample k.

    Returns:
        Angles [rad], shape (n,), read-only; sample k is taken right after request k.

    Raises:
        InvalidTrajectory: ``requests`` is not a finite array of shape (n,) with n >= 2.
        InvalidInput: ``start`` is given for a cycle, or not finite; ``load`` is of another shape,
            not finite, or so large that the joint could not move against it.
        NoSteadyCycle: The response does not settle.

    Example:
        >>> import numpy as np
        >>> joint = JointModel.ers210a()
        >>> angles = simulate(joint, np.radians([0.0] + 20 * [30.0]), cyclic=False)
        >>> [round(float(each), 1) for each in np.degrees(angles[[1, 4, 8, 20]])]
        [0.0, 0.0, 2.2, 28.1]
    """
    model = checked_model(model)
    requests = as_trajectory(requests, name="requests")
    start = checked_start(start, cyclic=cyclic)
    if requests.size * model.hold > MOST_TICKS:
        raise InvalidTrajectory(
            f"requests: got {requests.size}, each held for {model.hold} ticks, expected at most "
            f"{MOST_TICKS} ticks; simulate them part by part"
        )
    torques = checked_load(load, model, len(requests))
    targets = np.repeat(requests + model.offset, model.hold)
    padded = _with_history(targets, model.window, cyclic=cyclic)
    rest = float(targets[0] if torques is None else targets[0] + model.compliance * torques[0])
    if cyclic:
        angles = steady_cycle(
            model,
            lambda angle: _run(model, padded, angle, torques),
            targets,
            near=rest,
            load=torques,
        )
    else:
        angles = _run(model, padded, rest if start is None else start, torques)
    sampled = angles[:: model.hold].copy()
    sampled.setflags(write=False)
    return sampled


def simulate_joints(
    models: Sequence[JointModel],
    requests: Array,
    *,
    cyclic: bool,
    starts: Sequence[float | None] | Array | None = None,
    loads: Array | Loads | None = None,
) -> Array:
    """Angles of several joints under their requests, each by :func:`simulate`.

    Args:
        models: The joints.
        requests: Requests [rad], shape (n, joints).
        cyclic: Whether they repeat for ever.
        starts: From rest: angle of each joint one tick before the first request [rad], or None.
        loads: Torques on the joints [N m], shape (n, joints), or for each joint shape (n,) or None.

    Returns:
        Angles [rad], shape (n, joints).
    """
    none = [None] * len(models)
    each_load = loads.T if isinstance(loads, np.ndarray) else loads or none
    each_start = none if starts is None else starts
    columns = zip(models, requests.T, each_start, each_load, strict=True)
    return np.column_stack(
        [
            simulate(model, column, cyclic=cyclic, start=start, load=load)
            for model, column, start, load in columns
        ]
    )


def advance(angle: Any, targets: Any, *, weights: Any, speed: SpeedLaw) -> Any:
    """Angle one tick later: Equation 3, ``M(t) = M(t-1) + sum_j W_j f(R_j - M(t-1))``.

    Args:
        angle: M(t-1) [rad], a float, an array or a CasADi expression.
        targets: The requests of the window plus the model's sag [rad], youngest first; a
            sequence of whatever ``angle`` is.
        weights: Weight of each of them, summing to 1.
        speed: f [rad/tick]: :meth:`planner.JointModel.law_per_tick`.

    Returns:
        M(t) [rad], like ``angle``.
    """
    moved = angle
    for weight, target in zip(weights, targets, strict=True):
        moved = moved + weight * speed(target - angle)
    return moved


def run_columns(
    starts: Array, targets: Array, *, weights: Array, speed: SpeedLaw | Iterable[SpeedLaw]
) -> Array:
    """Many runs of Equation 3 side by side, tick by tick; a column each.

    The array form of :func:`advance`: on one run it takes three times as long, on a hundred a
    twentieth of the time.

    Args:
        starts: Angle before the first tick of each run [rad], shape (c,).
        targets: Request plus sag of each tick's window [rad], shape (t, m, c).
        weights: Weight of each of them times the time of a tick, shape (t, m, c).
        speed: f, for the unit of time of the weights: :func:`planner.model.joint.speed_law`; or
            one for each tick.

    Returns:
        Angles after each tick [rad], shape (t, c).
    """
    angles = np.empty((len(targets), len(starts)))
    angle = starts
    laws = repeat(speed, len(targets)) if callable(speed) else speed
    for weight, target, law, after in zip(weights, targets, laws, angles, strict=True):
        np.add.reduce(weight * law(target - angle), out=after)
        after += angle
        angle = after
    return angles


def steady_cycle(
    model: JointModel,
    run: Callable[[float], Array],
    targets: Array,
    *,
    near: float,
    load: Array | None = None,
) -> Array:
    """Angles of the cycle that repeats itself: what ``run`` makes of the angle where it closes.

    The angle at the end of a cycle is a continuous, piecewise linear function of the angle at its
    start, of slope within [-1, 1]: the secant method finds where they agree, between two angles
    that are known to be on either side of it. With a dead band they may agree in a whole range of
    angles; then the answer is the one in it that is nearest to ``near``.

    Args:
        model: The joint.
        run: Angles of one cycle, given the angle before it [rad].
        targets: All requests plus offset [rad], of any shape.
        near: Angle near which the ends of the cycle are sought [rad].
        load: The torques under which ``run`` runs the joint [N m], if there are any.

    Returns:
        Angles of the cycle [rad], as ``run`` returns them.

    Raises:
        NoSteadyCycle: The ends still differ after :data:`MOST_CYCLES`.
    """
    torques = np.zeros(1) if load is None else load
    beyond = max(model.v_max_per_tick - model.theta_0, 0.0)
    if beyond:  # the joint overshoots a request by as much as their difference
        beyond *= float(np.max(np.abs(model.speed_limits(torques)))) / model.v_max
    low = float(targets.min()) + model.compliance * float(torques.min()) - beyond
    high = float(targets.max()) + model.compliance * float(torques.max()) + beyond
    tolerance = CYCLE_TOLERANCE * max(1.0, abs(low), abs(high))
    start, earlier = min(max(near, low), high), None
    if model.dead_band:
        return _nearest_cycle(run, start, (low, high), tolerance)
    for cycle in range(MOST_CYCLES):
        angles = run(start)
        end = float(angles[-1])
        mismatch = abs(end - start)
        if mismatch <= tolerance:
            return angles
        low, high = (start, high) if end > start else (low, start)
        middle = (low + high) / 2.0
        closing = math.inf if earlier is None else _secant(earlier, (start, end))
        earlier = start, end
        if cycle > SECANT_CYCLES and cycle % 2:
            start = middle
        elif low < closing < high:
            start = closing
        else:
            start = end if cycle < FIXED_POINT_CYCLES else middle
    raise NoSteadyCycle(mismatch, MOST_CYCLES)


def _nearest_cycle(
    run: Callable[[float], Array], start: float, ends: tuple[float, float], tolerance: float
) -> Array:
    """Angles of the steady cycle that is nearest to ``start``: fixed-point iteration, bisected.

    How much further a cycle ends than it starts does not increase with the angle where it starts.
    So the steady cycles start in one range, on the side of ``start`` to which a cycle from there
    moves. Where v_max <= theta_0 a tick the iteration cannot pass the near end of that range.
    """
    angles = run(start)
    end = float(angles[-1])
    if abs(end - start) <= tolerance:
        return angles
    sign, far = (1.0, ends[1]) if end > start else (-1.0, ends[0])
    for cycle in range(1, MOST_CYCLES):
        bisecting = cycle > FIXED_POINT_CYCLES and cycle % 2 == 1
        bisecting |= sign * (far - end) <= 0.0
        trial = (start + far) / 2.0 if bisecting else end
        angles = run(trial)
        ahead = sign * (float(angles[-1]) - trial)
        if ahead > tolerance:
            start, end = trial, float(angles[-1])
        elif abs(ahead) <= tolerance and not bisecting:
            return angles
        else:
            far = trial
        if abs(far - start) <= tolerance:
            return angles
    raise NoSteadyCycle(abs(end - start), MOST_CYCLES)


def _secant(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Where start and end agree, if the end is a straight line between two runs of a cycle."""
    (start, end), (before, ended) = other, one
    slope = (end - ended) / (start - before) if start != before else 1.0
    return start + (end - start) / (1.0 - slope) if slope < 1.0 else math.inf


class PathSpeeds(NamedTuple):
    """How fast a path is, and how fast the joint can be in the same direction.

    Attributes:
        speeds: Speed from each sample to the next [rad/s], shape (m,), with the sign of the motion.
        limits: The joint's top speed in that direction, under its load [rad/s], shape (m,).
    """

    speeds: Array
    limits: Array

    @property
    def shares(self) -> Array:
        """The speeds over the top speeds [-], shape (m,), 0 or more."""
        return np.asarray(self.speeds / self.limits)

    @property
    def too_fast(self) -> Mask:
        """Where the path is faster than the joint can be, shape (m,)."""
        return np.asarray(self.shares > 1.0 + SAME)

    @property
    def highest(self) -> tuple[float, float]:
        """Speed and top speed where their ratio is largest [rad/s], both 0 or more."""
        k = int(np.argmax(self.shares))
        return abs(float(self.speeds[k])), abs(float(self.limits[k]))


def path_speeds(
    model: JointModel, desired: Array, *, cyclic: bool, load: Array | None = None
) -> PathSpeeds:
    """The speeds of a path beside -v^- and v^+ of (1a), by which it is too fast or not.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,).
        cyclic: Whether the path repeats: then the step from the last sample to the first counts.
        load: Torque on the joint in the period that ends in each sample [N m], shape (n,).
    """
    speeds = steps(desired, cyclic=cyclic) / model.period
    torques = 0.0 if load is None else np.roll(load, -1)[: len(speeds)]
    low, high = model.speed_limits(torques)
    return PathSpeeds(speeds, np.where(speeds < 0.0, low, high))


def checked_start(start: float | None, *, cyclic: bool) -> float | None:
    """The start as a float [rad]; raise InvalidInput where there can be none, or it is no angle."""
    if as_flag("cyclic", cyclic) and start is not None:
        raise InvalidInput("start: a cycle has none; leave it out, or say cyclic=False")
    if start is None:
        return None
    angle = as_number(start)
    if not abs(angle) <= LARGEST:
        raise InvalidInput(
            f"start: got {shown(start)}, expected an angle of at most {LARGEST:g} rad either way"
        )
    return angle


def _with_history(targets: Array, window: Window, *, cyclic: bool) -> list[float]:
    """The targets of every tick, preceded by the ``window.last`` that came before them."""
    if cyclic:
        history = np.resize(targets[::-1], window.last)[::-1]
    else:
        history = np.full(window.last, targets[0])
    return [*history.tolist(), *targets.tolist()]


def _run(model: JointModel, targets: list[float], angle: float, load: Array | None = None) -> Array:
    """Angles at every tick after ``angle``; ``targets`` starts with the history of the window."""
    first, last = model.window.first, model.window.last
    weights = model.window.weights.tolist()
    youngest_first = targets[::-1]
    laws: Iterable[tuple[float, SpeedLaw]] = repeat((0.0, model.law_per_tick(clip=_clip)))
    if load is not None:
        # The torque at a sample acts in the ticks since the sample before.
        torques = np.roll(np.repeat(load, model.hold), 1 - model.hold).tolist()
        laws = ((model.compliance * t, model.law_per_tick(t, clip=_clip)) for t in torques)
    angles = []
    windows = range(len(targets) - last - 1 + first, first - 1, -1)
    for start, (sag, speed) in zip(windows, laws, strict=False):
        window = youngest_first[start : start + last - first + 1]
        angle = sag + advance(angle - sag, window, weights=weights, speed=speed)
        angles.append(angle)
    return np.array(angles)


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value
