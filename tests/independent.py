"""Equations of the paper and of the model's window, written out once more, slowly and literally."""

from __future__ import annotations

import math

import numpy as np


def equation_2(x, *, v_max, theta_0):
    """F of Equation 2, case by case; v_max in rad/tick."""
    if x >= theta_0:
        return v_max
    if x <= -theta_0:
        return -v_max
    return x * v_max / theta_0


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


def windowed(model, request_at, ticks, before):
    """M(0), ..., M(ticks-1) with w_i the length of [i-1, i] ∩ [l, l+a]; ``request_at(tick)``."""
    lag, acceleration = model.lag / model.tick, model.acceleration_time / model.tick
    window = []
    for i in range(1, math.ceil(lag + acceleration) + 2):
        length = min(i, lag + acceleration) - max(i - 1, lag)
        if length > 0.0:
            window.append((i, length))
    angles = []
    for t in range(ticks):
        total = 0.0
        for i, length in window:
            error = request_at(t - i) + model.offset - before
            total += length * equation_2(
                error, v_max=model.v_max * model.tick, theta_0=model.theta_0
            )
        before = before + total / acceleration
        angles.append(before)
    return np.array(angles)


def from_rest(model, requests, *, start=None):
    """Angles at the requests, one entry each, the first request having been there for ever."""
    before = requests[0] + model.offset if start is None else start

    def request_at(tick):
        return requests[max(tick // model.hold, 0)]

    return windowed(model, request_at, len(requests) * model.hold, before)[:: model.hold]


def next_cycle(model, requests, last_angle):
    """Angles at the requests of the cycle that follows the one that ends in ``last_angle``."""
    hold, n = model.hold, len(requests)

    def request_at(tick):  # tick 0 is the one after the last sample of the cycle before
        return requests[(n - 1 + (tick + 1) // hold) % n]

    return windowed(model, request_at, n * hold, last_angle)[hold - 1 :: hold]
