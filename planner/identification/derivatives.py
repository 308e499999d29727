"""How the angles of a grid change with the parameters of the joint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.identification.grid import Grid
from planner.identification.simulation import Parameters, Pulls
from planner.model.joint import saturation
from planner.trajectory import Array


class Derivatives(NamedTuple):
    """Derivatives of the angles at the states of a grid."""

    by_parameter: Array  # (s, 5), in the order of Parameters
    by_start: Array  # (s,), each by the start of its own run


def derivatives(
    grid: Grid, parameters: Parameters, states: Array, pulls: Pulls, *, blur: float = 0.0
) -> Derivatives:
    """Derivatives of the states by the parameters and by the starts, in one forward recursion.

    Where an edge of the window meets a change of the request the derivative jumps; there it is the
    mean of those ``blur`` to either side.

    Args:
        grid: The runs.
        parameters: The joint.
        states: Its angles at all states [rad], shape (s,).
        pulls: What pulls at each tick.
        blur: Distance over which derivatives by lag and acceleration time are averaged [s].
    """
    from scipy.linalg import solve_banded

    gain, v_max = parameters.gain, parameters.v_max
    before = states[grid.states - 1]
    errors = pulls.targets - before[:, np.newaxis]
    called = gain * errors
    limited = saturation(errors, gain=gain, v_max=v_max)
    inside = (np.abs(called) < v_max) * pulls.weights
    young = grid.ticks - parameters.lag
    newest, oldest = (
        _speed_at(grid, parameters, edge, before, blur)
        for edge in (young, young - parameters.acceleration_time)
    )
    slack = np.sum(inside, axis=1)
    by_parameter = np.zeros((len(states), 6))
    drives = np.stack(
        [
            np.sum(inside * errors, axis=1),
            np.sum(np.sign(called) * (pulls.weights - inside), axis=1),
            (oldest - newest) / parameters.acceleration_time,
            (oldest - np.sum(pulls.weights * limited, axis=1)) / parameters.acceleration_time,
            gain * slack,
        ],
        axis=1,
    )
    by_parameter[grid.states, :5] = grid.tick * drives
    by_parameter[grid.starts, 5] = 1.0
    band = np.ones((2, len(states)))
    band[1] = 0.0
    band[1, grid.states - 1] = grid.tick * gain * slack - 1.0
    solved = solve_banded((1, 0), band, by_parameter, overwrite_b=True, check_finite=False)
    return Derivatives(solved[:, :5], solved[:, 5])


def _speed_at(
    grid: Grid, parameters: Parameters, times: Array, before: Array, blur: float
) -> Array:
    """Speed called for by the request in force at each time, the mean of a moment to both sides."""
    aside = max(blur, 1e-9 * grid.tick)
    speed = np.zeros(len(times))
    for moment in (times - aside, times + aside):
        number = np.maximum(np.searchsorted(grid.edges, moment, side="right") - 1, 0)
        errors = grid.requests[number] + parameters.offset - before
        speed += saturation(errors, gain=parameters.gain, v_max=parameters.v_max) / 2.0
    return speed
