"""What a simpler description would make of the same rows: no model, a delay, a first-order lag."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.identification.least_squares import OPTIONS as FITTING
from planner.identification.least_squares import Fit, least_squares
from planner.identification.parameters import Parameters, only
from planner.identification.resampling import Grid
from planner.identification.robust_loss import rms
from planner.identification.simulation import respond
from planner.trajectory import Array

FIRST_ORDER = only("gain", "lag", "offset")
"""The parameters of a first-order lag."""


class Simple(NamedTuple):
    """A simpler description, fitted.

    Attributes:
        name: "raw", "delay" or "first_order".
        parameters: As in :class:`planner.identification.result.Alternative`.
        joint: The joint that behaves so; None for a request that is merely delayed.
    """

    name: str
    parameters: dict[str, float]
    joint: Parameters | None


def simple_fits(grid: Grid) -> tuple[Simple, ...]:
    """Fit the simpler descriptions, the simplest first."""
    delay, _ = best_delay(grid)
    first_order = _first_order(grid, delay)
    at = first_order.parameters
    found = {
        "delay": at.lag + at.acceleration_time / 2.0,
        "time_constant": 1.0 / at.gain,
        "offset": at.offset,
    }
    return (
        Simple("raw", {}, None),
        Simple("delay", {"delay": delay}, None),
        Simple("first_order", {name: float(value) for name, value in found.items()}, at),
    )


def errors_of(simple: Simple, grid: Grid, starts: Array) -> Array:
    """Predicted minus actual angle of a simpler description at the used rows [rad]."""
    if simple.joint is None:
        return delayed_errors(grid, simple.parameters.get("delay", 0.0))
    return grid.at_rows(respond(grid, simple.joint, starts)) - grid.angles


def _first_order(grid: Grid, delay: float) -> Fit:
    """A joint that never saturates and whose window is a single tick.

    The search starts with none, half and nine tenths of the whole delay as pure delay.
    """
    whole = max(delay, 2.0 * grid.tick)
    begins = [
        Parameters(
            gain=1.0 / max((1.0 - share) * whole, grid.tick),
            v_max=math.inf,
            lag=share * whole,
            acceleration_time=grid.tick,
            offset=0.0,
        )
        for share in (0.0, 0.5, 0.9)
    ]
    fits = [least_squares(grid, begin, free=FIRST_ORDER, effort=FITTING.quick) for begin in begins]
    best = min(fits, key=lambda fit: fit.rms)
    return least_squares(grid, best.parameters, free=FIRST_ORDER, starts=best.starts)


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
