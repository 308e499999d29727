"""How the joint answers a trajectory of requests: Equation 3 for numbers and arrays, run."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, InvalidTrajectory, NoSteadyCycle
from planner.model.joint import Clip, JointModel, Window, checked_model, clip, saturation
from planner.trajectory import Array, as_trajectory
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
) -> Array:
    """Angles of the joint under ``requests``: the exact model, Equation 3, which judges every plan.

    Cyclic, the answer is the steady cycle, whose ends agree to 1e-12 rad; it is found by the secant
    method on the angle at which a cycle starts. From rest, the requests before the first are taken
    to have been the first.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the requests repeat for ever.
        start: From rest only: angle one tick before the first request [rad]. By default the joint
            rests where the first request holds it, at request + offset.

    Returns:
        Angles [rad], shape (n,), read-only; sample k is taken right after request k.

    Raises:
        InvalidTrajectory: ``requests`` is not a finite array of shape (n,) with n >= 2.
        InvalidInput: ``start`` is given for a cycle, or not finite.
        NoSteadyCycle: The response does not settle.
    """
    model = checked_model(model)
    requests = as_trajectory(requests, name="requests")
    start = checked_start(start, cyclic=cyclic)
    if requests.size * model.hold > MOST_TICKS:
        raise InvalidTrajectory(
            f"requests: got {requests.size}, each held for {model.hold} ticks, expected at most "
            f"{MOST_TICKS} ticks; simulate them part by part"
        )
    targets = np.repeat(requests + model.offset, model.hold)
    padded = _with_history(targets, model.window, cyclic=cyclic)
    if cyclic:
        near = float(targets[0])
        angles = steady_cycle(model, lambda angle: _run(model, padded, angle), targets, near=near)
    else:
        angles = _run(model, padded, float(targets[0]) if start is None else start)
    sampled = angles[:: model.hold].copy()
    sampled.setflags(write=False)
    return sampled


def advance(
    angle: Any, targets: Any, *, weights: Any, gain: Any, v_max: Any, clip: Clip = clip
) -> Any:
    """Angle one tick later: Equation 3, ``M(t) = M(t-1) + sum_j W_j f(R_j - M(t-1))``.

    Args:
        angle: M(t-1) [rad], a float, an array or a CasADi expression.
        targets: The requests of the window plus the model's offset [rad], youngest first; a
            sequence of whatever ``angle`` is.
        weights: Weight of each of them, summing to 1.
        gain: v_max / theta_0 [1/tick].
        v_max: Top speed [rad/tick].
        clip: See :func:`planner.model.joint.saturation`.

    Returns:
        M(t) [rad], like ``angle``.
    """
    moved = angle
    for weight, target in zip(weights, targets, strict=True):
        moved = moved + weight * saturation(target - angle, gain=gain, v_max=v_max, clip=clip)
    return moved


def run_columns(
    starts: Array, targets: Array, *, weights: Array, gain: float, v_max: float
) -> Array:
    """Many runs of Equation 3 side by side, tick by tick; a column each.

    The array form of :func:`advance`: on one run it takes three times as long, on a hundred a
    twentieth of the time.

    Args:
        starts: Angle before the first tick of each run [rad], shape (c,).
        targets: Request plus offset of each tick's window [rad], shape (t, m, c).
        weights: Weight of each of them times the time of a tick, shape (t, m, c).
        gain: v_max / theta_0, for the unit of time of the weights.
        v_max: Top speed in that unit; may be infinite.

    Returns:
        Angles after each tick [rad], shape (t, c).
    """
    angles = np.empty((len(targets), len(starts)))
    angle = starts
    for weight, target, after in zip(weights, targets, angles, strict=True):
        np.add.reduce(weight * saturation(target - angle, gain=gain, v_max=v_max), out=after)
        after += angle
        angle = after
    return angles


def steady_cycle(
    model: JointModel, run: Callable[[float], Array], targets: Array, *, near: float
) -> Array:
    """Angles of the cycle that repeats itself: what ``run`` makes of the angle where it closes.

    The angle at the end of a cycle is a continuous, piecewise linear function of the angle at its
    start, of slope within [-1, 1]: the secant method finds where they agree, between two angles
    that are known to be on either side of it.

    Args:
        model: The joint.
        run: Angles of one cycle, given the angle before it [rad].
        targets: All requests plus offset [rad], of any shape.
        near: Angle near which the ends of the cycle are sought [rad].

    Returns:
        Angles of the cycle [rad], as ``run`` returns them.

    Raises:
        NoSteadyCycle: The ends still differ after :data:`MOST_CYCLES`.
    """
    # A joint with v_max > theta_0 a tick overshoots a request by as much as their difference.
    beyond = max(model.v_max_per_tick - model.theta_0, 0.0)
    low, high = float(np.min(targets)) - beyond, float(np.max(targets)) + beyond
    tolerance = CYCLE_TOLERANCE * max(1.0, abs(low), abs(high))
    start, earlier = min(max(near, low), high), None
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


def _secant(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Where start and end agree, if the end is a straight line between two runs of a cycle."""
    (start, end), (before, ended) = other, one
    slope = (end - ended) / (start - before) if start != before else 1.0
    return start + (end - start) / (1.0 - slope) if slope < 1.0 else math.inf


def checked_start(start: float | None, *, cyclic: bool) -> float | None:
    """The start as a float [rad]; raise InvalidInput where there can be none, or it is no angle."""
    if as_flag("cyclic", cyclic) and start is not None:
        raise InvalidInput("start: a cycle has none; leave it out, or say cyclic=False")
    if start is None:
        return None
    angle = as_number(start)
    if math.isnan(angle):
        raise InvalidInput(f"start: got {shown(start)}, expected a finite angle [rad]")
    return angle


def _with_history(targets: Array, window: Window, *, cyclic: bool) -> list[float]:
    """The targets of every tick, preceded by the ``window.last`` that came before them."""
    if cyclic:
        history = np.resize(targets[::-1], window.last)[::-1]
    else:
        history = np.full(window.last, targets[0])
    return [*history.tolist(), *targets.tolist()]


def _run(model: JointModel, targets: list[float], angle: float) -> Array:
    """Angles at every tick after ``angle``; ``targets`` starts with the history of the window."""
    first, last = model.window.first, model.window.last
    weights = model.window.weights.tolist()
    gain, v_max = model.gain_per_tick, model.v_max_per_tick
    youngest_first = targets[::-1]
    angles = []
    for start in range(len(targets) - last - 1 + first, first - 1, -1):
        window = youngest_first[start : start + last - first + 1]
        angle = advance(angle, window, weights=weights, gain=gain, v_max=v_max, clip=_clip)
        angles.append(angle)
    return np.array(angles)


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value
