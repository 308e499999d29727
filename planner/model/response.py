"""How the joint answers a trajectory of requests: Equation 3, run from rest and on a cycle."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, InvalidTrajectory, NoSteadyCycle
from planner.model.joint import (
    JointModel,
    RequestAges,
    checked_model,
    request_ages,
    weights_by_tick,
)
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

DIFFERENCE = 1e-7
"""Step of the difference quotients of a cycle's end by its start [rad, rad/tick]."""

CLOSER = 0.01
"""How much closer, beside the speeds, bisection brings the angles at a cycle's ends."""

SINGULAR = 1e-6
"""Share of its largest singular value below which one of the matrix of these counts as 0."""

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
    method on the angle at which a cycle starts, with inertia by Newton's on angle and speed. With a
    dead band there may be many: the answer is one near where the first request holds the joint,
    without inertia the nearest, into which the motion from there settles (``docs/math.md``,
    section 1). From rest, the requests before the first are taken to
    have been the first.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the requests repeat for ever.
        start: From rest only: angle one tick before the first request [rad], at rest. By
            default the joint rests where the first request holds it, at request + offset, in the
            middle of the dead band.
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
    sampled = motion_under(model, requests, cyclic=cyclic, start=start, torques=torques).angles
    sampled.setflags(write=False)
    return sampled


class Motion(NamedTuple):
    """What a joint does at the samples."""

    angles: Array  # [rad], (n,)
    speeds: Array  # in the tick before each sample [rad/tick], (n,)


def motion_under(
    model: JointModel,
    requests: Array,
    *,
    cyclic: bool,
    start: float | None = None,
    torques: Array | None = None,
) -> Motion:
    """:func:`simulate` of arguments that have been checked; the answer may be written to.

    Raises:
        NoSteadyCycle: The response does not settle.
    """
    from planner.model import kernel

    count, weights = len(requests), weights_by_tick(model)
    load = np.zeros(count) if torques is None else torques
    sags, faster = model.sag(load), model.faster_per_tick(load)
    history = requests_acting(requests, request_ages(model), cyclic=cyclic)
    motion = Motion(np.empty(count), np.empty(count))
    rest = float(requests[0] + sags[0])

    def run(angle: float, speed: float = 0.0, skipped: int = 0) -> tuple[float, float]:
        return kernel.run(model.law, weights, history, sags, faster, angle, speed, skipped, *motion)

    if not cyclic:
        run(rest if start is None else start, skipped=model.hold - 1)
    elif model.has_inertia:
        _steady_motion(run, rest, _ends(model, requests, load))
    else:
        ends = _ends(model, requests, load)
        steady_cycle(lambda angle: run(angle)[0], ends, near=rest, nearest=model.dead_band > 0.0)
    return motion


def _ends(model: JointModel, requests: Array, load: Array) -> tuple[float, float]:
    """Angles between which some steady cycle begins [rad]; with inertia, one of any speed."""
    law, top = model.law, float(np.max(np.abs(model.speed_limits(load)))) * model.tick
    # The joint overshoots a request by at most the difference of v_max and theta_0, and coasts.
    beyond = max(model.v_max_per_tick - model.theta_0, 0.0) * top / model.v_max_per_tick
    if model.has_inertia:
        beyond += 2.0 * top / law.share + top**2 / law.acceleration
    low, high = (
        float(end(requests) + model.offset + model.compliance * end(load))
        for end in (np.min, np.max)
    )
    return low - beyond, high + beyond


def requests_acting(requests: Array, ages: RequestAges, *, cyclic: bool) -> Array:
    """Every request that acts in a run, the oldest first [rad], shape (n + width - 1,).

    Before sample k act the entries k to k + width - 1. From rest the requests before the first one
    equal it.
    """
    numbers = np.arange(-ages.oldest, len(requests) - ages.youngest)
    return requests.take(numbers if cyclic else np.maximum(numbers, 0), mode="wrap")


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


