"""How the predicted angles change with the parameters of the joint and with the first angles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.identification.parameters import COUNT, Free, Parameters, units
from planner.identification.resampling import Grid
from planner.identification.simulation import ActiveRequests, recursion
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

    One forward recursion.

    Args:
        grid: The runs.
        parameters: The joint.
        states: Its angles at all states [rad], shape (s,).
        active: The requests that act at each tick.
        free: By which parameters; by default all.
        averaging: Distance to both sides over which derivatives by lag and acceleration time are
            averaged [ticks].
    """
    gain, load = parameters.gain, grid.loads
    before = states[grid.states - 1]
    errors = active.targets - before
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
    slack = np.sum(inside, axis=0)
    at_limit = (0.0 if math.isinf(parameters.v_max) else parameters.v_max) * np.sum(
        saturated, axis=0
    )
    relative = parameters.asymmetry + parameters.slowing * load
    drives = np.stack(
        [
            np.sum(inside * beyond, axis=0),
            np.sum((np.sign(beyond) + relative) * saturated, axis=0),
            (oldest - newest) / parameters.acceleration_time,
            (oldest - np.sum(active.weights * limited, axis=0)) / parameters.acceleration_time,
            gain * slack,
            -gain * np.sum(np.sign(beyond) * inside, axis=0),
            at_limit,
            gain * slack * load,
            at_limit * load,
        ]
    )
    chosen = np.arange(COUNT) if free is None else np.flatnonzero(free)
    inputs = np.zeros((len(chosen) + 1, len(states)))
    inputs[:-1, grid.states] = (grid.tick * units(grid, parameters)[:, np.newaxis] * drives)[chosen]
    inputs[-1, grid.starts] = 1.0
    at_rows = grid.at_rows(recursion(grid, 1.0 - grid.tick * gain * slack, inputs.T))
    return Sensitivities(at_rows[:, :-1], at_rows[:, -1])


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
