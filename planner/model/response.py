"""How the joint answers a trajectory of requests: Equation 3, run."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, InvalidTrajectory, NoSteadyCycle
from planner.given import as_flag, as_number, shown
from planner.model.joint import JointModel, Window, advance, checked_model
from planner.trajectory import Array, as_trajectory

CLOSED = 1e-12
"""A cycle is closed when its ends agree to this [rad], relative to angles beyond 1 rad."""

PATIENCE = 50
"""Cycles after which Newton's method and waiting give way, every other time, to bisection."""

MOST_CYCLES = 500
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
    """Angles of the joint under ``requests``: the exact model, which has the last word on a plan.

    Cyclic, the answer is the steady cycle: the requests are repeated until the ends of a cycle
    agree to 1e-12 rad, with Newton's method on the angle at the seam in place of mere waiting. From
    rest, the requests before the first are taken to have been the first.

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
    pulls = np.repeat(requests + model.offset, model.hold)
    if cyclic:
        angles = _steady_cycle(model, pulls)
    else:
        before = float(pulls[0]) if start is None else start
        angles = _run(model, _with_history(pulls, model.window, cyclic=False), before)
    sampled = np.array(angles[:: model.hold])
    sampled.setflags(write=False)
    return sampled


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


def _with_history(pulls: Array, window: Window, *, cyclic: bool) -> list[float]:
    """The pulls of every tick, preceded by the ``window.last`` that came before them."""
    if cyclic:
        history = np.resize(pulls[::-1], window.last)[::-1]
    else:
        history = np.full(window.last, pulls[0])
    return [*history.tolist(), *pulls.tolist()]


def _run(model: JointModel, pulls: list[float], angle: float) -> list[float]:
    """Angles at every tick after ``angle``; ``pulls`` starts with the history of the window."""
    first, last = model.window.first, model.window.last
    weights = model.window.weights.tolist()
    youngest_first = pulls[::-1]
    angles = []
    for start in range(len(pulls) - last - 1 + first, first - 1, -1):
        window = youngest_first[start : start + last - first + 1]
        angle = advance(
            angle, window, weights=weights, v_max=model.v_max_per_tick, theta_0=model.theta_0
        )
        angles.append(angle)
    return angles


def _steady_cycle(model: JointModel, pulls: Array) -> list[float]:
    """Angles at every tick of the cycle that repeats itself.

    The angle at the end of a cycle is a continuous, piecewise linear function of the angle at its
    start, of slope within [-1, 1]: Newton's method finds where they agree, between two angles that
    are known to be on either side of it.
    """
    padded = _with_history(pulls, model.window, cyclic=True)
    # A joint with v_max > theta_0 a tick overshoots a request by as much as their difference.
    beyond = max(model.v_max_per_tick - model.theta_0, 0.0)
    low, high = float(np.min(pulls)) - beyond, float(np.max(pulls)) + beyond
    tolerance = CLOSED * max(1.0, abs(low), abs(high))
    seam = float(pulls[0])
    for cycle in range(MOST_CYCLES):
        angles = _run(model, padded, seam)
        end = angles[-1]
        mismatch = abs(end - seam)
        if mismatch <= tolerance:
            return angles
        low, high = (seam, high) if end > seam else (low, seam)
        contraction = _contraction(model, padded, [seam, *angles[:-1]])
        newton = seam + (end - seam) / (1.0 - contraction) if contraction < 1.0 else np.inf
        if cycle > PATIENCE and cycle % 2:
            seam = (low + high) / 2.0
        else:  # waiting is right wherever Newton's method has no slope to go by
            seam = newton if low < newton < high else end
    raise NoSteadyCycle(mismatch, MOST_CYCLES)


def _contraction(model: JointModel, pulls: list[float], before: list[float]) -> float:
    """Derivative of the angle at the end of a cycle with respect to the angle at its start."""
    weights = model.window.weights
    windows = np.lib.stride_tricks.sliding_window_view(np.array(pulls), len(weights))
    windows = windows[: len(before)]  # (ticks, m), oldest first
    errors = windows - np.array(before)[:, np.newaxis]
    unsaturated = (np.abs(errors) < model.theta_0) @ weights[::-1]
    return float(np.prod(1.0 - model.v_max_per_tick / model.theta_0 * unsaturated))
