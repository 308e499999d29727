"""Equations of the paper and of the model's window, written out once more, slowly and literally."""

import math

import numpy as np


def equation_2(x, *, v_max, theta_0, dead_band=0.0, v_offset=0.0):
    """F of Equation 2, case by case; v_max and v_offset in rad/tick."""
    if 0.0 < abs(x) <= dead_band:
        return 0.0
    speed = (x - math.copysign(dead_band, x)) * v_max / theta_0
    if speed >= v_max + v_offset:
        return v_max + v_offset
    if speed <= v_offset - v_max:
        return v_offset - v_max
    return speed


def equation_3(request_at, ticks, before, *, v_max, theta_0, lag, acceleration):
    """M(0), ..., M(ticks-1) of Equation 3 for whole ticks; ``request_at(t)`` is R(t)."""
    angles = []
    for t in range(ticks):
        total = 0.0
        for i in range(lag + 1, lag + acceleration + 1):
            total += equation_2(request_at(t - i) - before, v_max=v_max, theta_0=theta_0)
        before = before + total / acceleration
        angles.append(before)
    return np.array(angles)


def of_whole_ticks(model, requests, start):
    """Equation 3 for a model of whole ticks, the first request having been there for ever."""
    return equation_3(
        lambda t: requests[max(t, 0)],
        len(requests),
        start,
        v_max=model.v_max * model.tick,
        theta_0=model.theta_0,
        lag=round(model.lag / model.tick),
        acceleration=round(model.acceleration_time / model.tick),
    )


def windowed(model, request_at, ticks, before, load_at=lambda _: 0.0, moving=(0.0, 0.0)):
    """M(0), ..., M(ticks-1) with w_i the length of [i-1, i] ∩ [l, l+a]; of functions of ticks.

    Section 1's law, which is Equation 3 without friction and inertia, and the integral of a servo;
    ``moving`` is the speed and the integral before.
    """
    lag, acceleration = model.lag / model.tick, model.acceleration_time / model.tick
    window = []
    for i in range(1, math.ceil(lag + acceleration) + 2):
        length = min(i, lag + acceleration) - max(i - 1, lag)
        if length > 0.0:
            window.append((i, length))
    share = 1.0
    if model.time_constant > 0.0:
        share = 1.0 - math.exp(-model.tick / model.time_constant)
    friction = model.v_max * model.tick / model.theta_0 * model.dead_band
    most = model.max_acceleration * model.tick**2
    loop, position = (
        model.tick * rate for rate in (model.integral_rate, model.position_integral_rate)
    )
    top = model.v_max * model.tick + (friction if loop == 0.0 else 0.0)
    angles, (speed, integral) = [], moving
    for t in range(ticks):
        total = 0.0
        for i, length in window:
            by_pose = model.sag_sin * math.sin(before) + model.sag_cos * math.cos(before)
            sag = model.offset + model.compliance * load_at(t) + by_pose
            error = request_at(t - i) + sag - before
            if position:
                error += integral / (model.v_max * model.tick / model.theta_0)
            faster = model.v_offset + model.speed_per_torque * load_at(t)
            faster += model.v_max / model.theta_0 * by_pose
            total += length * equation_2(
                error,
                v_max=top,
                theta_0=top / (model.v_max * model.tick) * model.theta_0,
                v_offset=faster * model.tick,
            )
        drive = total / acceleration
        sagged = model.v_max * model.tick / model.theta_0 * (sag - model.offset)
        if share == 1.0:
            drive = math.copysign(max(abs(drive) - friction, 0.0), drive)
        change = share * (drive + (0.0 if position else integral) - speed)
        speed += max(min(change, most), -most)
        if share < 1.0:
            speed = math.copysign(max(abs(speed) - share * friction, 0.0), speed)
        if abs(change) <= most:  # else it waits
            integral += loop * (drive - sagged - speed) + position * (drive - sagged - integral)
        before = before + speed
        angles.append(before)
    return np.array(angles)


def from_rest(model, requests, *, start=None, load=None):
    """Angles at the requests, one entry each, the first request having been there for ever."""
    load = np.zeros(len(requests)) if load is None else load
    before, moving = start, (0.0, 0.0)
    if start is None:
        before = requests[0] + model.offset + model.compliance * load[0]
    if model.integral_rate + model.position_integral_rate > 0.0:  # it makes up for the sag
        before = requests[0] + model.offset if start is None else start
        by_pose = model.sag_sin * math.sin(before) + model.sag_cos * math.cos(before)
        sag = model.compliance * load[0] + by_pose
        moving = (0.0, -model.v_max * model.tick / model.theta_0 * sag)

    def request_at(tick):
        return requests[max(tick // model.hold, 0)]

    def load_at(tick):  # the mean of the samples before and after
        after = -(-tick // model.hold) % len(load)
        return (load[max(after - 1, 0)] + load[after]) / 2.0

    ticks = len(requests) * model.hold
    return windowed(model, request_at, ticks, before, load_at, moving)[:: model.hold]


def next_cycle(model, requests, last_angle, *, load=None, moving=(0.0, 0.0)):
    """Angles at the requests of the cycle that follows the one that ends in ``last_angle``."""
    hold, n = model.hold, len(requests)

    def request_at(tick):  # tick 0 is the one after the last sample of the cycle before
        return requests[(n - 1 + (tick + 1) // hold) % n]

    def load_at(tick):
        return 0.0 if load is None else (load[tick // hold - 1] + load[tick // hold]) / 2.0

    every = windowed(model, request_at, n * hold, last_angle, load_at, moving)
    return every[hold - 1 :: hold]
