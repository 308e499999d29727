"""How the predicted angles change with the parameters of the joint and with the first angles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_banded

from planner.identification.parameters import COUNT, Parameters, units
from planner.identification.resampling import Grid
from planner.identification.simulation import ActiveRequests
from planner.model.joint import saturation
from planner.trajectory import Array

ASIDE = 1e-9
"""Distance from an edge of the window at which requests are read [ticks]: where the edge meets a
change of the request the derivative jumps, and the mean of both sides is taken."""


class Sensitivities(NamedTuple):
    """Derivatives of the angles at the used rows of a grid."""

    by_parameter: Array  # (rows, p), by the coordinates of ``parameters.COORDINATES``
    by_start: Array  # (rows,), each by the first angle of its own run


def sensitivities(
    grid: Grid,
    parameters: Parameters,
    states: Array,
    active: ActiveRequests,
    *,
    averaging: float = ASIDE,
) -> Sensitivities:
    """Derivatives by the parameters and by the first angles: (16) of ``docs/math.md``.

    One forward recursion, written as a bidiagonal system.

    Args:
        grid: The runs.
        parameters: The joint.
        states: Its angles at all states [rad], shape (s,).
        active: The requests that act at each tick.
        averaging: Distance to both sides over which derivatives by lag and acceleration time are
            averaged [ticks].
    """
    gain, v_max = parameters.gain, parameters.v_max
    before = states[grid.states - 1]
    errors = active.targets - before[:, np.newaxis]
    called = gain * errors
    limited = saturation(errors, gain=gain, v_max=v_max)
    inside = (np.abs(called) < v_max) * active.weights
    young = grid.ticks - parameters.lag
    newest, oldest = (
        _speed_at(grid, parameters, edge, before, averaging * grid.tick)
        for edge in (young, young - parameters.acceleration_time)
    )
    slack = np.sum(inside, axis=1)
    drives = np.stack(
        [
            np.sum(inside * errors, axis=1),
            np.sum(np.sign(called) * (active.weights - inside), axis=1),
            (oldest - newest) / parameters.acceleration_time,
            (oldest - np.sum(active.weights * limited, axis=1)) / parameters.acceleration_time,
            gain * slack,
        ],
        axis=1,
    )
    right = np.zeros((len(states), COUNT + 1))
    right[grid.states, :COUNT] = grid.tick * drives * units(grid, parameters)
    right[grid.starts, COUNT] = 1.0
    band = np.ones((2, len(states)))
    band[1] = 0.0
    band[1, grid.states - 1] = grid.tick * gain * slack - 1.0
    solved = solve_banded((1, 0), band, right, overwrite_b=True, check_finite=False)
    at_rows = grid.at_rows(solved)
    return Sensitivities(at_rows[:, :COUNT], at_rows[:, COUNT])


def _speed_at(
    grid: Grid, parameters: Parameters, times: Array, before: Array, aside: float
) -> Array:
    """Speed called for by the request in force at each time, the mean of a moment to both sides."""
    speed = np.zeros(len(times))
    for moment in (times - aside, times + aside):
        number = np.maximum(np.searchsorted(grid.edges, moment, side="right") - 1, 0)
        errors = grid.requests[number] + parameters.offset - before
        speed += saturation(errors, gain=parameters.gain, v_max=parameters.v_max) / 2.0
    return speed