def steady_cycle(
    run: Callable[[float], float], ends: tuple[float, float], *, near: float, nearest: bool
) -> None:
    """Run the cycle that repeats itself: the fixed point of ``run``, which is run last.

    The angle at the end of a cycle of a joint without inertia is a continuous, piecewise linear
    function of the angle at its start, of slope within [-1, 1]: the secant method finds where they
    agree, between two angles that are known to be on either side of it. With a dead band they may
    agree in a whole range of angles.

    Args:
        run: Last angle of a cycle, given the angle before it [rad].
        ends: Angles between which they agree [rad].
        near: Angle near which the ends of the cycle are sought [rad].
        nearest: Whether the answer is to be the cycle that is nearest to it.

    Raises:
        NoSteadyCycle: The ends still differ after :data:`MOST_CYCLES`.
    """
    low, high = ends
    tolerance = CYCLE_TOLERANCE * max(1.0, abs(low), abs(high))
    start, earlier = min(max(near, low), high), None
    if nearest:
        _nearest_cycle(run, start, (low, high), tolerance)
        return
    for cycle in range(MOST_CYCLES):
        end = run(start)
        mismatch = abs(end - start)
        if mismatch <= tolerance:
            return
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
    run: Callable[[float], float], start: float, ends: tuple[float, float], tolerance: float
) -> None:
    """Run the steady cycle that is nearest to ``start``: fixed-point iteration, bisected.

    How much further a cycle ends than it starts does not increase with the angle where it starts.
    So the steady cycles start in one range, on the side of ``start`` to which a cycle from there
    moves. Where v_max <= theta_0 a tick the iteration cannot pass the near end of that range.
    """
    end = run(start)
    if abs(end - start) <= tolerance:
        return
    sign, far = (1.0, ends[1]) if end > start else (-1.0, ends[0])
    for cycle in range(1, MOST_CYCLES):
        bisecting = cycle > FIXED_POINT_CYCLES and cycle % 2 == 1
        bisecting |= sign * (far - end) <= 0.0
        trial = (start + far) / 2.0 if bisecting else end
        after = run(trial)
        ahead = sign * (after - trial)
        if ahead > tolerance:
            start, end = trial, after
        elif abs(ahead) <= tolerance and not bisecting:
            return
        else:
            far = trial
        if abs(far - start) <= tolerance:
            return
    raise NoSteadyCycle(abs(end - start), MOST_CYCLES)


def _steady_motion(
    run: Callable[[float, float], tuple[float, float]], rest: float, ends: tuple[float, float]
) -> None:
    """Run the cycle of a joint with inertia that repeats itself, from rest near an angle.

    Newton's method on angle and speed, between two corners of the law exact. Where a step of it
    does not halve how far the ends of a cycle are apart, bisection finds the angle at which a cycle
    of a given speed closes, and that speed is the mean of those tried and where they led (Mann's
    iteration). With a dead band the cycles that repeat themselves are not isolated: the step is the
    shortest one.

    Args:
        run: Last angle [rad] and speed [rad/tick] of a cycle, given those before it.
        ends: Angles between which a cycle of any speed that the joint reaches closes [rad].
        rest: Angle near which the ends of the cycle are sought [rad].

    Raises:
        NoSteadyCycle: The ends still differ after :data:`MOST_CYCLES` steps.
    """
    largest = max(1.0, *np.abs(ends))
    start = np.array([rest, 0.0])
    end = np.array(run(rest, 0.0))
    bisected = 0
    for _ in range(MOST_CYCLES):
        apart = end - start
        mismatch = float(np.max(np.abs(apart)))
        if mismatch <= CYCLE_TOLERANCE * largest:
            run(*start.tolist())
            return
        step = DIFFERENCE * largest
        columns = [np.array(run(*(start + way).tolist())) - end for way in step * np.eye(2)]
        closing = np.eye(2) - np.column_stack(columns) / step
        trial = start + np.linalg.lstsq(closing, apart, rcond=SINGULAR)[0]
        reached = np.array(run(*trial.tolist()))
        if not np.max(np.abs(reached - trial)) < mismatch / 2.0:
            bisected += 1
            speed = float(start[1] + 2.0 / (1.0 + bisected) * apart[1])
            close = max(CYCLE_TOLERANCE * largest, CLOSER * abs(float(apart[1])))
            trial = np.array([_closing_angle(run, speed, float(start[0]), ends, close), speed])
            reached = np.array(run(*trial.tolist()))
        start, end = trial, reached
    raise NoSteadyCycle(mismatch, MOST_CYCLES)


def _closing_angle(
    run: Callable[[float, float], tuple[float, float]],
    speed: float,
    near: float,
    ends: tuple[float, float],
    close: float,
) -> float:
    """Angle at which a cycle that starts with a speed closes, to ``close`` [rad], by bisection.

    Of several, the one nearest to ``near`` in the direction in which a cycle from there moves.
    """
    angle, sign = near, 0.0
    for _ in range(MOST_CYCLES):
        ahead = run(angle, speed)[0] - angle
        if not sign:
            sign, far = (1.0, ends[1]) if ahead > 0.0 else (-1.0, ends[0])
        near, far = (angle, far) if sign * ahead > close else (near, angle)
        if abs(far - near) <= close:
            break
        angle = (near + far) / 2.0
    return angle


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
