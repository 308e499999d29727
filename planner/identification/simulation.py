"""The joint through all runs of a grid: Equation 3 along logs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.identification.parameters import Parameters
from planner.identification.resampling import Grid, Indices
from planner.trajectory import Array


class ActiveRequests(NamedTuple):
    """The requests that act at each tick, those in force in [t - lag - a, t - lag]."""

    weights: Array  # sums to 1 over the window, (m, t)
    targets: Array  # request + offset [rad], (m, t)


def active_requests(
    grid: Grid, parameters: Parameters, *, some: Indices | slice = slice(None)
) -> ActiveRequests:
    """The requests that act at some ticks: each counts by its time in force within the window.

    With even rows and whole ticks these are the weights of :attr:`JointModel.window`.
    """
    from planner.model import kernel

    weights, targets = kernel.windows_along(
        grid.edges,
        grid.requests,
        grid.ticks[some],
        parameters.lag,
        parameters.acceleration_time,
    )
    return ActiveRequests(weights, targets + sags(parameters, grid.loads[some]))


def sags(parameters: Parameters, loads: Array) -> Array:
    """Angle at rest less request under loads [rad]."""
    return np.asarray(parameters.offset + parameters.compliance * loads)


def respond(
    grid: Grid,
    parameters: Parameters,
    starts: Array,
    *,
    active: ActiveRequests | None = None,
    acceleration: float = math.inf,
    play: float = 0.0,
) -> Array:
    """Angles at all states: Equation 3, run.

    Args:
        grid: The runs.
        parameters: The joint.
        starts: Angle at the start of each run [rad], shape (runs,).
        active: What :func:`active_requests` says, where it is known already.
        acceleration: Limit of the acceleration [rad/s^2].
        play: Backlash between motor and angle [rad].

    Returns:
        Angles [rad], shape (s,).
    """
    from planner.model import kernel

    active = active or active_requests(grid, parameters)
    angles = np.empty(len(grid.ticks) + len(starts))
    angles[grid.starts] = starts
    kernel.follow(
        parameters.law_per_tick(grid.tick)._replace(acceleration=acceleration * grid.tick**2),
        active.weights,
        active.targets,
        grid.tick * parameters.faster(grid.loads),
        play,
        grid.states,
        angles,
        np.zeros(len(angles)),
    )
    return angles
