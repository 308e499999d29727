"""A second answer to what the joint does: Equation 3 written out, tick by tick and term by term.

Nothing here is shared with :mod:`planner.model.response`: the window comes from the times of the
model, the speed from the three cases of Equation 2, and the steady cycle from a root finder of
SciPy's. So where both agree, neither has a mistake that the other has not.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from planner.model.joint import JointModel
from planner.trajectory import Array

SETTLED = 1e-13
"""Ends of a cycle that agree to this are one [rad], relative to angles beyond 1 rad: rounding."""


def independent_angles(
    model: JointModel, requests: Array, *, cyclic: bool, start: float | None = None
) -> Array:
    """Angles of the joint under ``requests``, by the book.

    Where requests saturate the joint throughout, more than one cycle is steady, and this is any of
    them; :func:`next_cycle` tells of a given one whether it is.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,).
        cyclic: Whether they repeat for ever.
        start: From rest: angle before the first request [rad]; by default where that one holds it.

    Returns:
        Angles right after each request [rad], shape (n,).
    """
    if not cyclic:
        before = float(requests[0]) + model.offset if start is None else start
        given = requests.tolist()
        every = _equation_3(
            model,
            lambda tick: given[max(tick // model.hold, 0)],
            (len(given) - 1) * model.hold + 1,
            before,
        )
        return np.array(every[:: model.hold])
    return next_cycle(model, requests, _seam(model, requests))


def next_cycle(model: JointModel, requests: Array, last: float) -> Array:
    """Angles of the cycle that follows one whose last sample was ``last`` [rad], shape (n,)."""
    given, count, hold = requests.tolist(), len(requests), model.hold
    # Tick 0 is the one after that sample, which was taken right after the cycle's last request.
    every = _equation_3(
        model, lambda tick: given[(count - 1 + (tick + 1) // hold) % count], count * hold, last
    )
    return np.array(every[hold - 1 :: hold])


def _seam(model: JointModel, requests: Array) -> float:
    """Last angle of the cycle that leads to itself [rad]."""
    from scipy.optimize import brentq

    def end(last: float) -> float:
        return float(next_cycle(model, requests, last)[-1])

    once = end(float(requests[-1]) + model.offset)
    twice = end(once)
    # A joint moves by v_max a tick at most, so it does not pass a request by more than that.
    low = float(np.min(requests)) + model.offset - model.v_max * model.tick
    high = float(np.max(requests)) + model.offset + model.v_max * model.tick
    tolerance = SETTLED * max(1.0, abs(low), abs(high))
    if abs(twice - once) <= tolerance:
        return twice
    return float(brentq(lambda last: end(last) - last, low, high, xtol=tolerance))


def _equation_3(
    model: JointModel, request_at: Callable[[int], float], ticks: int, before: float
) -> list[float]:
    """M(0), ..., M(ticks - 1) of Equation 3, M(-1) being ``before``."""
    top, theta_0 = model.v_max * model.tick, model.theta_0
    window = _window(model.lag / model.tick, model.acceleration_time / model.tick)
    duration = math.fsum(length for _, length in window)
    angle, angles = before, []
    for tick in range(ticks):
        total = 0.0
        for age, length in window:
            error = request_at(tick - age) + model.offset - angle
            if error >= theta_0:
                total += length * top
            elif error <= -theta_0:
                total -= length * top
            else:
                total += length * top * error / theta_0
        angle += total / duration
        angles.append(angle)
    return angles


def _window(lag: float, acceleration: float) -> list[tuple[int, float]]:
    """Ages i of the requests that act, with the length of [i - 1, i] ∩ [l, l + a] [ticks]."""
    window = []
    for age in range(1, math.ceil(lag + acceleration) + 1):
        length = min(age, lag + acceleration) - max(age - 1, lag)
        if length > 0.0:
            window.append((age, length))
    return window or [(math.floor(lag) + 1, 1.0)]
