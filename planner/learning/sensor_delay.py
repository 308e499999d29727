"""Late sensors: the pure delay that explains most, and measured angles with it taken off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.planning.plan import Plan
from planner.planning.trials import SensorDelay
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class DelayOptions:
    """When a disturbance is taken for a delay of the sensor.

    Attributes:
        mentioned: Share of the squared disturbance that a delay must explain to be mentioned [-].
        of_joint: Largest delay that is believed to be the joint's, as a share of the latency of
            its model: parameters that are 30 % off make it wrong by 46 % at most. A disturbance
            that a longer one explains is taken for a sensor's, and not learnt.
        of_sensor: Share of the squared disturbance that it must explain for that [-].
    """

    mentioned: float = 0.8
    of_joint: float = 0.5
    of_sensor: float = 0.9


OPTIONS = DelayOptions()


def delays_to_remove(joints: Plan, cycles: Array, modelled: Array) -> list[float]:
    """The delay to take off the measured angles (cycles, n, k) of each joint [s]: a sensor's."""
    delays = delays_of(joints, cycles, modelled, [0.0] * len(joints.models))
    return [
        delay.seconds
        if delay.share >= OPTIONS.of_sensor and delay.seconds > OPTIONS.of_joint * model.latency
        else 0.0
        for delay, model in zip(delays, joints.models, strict=True)
    ]


def delays_of(
    joints: Plan, cycles: Array, modelled: Array, removed: Sequence[float]
) -> tuple[SensorDelay, ...]:
    """The delay beside the removed one that explains most, for each joint."""
    columns = zip(cycles.mean(axis=0).T, modelled.T, removed, strict=True)
    delays = []
    for angles, by_model, seconds in columns:
        delay, share = pure_delay(angles, by_model, joints.period, cyclic=joints.cyclic)
        delays.append(SensorDelay(seconds=delay, share=share, removed=seconds))
    return tuple(delays)


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
    remarks = []
    steps = np.diff(joints.requests, axis=0)
    speeds = np.sqrt(np.mean(steps**2, axis=0)) / joints.period
    for j, delay in enumerate(delays):
        of = "" if len(delays) == 1 else f" of joint {j + 1}"
        late = abs(delay.seconds)
        clear = late >= 0.25 * joints.period and late * speeds[j] > 2.0 * noise[j]
        if delay.removed:
            remarks.append(
                f"the measured angles{of} are taken to be {1e3 * delay.removed:.3g} ms late, by "
                "their sensor or log; that is not learnt. If the joint itself is that late: "
                "sensor_delay=0"
            )
        elif delay.share >= OPTIONS.mentioned and clear:
            share = f"{100.0 * delay.share:.0f} % of what the model misses{of} is"
            remarks.append(
                f"{share} that the joint answers {1e3 * late:.3g} ms earlier than the model: that "
                "is learnt"
                if delay.seconds < 0.0
                else f"{share} a delay of {1e3 * late:.3g} ms: it is learnt as the joint's. If the "
                f"sensor or the log is late by it: sensor_delay={late:.3g}"
            )
    return remarks


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


def pure_delay(
    measured: Array, modelled: Array, period: float, *, cyclic: bool
) -> tuple[float, float]:
    """The delay of the measured angles behind the modelled ones that explains most.

    Both (n,) [rad]; a constant difference is left out of it.

    Returns:
        The delay [s], and the share of the squared disturbance about its mean that it explains.
    """

    def unexplained(seconds: float) -> float:
        delayed = later(modelled[:, np.newaxis], seconds, period, cyclic=cyclic)[:, 0]
        return float(np.var(measured - delayed))

    whole = unexplained(0.0)
    if whole <= np.finfo(np.float64).tiny or not np.ptp(modelled):
        return 0.0, 0.0
    reach = max(min(len(modelled) // 8, 50), 1)
    grid = period * np.arange(-reach, reach + 1)
    errors = [unexplained(seconds) for seconds in grid]
    middle = int(np.argmin(errors))
    best, least = float(grid[middle]), errors[middle]
    # A parabola through the least value and its neighbours: a fraction of a sample.
    if 0 < middle < len(grid) - 1:
        before, after = errors[middle - 1], errors[middle + 1]
        bend = before - 2.0 * least + after
        if bend > 0.0:
            trial = best + 0.5 * period * (before - after) / bend
            least, best = min((least, best), (unexplained(trial), trial))
    return best, max(1.0 - least / whole, 0.0)
