"""What the paper's experiment gives: joints, foot, step tests, and every distance between them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from planner.evaluation.baselines import TimeShift
from planner.evaluation.metrics import Distance, angle_distance
from planner.evaluation.paper import deviations
from planner.evaluation.step_response import StepResponse
from planner.gait import ReferenceWalk
from planner.inversion.foot_result import FootInversion
from planner.inversion.result import Inversion
from planner.model.joint import JointModel
from planner.trajectory import Array


@dataclass(frozen=True, eq=False)
class JointOutcome:
    """One joint of the experiment.

    Attributes:
        name: The joint.
        desired: Desired angles [rad], shape (n,): the paper's Des.
        direct: Angles when these are requested [rad], shape (n,): Dir.
        closed_form: The paper's inversion; its predicted angles are MB.
        optimal: The optimised inversion, within the joint's limits.
        foot_optimal: Angles under the plan for all joints at once [rad], shape (n,).
    """

    name: str
    desired: Array
    direct: Array
    closed_form: Inversion
    optimal: Inversion
    foot_optimal: Array

    @property
    def approximation(self) -> Array:
        """Piecewise linear approximation at the samples [rad], shape (n,): Pwl."""
        assert self.closed_form.approximation is not None, "a closed form has one"
        return self.closed_form.approximation.angles

    @property
    def distances(self) -> dict[str, Distance]:
        """The rows of Table 2 [rad], and two more for the optimised plans, Opt and Foot."""
        return {
            "Des,Dir": angle_distance(self.direct, self.desired),
            "Des,MB": angle_distance(self.closed_form.predicted, self.desired),
            "Pwl,MB": angle_distance(self.closed_form.predicted, self.approximation),
            "Des,Opt": angle_distance(self.optimal.predicted, self.desired),
            "Des,Foot": angle_distance(self.foot_optimal, self.desired),
        }


@dataclass(frozen=True, eq=False)
class FootOutcome:
    """The foot under one method.

    Attributes:
        positions: Its path [m], shape (n, 3).
        distances: Its distance from the desired path at each sample [m], shape (n,).
        distance: The same over all samples [m].
    """

    positions: Array
    distances: Array
    distance: Distance


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Everything that the experiment gave.

    Attributes:
        model: The model of every joint.
        segments: Lines of each approximation.
        walk: The reference walk with its leg.
        joints: One outcome per joint, in the leg's order.
        knee: Where the leg's knee is at the desired angles [m], shape (n, 3).
        shift: The best time shift.
        foot_plan: The plan for all joints at once, which keeps the foot close to its path.
        foot: The foot under ``direct``, ``shift``, ``closed_form``, ``optimal``, ``foot_optimal``.
        steps: The step tests, by amplitude [degrees].
        seconds: Time that each part took [s].
    """

    model: JointModel
    segments: int
    walk: ReferenceWalk
    joints: tuple[JointOutcome, ...]
    knee: Array
    shift: TimeShift
    foot_plan: FootInversion
    foot: Mapping[str, FootOutcome]
    steps: Mapping[float, StepResponse]
    seconds: Mapping[str, float]

    @property
    def table2(self) -> dict[str, dict[str, Distance]]:
        """Distances between angle trajectories by joint and comparison [degrees]: Table 2."""
        return {
            joint.name: {
                comparison: distance.in_units_of(math.radians(1.0))
                for comparison, distance in joint.distances.items()
            }
            for joint in self.joints
        }

    @property
    def foot_table(self) -> dict[str, Distance]:
        """Distances of the foot from its desired path by method [cm]."""
        return {method: outcome.distance.in_units_of(0.01) for method, outcome in self.foot.items()}

    @property
    def baseline_deviation(self) -> float:
        """Mean relative deviation of the ten baseline figures from the paper's."""
        return float(np.mean(deviations(self.table2, self.foot_table)))
