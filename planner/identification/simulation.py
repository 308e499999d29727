"""The joint through all runs of a grid at once."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from planner.identification.grid import Grid
from planner.identification.walk import walk
from planner.model.joint import JointModel
from planner.trajectory import Array


class Parameters(NamedTuple):
    """A joint by what its motion shows; v_max may be infinite: then it never saturates."""

    gain: float  # v_max / theta_0 [1/s]
    v_max: float  # [rad/s]
    lag: float  # [s]
    acceleration_time: float  # [s]
    offset: float  # [rad]

    @classmethod
    def of(cls, model: JointModel) -> Self:
        """The parameters of a model."""
        return cls(
            gain=model.v_max / model.theta_0,
            v_max=model.v_max,
            lag=model.lag,
            acceleration_time=model.acceleration_time,
            offset=model.offset,
        )

    def model(self, *, tick: float, hold: int) -> JointModel:
        """The model with these parameters."""
        return JointModel(
            v_max=self.v_max,
            theta_0=self.v_max / self.gain,
            lag=self.lag,
            acceleration_time=self.acceleration_time,
            tick=tick,
            hold=hold,
            offset=self.offset,
        )


class Pulls(NamedTuple):
    """The requests that act at each tick, those in force in [t - lag - a, t - lag]."""

    weights: Array  # (t, m), sums to 1
    targets: Array  # request + offset [rad], (t, m)


def pulls_of(grid: Grid, parameters: Parameters) -> Pulls:
    """What pulls at each tick: a request counts by the time it is in force within the window.

    With even rows and whole ticks these are the weights of :attr:`JointModel.window`.
    """
    young = grid.ticks - parameters.lag
    old = young - parameters.acceleration_time
    last = len(grid.edges) - 1
    first = np.maximum(np.searchsorted(grid.edges, old, side="right") - 1, 0)
    final = np.maximum(np.searchsorted(grid.edges, young, side="left") - 1, first)
    width = int(np.max(final - first, initial=0)) + 1
    numbers = np.minimum(first[:, np.newaxis] + np.arange(width), last)
    ends = np.append(grid.edges[1:], np.inf)
    overlap = np.minimum(ends[numbers], young[:, np.newaxis])
    overlap -= np.maximum(grid.edges[numbers], old[:, np.newaxis])
    overlap[first[:, np.newaxis] + np.arange(width) > last] = 0.0
    np.maximum(overlap, 0.0, out=overlap)
    overlap /= np.sum(overlap, axis=1, keepdims=True)
    return Pulls(overlap, grid.requests[numbers] + parameters.offset)


def respond(
    grid: Grid,
    parameters: Parameters,
    starts: Array,
    *,
    pulls: Pulls | None = None,
    guess: Array | None = None,
) -> Array:
    """Angles at all states: Equation 3, run.

    Args:
        grid: The runs.
        parameters: The joint.
        starts: Angle at the start of each run [rad], shape (runs,).
        pulls: What :func:`pulls_of` says, where it is known already.
        guess: Angles at all states that are nearly right [rad], shape (s,).

    Returns:
        Angles [rad], shape (s,).
    """
    return walk(grid, parameters, starts, pulls or pulls_of(grid, parameters), guess)
