"""An independent simulation of the joint: Equation 3 tick by tick and term by term.

Nothing here is shared with :mod:`planner.model.response`: the window comes from the times of the
model, the speed from the cases of Equation 2, with friction, load and inertia, and the steady cycle
from a root finder of SciPy's. So a mistake in one of the two shows as a difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from planner.model.joint import JointModel
from planner.trajectory import Array

SETTLING = 20
"""Cycles that a joint with inertia runs before the root finder takes over."""

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
        before = _at_rest(model, held) if start is None else start
        given = requests.tolist()
        every = _equation_3(
            model,
            lambda tick: given[max(tick // model.hold, 0)],
            lambda tick: torques[-(-tick // model.hold)],
            (len(given) - 1) * model.hold + 1,
            _Motion(before, 0.0),
        )
        return np.array([motion.angle for motion in every[:: model.hold]])
    end = _steady_end(model, requests, load)
    return next_cycle(model, requests, end.angle, load, speed=end.speed)


def next_cycle(
    model: JointModel,
    requests: Array,
    last: float,
    load: Array | None = None,
    *,
    speed: float = 0.0,
) -> Array:
    """Angles of the cycle that follows one whose last sample was ``last`` [rad], shape (n,).

    With inertia ``speed`` [rad/tick] is that of its last tick.
    """
    every = _cycle(model, requests, _Motion(last, speed), load)
    return np.array([motion.angle for motion in every])


def last_speed(model: JointModel, angles: Array) -> float:
    """Speed in the last tick of a cycle, from its last angles [rad/tick]: exact for one tick."""
    return float(angles[-1] - angles[-2]) / model.hold


class _Motion(NamedTuple):
    angle: float  # [rad]
    speed: float  # in the tick before [rad/tick]


def _cycle(model: JointModel, requests: Array, last: _Motion, load: Array | None) -> list[_Motion]:
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
    return every[hold - 1 :: hold]


def _steady_end(model: JointModel, requests: Array, load: Array | None) -> _Motion:
    """Last angle and speed of the steady cycle."""
    from scipy.optimize import brentq, root

    def end(last: float) -> float:
        return _cycle(model, requests, _Motion(last, 0.0), load)[-1].angle

    if model.time_constant > 0.0 or math.isfinite(model.max_acceleration):
        now = _Motion(float(requests[-1]) + model.offset, 0.0)
        for _ in range(SETTLING):
            before, now = now, _cycle(model, requests, now, load)[-1]
        if math.dist(before, now) > SETTLED:

            def apart(last: Array) -> Array:
                return np.array(_cycle(model, requests, _Motion(*last.tolist()), load)[-1]) - last

            now = _Motion(*root(apart, np.array(now), tol=SETTLED).x.tolist())
        return now
    once = end(float(requests[-1]) + model.offset)
    twice = end(once)
    # A joint moves by 2 v_max a tick at most, so it does not pass a request by more than that.
    sag = model.offset + model.compliance * (np.zeros(1) if load is None else load)
    beyond = 2.0 * model.v_max * model.tick + abs(model.sag_sin) + abs(model.sag_cos)
    low = float(np.min(requests) + np.min(sag)) - beyond
    high = float(np.max(requests) + np.max(sag)) + beyond
    tolerance = SETTLED * max(1.0, abs(low), abs(high))
    if abs(twice - once) <= tolerance:
        return _Motion(twice, 0.0)
    return _Motion(float(brentq(lambda last: end(last) - last, low, high, xtol=tolerance)), 0.0)


def _equation_3(
    model: JointModel,
    request_at: Callable[[int], float],
    torque_at: Callable[[int], float],
    ticks: int,
    before: _Motion,
) -> list[_Motion]:
    """The motion at ticks 0, ..., ticks - 1, that at tick -1 being ``before``."""
    window = _window(model.lag / model.tick, model.acceleration_time / model.tick)
    duration = math.fsum(length for _, length in window)
    (angle, speed), motions = before, []
    for tick in range(ticks):
        torque, total = torque_at(tick), 0.0
        sag = model.offset + model.compliance * torque + _by_angle(model, angle)
        for age, length in window:
            total += length * _equation_2(model, request_at(tick - age) + sag - angle, torque)
        speed = _motor(model, total / duration, speed)
        angle += speed
        motions.append(_Motion(angle, speed))
    return motions


def _by_angle(model: JointModel, angle: float) -> float:
    """The sag by the angle [rad]."""
    return model.sag_sin * math.sin(angle) + model.sag_cos * math.cos(angle)


def _at_rest(model: JointModel, held: float) -> float:
    """The angle at rest, by fixed-point iteration: each halves the distance at least [rad]."""
    angle = held
    for _ in range(60):
        angle = held + _by_angle(model, angle)
    return angle


def _equation_2(model: JointModel, error: float, torque: float) -> float:
    """Speed that an error calls for [rad/tick], case by case; friction is yet to be overcome."""
    faster = model.v_offset + model.speed_per_torque * torque
    speed = error * model.v_max / model.theta_0
    friction = model.dead_band * model.v_max / model.theta_0
    if speed >= model.v_max + faster + friction:
        speed = model.v_max + faster + friction
    elif speed <= faster - model.v_max - friction:
        speed = faster - model.v_max - friction
    return speed * model.tick


def _motor(model: JointModel, called: float, speed: float) -> float:
    """Speed of a tick [rad/tick]: inertia, an acceleration limit and Coulomb friction."""
    kept = math.exp(-model.tick / model.time_constant) if model.time_constant > 0.0 else 0.0
    after = kept * speed + (1.0 - kept) * called
    most = model.max_acceleration * model.tick**2
    after = speed + most if after - speed > most else after
    after = speed - most if speed - after > most else after
    friction = (1.0 - kept) * model.dead_band * model.v_max * model.tick / model.theta_0
    if abs(after) <= friction:
        return 0.0
    return after - friction if after > 0.0 else after + friction


def _window(lag: float, acceleration: float) -> list[tuple[int, float]]:
    """Ages i of the requests that act, with the length of [i - 1, i] ∩ [l, l + a] [ticks]."""
    window = []
    for age in range(1, math.ceil(lag + acceleration) + 1):
        length = min(age, lag + acceleration) - max(age - 1, lag)
        if length > 0.0:
            window.append((age, length))
    return window or [(math.floor(lag) + 1, 1.0)]
