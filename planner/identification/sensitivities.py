"""How the predicted angles change with the parameters of the joint and with the first angles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_banded

from planner.identification.parameters import COUNT, Free, Parameters, units
from planner.identification.resampling import Grid
from planner.identification.simulation import ActiveRequests
from planner.trajectory import Array

EDGE_DISTANCE = 1e-9
"""Distance from an edge of the window at which requests are read [ticks]: where the edge meets a
change of the request the derivative jumps, and the mean of both sides is taken."""


class Sensitivities(NamedTuple):
    """Derivatives of the angles at the used rows of a grid."""

    by_parameter: Array  # (rows, p), by the free coordinates of ``parameters.COORDINATES``
    by_start: Array  # (rows,), each by the first angle of its own run


def sensitivities(
    grid: Grid,
    parameters: Parameters,
    states: Array,
    active: ActiveRequests,
    *,
    free: Free | None = None,
    averaging: float = EDGE_DISTANCE,
) -> Sensitivities:
    """Derivatives by the parameters and by the first angles: (16) of ``docs/math.md``.

    One forward recursion, written as a bidiagonal system.

    Args:
        grid: The runs.
        parameters: The joint.
        states: Its angles at all states [rad], shape (s,).
        active: The requests that act at each tick.
        free: By which parameters; by default all.
        averaging: Distance to both sides over which derivatives by lag and acceleration time are
            averaged [ticks].
    """
    gain, load = parameters.gain, grid.loads[:, np.newaxis]
    before = states[grid.states - 1]
    errors = active.targets - before[:, np.newaxis]
    beyond = parameters.beyond(errors)
    limited = parameters.law(load)(errors)
    sloped = parameters.inside(errors, load)
    inside = sloped * active.weights
    saturated = ((beyond != 0.0) & ~sloped) * active.weights
    young = grid.ticks - parameters.lag
    newest, oldest = (
        _speed_at(grid, parameters, edge, before, averaging * grid.tick)
        for edge in (young, young - parameters.acceleration_time)
    )
    slack = np.sum(inside, axis=1)
    at_limit = (0.0 if math.isinf(parameters.v_max) else parameters.v_max) * np.sum(
        saturated, axis=1
    )
    relative = parameters.asymmetry + parameters.slowing * load
    drives = np.stack(
        [
            np.sum(inside * beyond, axis=1),
            np.sum((np.sign(beyond) + relative) * saturated, axis=1),
            (oldest - newest) / parameters.acceleration_time,
            (oldest - np.sum(active.weights * limited, axis=1)) / parameters.acceleration_time,
            gain * slack,
            -gain * np.sum(np.sign(beyond) * inside, axis=1),
            at_limit,
            gain * slack * grid.loads,
            at_limit * grid.loads,
        ],
        axis=1,
    )
    chosen = np.arange(COUNT) if free is None else np.flatnonzero(free)
    count = len(chosen)
    right = np.zeros((len(states), count + 1))
    right[grid.states, :count] = grid.tick * (drives * units(grid, parameters))[:, chosen]
    right[grid.starts, count] = 1.0
    band = np.ones((2, len(states)))
    band[1] = 0.0
    band[1, grid.states - 1] = grid.tick * gain * slack - 1.0
    solved = solve_banded((1, 0), band, right, overwrite_b=True, check_finite=False)
    at_rows = grid.at_rows(solved)
    return Sensitivities(at_rows[:, :count], at_rows[:, count])


def _speed_at(
    grid: Grid, parameters: Parameters, times: Array, before: Array, distance: float
) -> Array:
    """Speed called for by the request in force at each time, the mean of a moment to both sides."""
    law = parameters.law(grid.loads)
    sag = parameters.offset + parameters.compliance * grid.loads
    speed = np.zeros(len(times))
    for moment in (times - distance, times + distance):
        number = np.maximum(np.searchsorted(grid.edges, moment, side="right") - 1, 0)
        errors = grid.requests[number] + sag - before
        speed += law(errors) / 2.0
    return speed
