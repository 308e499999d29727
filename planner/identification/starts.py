"""Where the search sets out: delays read off the log, speeds it shows, several splits of both."""

from __future__ import annotations

import numpy as np

from planner.identification.adjust import adjust
from planner.identification.adjusted import Adjusted
from planner.identification.grid import Grid
from planner.identification.loss import huber
from planner.identification.simulation import Parameters
from planner.trajectory import Array

SPLITS = ((0.0, 1.0, 3.0), (0.5, 0.7, 3.0), (0.2, 0.5, 1.5), (0.8, 0.4, 6.0))
"""How a start divides the delay of the whole: lag and acceleration time as shares of it, and gain
times it. The window begins wide, since a narrow one sees only the nearest change of a request."""

QUICK_STEPS = 12
"""Steps that tell a promising start from a poor one."""

NEARLY_AS_GOOD = 1.2
"""Starts whose cost is within this factor of the best are followed to the end."""

MOST_FOLLOWED = 3
"""Starts that are followed to the end at most."""

HOPS = ((1.0, -1.0), (-1.0, 1.0), (-1.0, 2.0), (1.0, -2.0))
"""Changes of lag and acceleration time [ticks] that may lead to a better fit nearby; the gain makes
up for the change of the whole delay."""

LEAST_REST = 0.3
"""Share of its time constant that the gain may give away for it."""

MORE_HOPS = ((-0.5, 0.0), (0.5, 0.0), (-1.0, 0.0), (-2.0, 4.0), (0.0, 3.0), (0.0, -2.0), (1.0, 1.0))
"""More of them, tried on short logs."""

HOP_STEPS = (5, 15)
"""Steps after which a hop is judged: on long logs, and on short ones, where steps cost little."""

SHORT = 8000
"""Ticks up to which a log is short."""

HOP_ROUNDS = 3
"""Hops in a row at most."""

WORTH_A_HOP = 1e-3
"""Share of the cost that a hop has to save."""


def best_delay(grid: Grid) -> tuple[float, float]:
    """The delay after which the requests come nearest to the angles.

    Returns:
        Delay [s], the least among equals, and the root mean square error that is left [rad].
    """
    times = _row_times(grid)
    step = 4.0 * grid.tick
    delays = np.arange(0.0, grid.reach, step)
    for _ in range(3):
        errors = np.array([_rms(_delayed_errors(grid, times, delay)) for delay in delays])
        best = int(np.argmin(errors))
        delay = float(delays[best])
        step /= 8.0
        around = delay + step * np.arange(-8, 9)
        delays = np.unique(np.append(around[around >= 0.0], delay))
    return delay, float(errors[best])


def delayed_errors(grid: Grid, delay: float) -> Array:
    """The request of ``delay`` [s] ago minus the angle, at the used rows [rad]."""
    return _delayed_errors(grid, _row_times(grid), delay)


def _row_times(grid: Grid) -> Array:
    at_states = np.zeros(len(grid.ticks) + len(grid.starts))
    at_states[grid.states] = grid.ticks
    firsts = grid.starts + 1
    at_states[grid.starts] = at_states[firsts] - grid.tick
    return grid.at_rows(at_states)


def _delayed_errors(grid: Grid, times: Array, delay: float) -> Array:
    # A request that comes into force at the very time of a row counts for that row.
    number = np.searchsorted(grid.edges, times - delay + 1e-6 * grid.tick, side="right") - 1
    return np.asarray(grid.requests[np.maximum(number, 0)] - grid.angles)


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def top_speed(grid: Grid) -> float:
    """Highest speed that the angles show over five rows at least now and then [rad/s]."""
    times = _row_times(grid)
    far = min(5, len(times) - 1)
    steps = times[far:] - times[:-far]
    same = grid.run[far:] == grid.run[:-far]
    speeds = np.abs(grid.angles[far:] - grid.angles[:-far])[same] / steps[same]
    return float(np.quantile(speeds, 0.98)) if len(speeds) else 0.0


def searched(grid: Grid) -> list[Adjusted]:
    """Fits from several starts on a grid, promising ones followed to the end, best first."""
    delay, _ = best_delay(grid)
    whole = max(delay, 2.0 * grid.tick)
    speed = top_speed(grid)
    begins = [
        Parameters(
            gain=share / whole,
            v_max=max(speed, 1e-9 * float(np.ptp(grid.angles)) / grid.tick),
            lag=lag * whole,
            acceleration_time=window * whole,
            offset=0.0,
        )
        for lag, window, share in SPLITS
    ]
    quick = [adjust(grid, begin, rounds=2, steps=QUICK_STEPS, precision=1e-3) for begin in begins]
    scale = min(fit.scale for fit in quick)
    quick.sort(key=lambda fit: huber(fit.residuals, scale)[0])
    best = huber(quick[0].residuals, scale)[0]
    kept = [fit for fit in quick if huber(fit.residuals, scale)[0] <= NEARLY_AS_GOOD * best]
    ends = [
        adjust(grid, fit.parameters, starts=fit.starts, scale=scale, precision=1e-3)
        for fit in kept[:MOST_FOLLOWED]
    ]
    return sorted(ends, key=lambda fit: fit.cost)


def nearby(fit: Adjusted) -> Adjusted:
    """The fit or a better one nearby, across the corners that whole ticks put into the cost."""
    tick = fit.grid.tick
    short = len(fit.grid.ticks) <= SHORT
    steps, hops = HOP_STEPS[short], HOPS + MORE_HOPS * short
    for _ in range(HOP_ROUNDS):
        at = fit.parameters
        moves = [(lag * tick, more * tick) for lag, more in hops]
        begins = [
            at._replace(
                gain=1.0 / max(1.0 / at.gain - lag - more / 2.0, LEAST_REST / at.gain),
                lag=at.lag + lag,
                acceleration_time=at.acceleration_time + more,
            )
            for lag, more in moves
            if at.lag + lag > -tick and at.acceleration_time + more > 0.0
        ]
        others = [
            adjust(fit.grid, begin, starts=fit.starts, scale=fit.scale, steps=steps, precision=1e-3)
            for begin in begins
        ]
        best = min(others, key=lambda other: other.cost, default=fit)
        if best.cost >= (1.0 - WORTH_A_HOP) * fit.cost:
            break
        fit = best
    return fit
