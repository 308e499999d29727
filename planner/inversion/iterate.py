"""Where a search of the optimised inversion is, and what it is after."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.inversion.calming import calming
from planner.inversion.goal import quadratic
from planner.inversion.step import Mask, Pull, Quadratic
from planner.inversion.tracking import Tracking
from planner.model.sensitivity import Response
from planner.trajectory import Array

FIRST_DAMPING = 1e-4
"""Weight on the size of a search's first step, relative to that on the errors."""


class Stage(NamedTuple):
    """One problem of a search.

    Attributes:
        smoothing: Radius of the saturation's corners [theta_0].
        pull: Weight on the squared distance of the requests from those that would hold the desired
            angles, relative to that on the squared errors.
        power: The errors' exponent in the cost.
        unit: Error that counts as one: where the largest error counts, the largest one so far.
        steps: Steps at most: the next stage carries on where this one stops.
        calming: Whether the pull is on the squared changes from one request to the next instead.
    """

    smoothing: float
    pull: float
    power: float = 2.0
    unit: float = 1.0
    steps: int = 6
    calming: bool = False


class State(NamedTuple):
    """Where a search is, and what it has learnt for its next step."""

    requests: Array  # (n, joints) [rad]
    angles: Array  # (n, joints) [rad]
    damping: float = FIRST_DAMPING
    multipliers: Array | None = None
    held: Mask | None = None  # requests that stay at their limits


class Iterate(NamedTuple):
    """Requests, angles, how the smoothed models answer, and what they cost."""

    requests: Array
    angles: Array
    response: Response
    lacking: Array  # by how much the angles fall short of where the models lead, (n, joints)
    cost: Quadratic
    pull: Pull
    value: float  # the stage's cost

    def merit(self, multipliers: Array, charge: float) -> float:
        """The augmented Lagrangian: what the cost will be once nothing lacks, and a charge.

        Args:
            multipliers: What each radian that lacks is worth, (n, joints).
            charge: Weight on the squares of what lacks.
        """
        worth = np.vdot(charge * self.lacking - 2.0 * multipliers, self.lacking)
        return self.value + float(worth)


def iterate(problem: Tracking, requests: Array, angles: Array, stage: Stage) -> Iterate:
    """What the smoothed models and the stage make of requests and angles."""
    response = problem.respond(angles, requests, smoothing=stage.smoothing)
    errors = problem.goal.errors(angles)
    cost = quadratic(errors, power=stage.power, unit=stage.unit, ridge=problem.ridge)
    if stage.calming:
        pull = calming(requests, stage.pull, cyclic=problem.cyclic)
    else:
        pull = Pull(stage.pull, requests - problem.resting)
    lacking = response.reached - angles
    return Iterate(requests, angles, response, lacking, cost, pull, cost.value + pull.value)
