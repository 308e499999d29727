"""Sensors that are late: what a pure delay explains, and measured angles with it taken off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.learning.disturbance import latency
from planner.planning.plan import Plan
from planner.planning.trials import Learning, SensorDelay
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class DelayOptions:
    """When a disturbance is taken for a delay of the sensor.

    Attributes:
        mentioned: Share of the squared disturbance that a delay must explain to be mentioned [-].
        noise: By so much must the disturbance exceed the noise [-].
        period: A delay below this share of a request period is not worth mentioning.
        of_joint: Largest delay that is believed to be the joint's, as a share of the latency of
            its model: parameters that are 30 % off make it wrong by 46 % at most. A disturbance
            that a longer one explains is taken for a sensor's, and not learnt.
        of_sensor: Share of the squared disturbance that it must explain for that [-].
        reach: Longest delay that is looked for [samples], and share of the cycle.
    """

    mentioned: float = 0.8
    noise: float = 2.0
    period: float = 0.25
    of_joint: float = 0.5
    of_sensor: float = 0.9
    reach: tuple[int, float] = (50, 0.125)


OPTIONS = DelayOptions()


def delays_to_remove(
    joints: Plan,
    cycles: Array,
    modelled: Array,
    *,
    given: float | None,
    before: Learning | None,
) -> list[float]:
    """The delay to take off each joint's measured angles [s].

    Args:
        joints: The plan.
        cycles: Measured angles [rad], (cycles, n, k).
        modelled: Those of the models [rad], (n, k).
        given: The delay that the user gave [s]; None to look for one.
        before: What was learnt before: the delays stay what they were.
    """
    none = [0.0] * len(joints.models)
    if given is not None:
        return [float(given) for _ in none]
    if before is not None:
        return [delay.removed for delay in before.delays]
    return [
        delay.seconds
        if delay.share >= OPTIONS.of_sensor and delay.seconds > OPTIONS.of_joint * latency(model)
        else 0.0
        for delay, model in zip(
            delays_of(joints, cycles, modelled, none), joints.models, strict=True
        )
    ]


def delays_of(
    joints: Plan, cycles: Array, modelled: Array, removed: Sequence[float]
) -> tuple[SensorDelay, ...]:
    """What a delay beside the one that was removed would explain, for each joint."""
    columns = zip(cycles.mean(axis=0).T, modelled.T, removed, strict=True)
    found = []
    for angles, by_model, seconds in columns:
        delay = pure_delay(angles, by_model, joints.period, cyclic=joints.cyclic)
        found.append(SensorDelay(seconds=delay.seconds, share=delay.share, removed=seconds))
    return tuple(found)


def earlier(cycles: Array, removed: Sequence[float], joints: Plan) -> Array:
    """The cycles with the sensors' delays taken off [rad], (cycles, n, k)."""
    if not any(removed):
        return cycles
    columns = [
        later(cycles[:, :, j, np.newaxis], -seconds, joints.period, cyclic=joints.cyclic)[:, :, 0]
        for j, seconds in enumerate(removed)
    ]
    return np.stack(columns, axis=-1)


def remarks_on_delays(joints: Plan, delays: Sequence[SensorDelay], noise: Array) -> list[str]:
    """Remarks on delays that were taken off, and on those that might be a sensor's."""
    said = []
    requests = joints.requests
    speeds = np.sqrt(np.mean(np.diff(requests, axis=0) ** 2, axis=0)) / joints.period
    for j, delay in enumerate(delays):
        of = "" if len(delays) == 1 else f" of joint {j + 1}"
        late = abs(delay.seconds)
        if delay.removed:
            said.append(
                f"the measured angles{of} are taken to be {1e3 * delay.removed:.3g} ms late, by "
                "their sensor or log; that is not learnt. If the joint itself is that late: "
                "sensor_delay=0"
            )
        elif (
            delay.share >= OPTIONS.mentioned
            and late >= OPTIONS.period * joints.period
            and late * speeds[j] > OPTIONS.noise * noise[j]
        ):
            share = f"{100.0 * delay.share:.0f} % of what the model misses{of} is"
            said.append(
                f"{share} that the joint answers {1e3 * late:.3g} ms earlier than the model: that "
                "is learnt"
                if delay.seconds < 0.0
                else f"{share} a delay of {1e3 * late:.3g} ms: it is learnt as the joint's. If the "
                f"sensor or the log is late by it: sensor_delay={late:.3g}"
            )
    return said


def later(rows: Array, seconds: float, period: float, *, cyclic: bool) -> Array:
    """Rows as they were ``seconds`` before, linear between samples, along axis -2 [rad]."""
    if not seconds:
        return rows
    count = rows.shape[-2]
    place = np.arange(count) - seconds / period
    place = place % count if cyclic else np.clip(place, 0.0, count - 1.0)
    below = np.floor(place).astype(int)
    share = (place - below)[:, np.newaxis]
    above = (below + 1) % count if cyclic else np.minimum(below + 1, count - 1)
    below = below % count
    moved: Array = (1.0 - share) * rows.take(below, axis=-2) + share * rows.take(above, axis=-2)
    return moved


class Delay(NamedTuple):
    """The delay that explains most of a disturbance."""

    seconds: float
    share: float  # of the squared disturbance about its mean


def pure_delay(measured: Array, modelled: Array, period: float, *, cyclic: bool) -> Delay:
    """The delay of the measured angles behind the modelled ones that explains most [s].

    Both (n,) [rad]; a constant difference is left out of it.
    """

    def unexplained(seconds: float) -> float:
        delayed = later(modelled[:, np.newaxis], seconds, period, cyclic=cyclic)[:, 0]
        return float(np.var(measured - delayed))

    whole = unexplained(0.0)
    if whole <= np.finfo(np.float64).tiny or not np.ptp(modelled):
        return Delay(0.0, 0.0)
    most, share = OPTIONS.reach
    reach = max(min(int(share * len(modelled)), most), 1)
    grid = period * np.arange(-reach, reach + 1)
    found = [unexplained(seconds) for seconds in grid]
    middle = int(np.argmin(found))
    # A parabola through the least value and its neighbours: a fraction of a sample.
    best, least = float(grid[middle]), found[middle]
    if 0 < middle < len(grid) - 1:
        before, after = found[middle - 1], found[middle + 1]
        bend = before - 2.0 * least + after
        if bend > 0.0:
            trial = best + 0.5 * period * (before - after) / bend
            value = unexplained(trial)
            best, least = (trial, value) if value < least else (best, least)
    return Delay(best, max(1.0 - least / whole, 0.0))
