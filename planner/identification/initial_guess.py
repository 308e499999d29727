"""Where the search sets out: delays read off the log, speeds it shows, several splits of both."""

from __future__ import annotations

import numpy as np

from planner.identification.least_squares import OPTIONS as FITTING
from planner.identification.least_squares import Fit, least_squares
from planner.identification.parameters import Parameters
from planner.identification.resampling import Grid
from planner.identification.robust_loss import huber, rms
from planner.trajectory import Array

DIVISIONS = ((0.0, 1.0, 3.0), (0.5, 0.7, 3.0), (0.2, 0.5, 1.5), (0.8, 0.4, 6.0))
"""How a start divides the whole delay: lag and acceleration time as shares of it, and gain times
it. The window begins wide, since a narrow one sees only the nearest change of a request."""


def best_delay(grid: Grid) -> tuple[float, float]:
    """The delay after which the requests come nearest to the angles.

    Returns:
        Delay [s], the least among equals, and the root mean square error that is left [rad].
    """
    step = 4.0 * grid.tick
    delays = np.arange(0.0, grid.reach, step)
    for _ in range(3):
        errors = np.array([rms(delayed_errors(grid, delay)) for delay in delays])
        best = int(np.argmin(errors))
        delay = float(delays[best])
        step /= 8.0
        around = delay + step * np.arange(-8, 9)
        delays = np.unique(np.append(around[around >= 0.0], delay))
    return delay, float(errors[best])


def delayed_errors(grid: Grid, delay: float) -> Array:
    """The request of ``delay`` [s] ago minus the angle, at the used rows [rad].

    A request that comes into force at the very time of a row counts for that row.
    """
    number = np.searchsorted(grid.edges, grid.times - delay + 1e-6 * grid.tick, side="right") - 1
    return np.asarray(grid.requests[np.maximum(number, 0)] - grid.angles)


def top_speed(grid: Grid) -> float:
    """Highest speed that the angles show over five rows at least now and then [rad/s]."""
    times = grid.times
    far = min(5, len(times) - 1)
    steps = times[far:] - times[:-far]
    same = grid.run[far:] == grid.run[:-far]
    speeds = np.abs(grid.angles[far:] - grid.angles[:-far])[same] / steps[same]
    return float(np.quantile(speeds, 0.98)) if len(speeds) else 0.0


def divided_delay(delay: float, *, v_max: float, offset: float = 0.0) -> list[Parameters]:
    """Joints of about the same delay [s], divided into lag, window and time constant."""
    return [
        Parameters(
            gain=share / delay,
            v_max=v_max,
            lag=lag * delay,
            acceleration_time=window * delay,
            offset=offset,
        )
        for lag, window, share in DIVISIONS
    ]


def initial_fit(grid: Grid) -> Fit:
    """The best fit on a grid: of several starts the one that is best after a few steps."""
    delay, _ = best_delay(grid)
    whole = max(delay, 2.0 * grid.tick)
    speed = top_speed(grid)
    begins = divided_delay(whole, v_max=max(speed, 1e-9 * float(np.ptp(grid.angles)) / grid.tick))
    quick = [least_squares(grid, begin, effort=FITTING.quick) for begin in begins]
    scale = min(fit.scale for fit in quick)
    best = min(quick, key=lambda fit: huber(fit.residuals, scale)[0])
    at, starts = best.parameters, best.starts
    return least_squares(grid, at, starts=starts, scale=scale, effort=FITTING.search)
