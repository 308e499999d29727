"""How the predicted angles change with the parameters of the joint and with the first angles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.identification.parameters import COUNT, Free, Parameters, units
from planner.identification.resampling import Grid
from planner.identification.simulation import ActiveRequests, sags
from planner.trajectory import Array

EDGE_DISTANCE = 1e-9
"""Distance from an edge of the window at which requests are read [ticks]: where the edge meets a
change of the request the derivative jumps, and the mean of both sides is taken."""


VANISHES = 40.0
"""Time constants after which nothing but rounding is left of a speed: exp(-40) is 4e-18."""


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
    from planner.model import kernel

    tick, loads = grid.tick, grid.loads
    young = grid.ticks - parameters.lag
    sag, apart = sags(parameters, loads), averaging * tick
    edges = [
        kernel.in_force(grid.edges, grid.requests, edge + way) + sag
        for edge in (young, young - parameters.acceleration_time)
        for way in (-apart, apart)
    ]
    slopes = kernel.slopes_along(
        parameters.law_per_tick(tick),
        active.weights,
        active.targets,
        tick * parameters.faster(loads),
        loads,
        np.array(edges),
        parameters.acceleration_time / tick,
        grid.states,
        states,
        _speeds(grid, states),
        grid.before,
        grid.share,
    )
    # From what the kernel takes to the fields of Parameters.
    by_gain, by_v_max, by_lag, by_window, by_sag, by_band, by_faster, *by_load, by_share, _, _ = (
        slopes.T
    )
    v_max = 0.0 if math.isinf(parameters.v_max) else parameters.v_max
    relative = parameters.asymmetry * by_faster + parameters.slowing * by_load[1]
    columns = [
        tick * by_gain,
        tick * (by_v_max + relative),
        by_lag / tick,
        by_window / tick,
        by_sag,
        by_band,
        tick * v_max * by_faster,
        by_load[0],
        tick * v_max * by_load[1],
        by_share * _share_by_time(tick, parameters.time_constant),
    ]
    chosen = np.arange(COUNT) if free is None else np.flatnonzero(free)
    scales = units(grid, parameters)
    by_parameter = np.empty((len(slopes), len(chosen)))
    for place, number in enumerate(chosen):
        np.multiply(columns[number], scales[number], out=by_parameter[:, place])
    return Sensitivities(by_parameter, slopes[:, -1])


def _speeds(grid: Grid, states: Array) -> Array:
    """Speed of the tick that leads to each state [rad/tick]; 0 where a run starts."""
    speeds = np.zeros(len(states))
    speeds[grid.states] = states[grid.states] - states[grid.states - 1]
    return speeds


def _share_by_time(tick: float, time_constant: float) -> float:
    """Derivative of the motor's share, 1 - exp(-tick / time constant), by that [1/s]."""
    if tick > VANISHES * time_constant:  # without inertia
        return 0.0
    return -tick / time_constant**2 * math.exp(-tick / time_constant)
