"""A fit of the joint to the rows of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.identification.grid import Grid
from planner.identification.simulation import Parameters, Pulls
from planner.trajectory import Array


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A fit to the rows of a grid.

    Attributes:
        grid: The rows.
        parameters: The joint.
        free: Which parameters were fitted, in their order.
        starts: Angle at the start of each run [rad].
        pulls: What pulls at each tick.
        states: Angles at all states [rad].
        scale: Standard deviation of the residuals, outliers aside [rad].
        cost: Huber's loss at that scale, sum over the rows [rad^2]; half a sum of squares.
        weights: Weight of each row, 1 unless its residual is an outlier.
    """

    grid: Grid
    parameters: Parameters
    free: np.ndarray
    starts: Array
    pulls: Pulls
    states: Array
    scale: float
    cost: float
    weights: Array

    @property
    def predicted(self) -> Array:
        """Angle at the used rows [rad]."""
        return self.grid.at_rows(self.states)

    @cached_property
    def residuals(self) -> Array:
        """Predicted minus actual angle at the used rows [rad]."""
        return self.predicted - self.grid.angles

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, outliers included [rad]."""
        return float(np.sqrt(np.mean(self.residuals**2)))
