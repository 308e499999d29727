"""An independent simulation of the joint: Equation 3 tick by tick and term by term.

Nothing here is shared with :mod:`planner.model.response`: the window comes from the times of the
model, the speed from the cases of Equation 2, with friction and load, and the steady cycle from a
root finder of SciPy's. So a mistake in one of the two shows as a difference.
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
    model: JointModel,
    requests: Array,
    *,
    cyclic: bool,
    start: float | None = None,
    load: Array | None = None,
) -> Array:
    """Angles of the joint under ``requests``, by Equation 3 as it is printed in the paper.

    Where requests saturate the joint throughout, or friction holds it, more than one cycle is
    steady, and this is one of them; :func:`next_cycle` shows whether another one is steady.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,).
        cyclic: Whether they repeat for ever.
        start: From rest: angle before the first request [rad]; by default where that one holds it.
        load: Torque on the joint in the period before each sample [N m], shape (n,).

    Returns:
        Angles right after each request [rad], shape (n,).
    """
    torques = [0.0] * len(requests) if load is None else load.tolist()
    if not cyclic:
        held = float(requests[0]) + model.offset + model.compliance * torques[0]
        before = held if start is None else start
        given = requests.tolist()
        every = _equation_3(
            model,
            lambda tick: given[max(tick // model.hold, 0)],
            lambda tick: torques[-(-tick // model.hold)],
            (len(given) - 1) * model.hold + 1,
            before,
        )
        return np.array(every[:: model.hold])
    return next_cycle(model, requests, _steady_end(model, requests, load), load)


def next_cycle(model: JointModel, requests: Array, last: float, load: Array | None = None) -> Array:
    """Angles of the cycle that follows one whose last sample was ``last`` [rad], shape (n,)."""
    given, count, hold = requests.tolist(), len(requests), model.hold
    torques = [0.0] * count if load is None else load.tolist()
    # Tick 0 is the one after that sample, which was taken right after the cycle's last request.
    every = _equation_3(
        model,
        lambda tick: given[(count - 1 + (tick + 1) // hold) % count],
        lambda tick: torques[tick // hold],
        count * hold,
        last,
    )
    return np.array(every[hold - 1 :: hold])


def _steady_end(model: JointModel, requests: Array, load: Array | None) -> float:
    """Last angle of the steady cycle [rad]."""
    from scipy.optimize import brentq

    def end(last: float) -> float:
        return float(next_cycle(model, requests, last, load)[-1])

    once = end(float(requests[-1]) + model.offset)
    twice = end(once)
    # A joint moves by 2 v_max a tick at most, so it does not pass a request by more than that.
    sag = model.offset + model.compliance * (np.zeros(1) if load is None else load)
    low = float(np.min(requests) + np.min(sag)) - 2.0 * model.v_max * model.tick
    high = float(np.max(requests) + np.max(sag)) + 2.0 * model.v_max * model.tick
    tolerance = SETTLED * max(1.0, abs(low), abs(high))
    if abs(twice - once) <= tolerance:
        return twice
    return float(brentq(lambda last: end(last) - last, low, high, xtol=tolerance))


def _equation_3(
    model: JointModel,
    request_at: Callable[[int], float],
    torque_at: Callable[[int], float],
    ticks: int,
    before: float,
) -> list[float]:
    """M(0), ..., M(ticks - 1) of Equation 3, M(-1) being ``before``."""
    window = _window(model.lag / model.tick, model.acceleration_time / model.tick)
    duration = math.fsum(length for _, length in window)
    angle, angles = before, []
    for tick in range(ticks):
        torque, total = torque_at(tick), 0.0
        sag = model.offset + model.compliance * torque
        for age, length in window:
            total += length * _equation_2(model, request_at(tick - age) + sag - angle, torque)
        angle += total / duration
        angles.append(angle)
    return angles


def _equation_2(model: JointModel, error: float, torque: float) -> float:
    """Speed that an error calls for [rad/tick], case by case."""
    if abs(error) <= model.dead_band:
        return 0.0
    beyond = error - model.dead_band if error > 0.0 else error + model.dead_band
    faster = model.v_offset + model.speed_per_torque * torque
    speed = beyond * model.v_max / model.theta_0
    if speed >= model.v_max + faster:
        speed = model.v_max + faster
    elif speed <= faster - model.v_max:
        speed = faster - model.v_max
    return speed * model.tick


def _window(lag: float, acceleration: float) -> list[tuple[int, float]]:
    """Ages i of the requests that act, with the length of [i - 1, i] ∩ [l, l + a] [ticks]."""
    window = []
    for age in range(1, math.ceil(lag + acceleration) + 1):
        length = min(age, lag + acceleration) - max(age - 1, lag)
        if length > 0.0:
            window.append((age, length))
    return window or [(math.floor(lag) + 1, 1.0)]
