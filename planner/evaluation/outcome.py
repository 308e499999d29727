"""Results of the paper's experiment: joints, foot, step tests and all distances."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from planner.evaluation.baselines import TimeShift
from planner.evaluation.checks import beyond_limits
from planner.evaluation.metrics import Distance, angle_distance
from planner.evaluation.paper import deviations
from planner.gait.half_ellipse import ReferenceWalk
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.model.step_test import step_test
from planner.planning.result import FootInversion, Inversion
from planner.trajectory import Array

VISIBLE = 0.01
"""A speed has changed, or is the top speed, when it is this close, relative to the top speed."""


@dataclass(frozen=True, eq=False)
class JointOutcome:
    """One joint of the experiment.

    Attributes:
        name: The joint.
        desired: Desired angles [rad], shape (n,): the paper's Des.
        direct: Angles when these are requested [rad], shape (n,): Dir.
        limits: Smallest and largest request that the joint can take [rad].
        closed_form_plain: The inversion as in the paper, which knows no limits.
        closed_form: The same, with the knots moved until the joint itself tracks best; ours.
        optimal: The optimised inversion, within the joint's limits.
        foot_requests: Requests of the plan for all joints at once [rad], shape (n,).
        foot_optimal: Angles under them [rad], shape (n,).
    """

    name: str
    desired: Array
    limits: tuple[float, float]
    direct: Array
    closed_form_plain: Inversion
    closed_form: Inversion
    optimal: Inversion
    foot_requests: Array
    foot_optimal: Array

    @property
    def distances(self) -> dict[str, Distance]:
        """The rows of Table 2 [rad], Plain for the closed form as in the paper and MB for ours.

        Two more are of the optimised plans, Opt and Foot.
        """
        plain, refined = self.closed_form_plain, self.closed_form
        return {
            "Des,Dir": angle_distance(self.direct, self.desired),
            "Des,Plain": angle_distance(plain.predicted, self.desired),
            "Pwl,Plain": angle_distance(plain.predicted, approximation(plain)),
            "Des,MB": angle_distance(refined.predicted, self.desired),
            "Pwl,MB": angle_distance(refined.predicted, approximation(refined)),
            "Des,Opt": angle_distance(self.optimal.predicted, self.desired),
            "Des,Foot": angle_distance(self.foot_optimal, self.desired),
        }

    @property
    def excesses(self) -> dict[str, float]:
        """How far the farthest request of each plan is beyond the joint's limits [rad], or 0."""
        requests = {
            "closed_form_plain": self.closed_form_plain.requests,
            "closed_form": self.closed_form.requests,
            "optimal": self.optimal.requests,
            "foot_optimal": self.foot_requests,
        }
        return {
            method: max(beyond_limits(values, self.limits), 0.0)
            for method, values in requests.items()
        }


def approximation(closed_form: Inversion) -> Array:
    """Piecewise linear approximation behind a closed form at the samples [rad], shape (n,): Pwl."""
    assert closed_form.approximation is not None, "a closed form has one"
    return closed_form.approximation.angles


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
class PlannedWalk:
    """Every plan for the reference walk, and what the joints' models predict of it.

    Attributes:
        models: The model of each joint, in the leg's order.
        segments: Lines of each approximation.
        walk: The reference walk with its leg.
        joints: One outcome per joint, in the leg's order.
        knee: Where the leg's knee is at the desired angles [m], shape (n, 3).
        legs: Where the leg's joints and, last, its foot are at the ``desired`` angles and under
            each method [m], shape (n, joints + 1, 3).
        shift: The best time shift.
        foot_plan: The plan for all joints at once, which keeps the foot close to its path.
        foot: The foot under ``direct``, ``shift``, ``closed_form_plain``, ``closed_form``,
            ``optimal``, ``foot_optimal``.
    """

    models: tuple[JointModel, ...]
    segments: int
    walk: ReferenceWalk
    joints: tuple[JointOutcome, ...]
    knee: Array
    legs: Mapping[str, Array]
    shift: TimeShift
    foot_plan: FootInversion
    foot: Mapping[str, FootOutcome]

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


@dataclass(frozen=True, eq=False)
class Reproduction(PlannedWalk):
    """Everything that the experiment gave on one model for all joints.

    Attributes:
        steps: The step tests, by amplitude [degrees].
        seconds: Time that each part took [s].
    """

    steps: Mapping[float, StepResponse]
    seconds: Mapping[str, float]

    @property
    def model(self) -> JointModel:
        """The model of every joint."""
        return self.models[0]

    @property
    def baseline_deviation(self) -> float:
        """Mean relative deviation of the ten baseline figures from the paper's."""
        return float(np.mean(deviations(self.table2, self.foot_table)))


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A joint's steady answer to the step test, and its features at the step down.

    Attributes:
        amplitude: Height of the step [rad].
        requests: Requests of Equation 1 [rad], shape (n,).
        angles: Angles [rad], shape (n,).
        step: Sample at which the requests step down.
        lag: Samples until the speed begins to change.
        acceleration: Samples from then until the joint moves down at its top speed.
        v_max: Its top speed [rad/s].
    """

    amplitude: float
    requests: Array
    angles: Array
    step: int
    lag: int
    acceleration: int
    v_max: float


def measure_step_response(
    model: JointModel, amplitude: float, *, samples: int = 88
) -> StepResponse:
    """Run the step test of Equation 1 and read its features off, in whole samples as by eye.

    Args:
        model: The joint.
        amplitude: Height of the step [rad]; high enough for the joint to reach its top speed.
        samples: Length of the test.
    """
    requests = step_test(amplitude, samples=samples)
    angles = simulate(model, requests)
    step = int(np.argmin(requests))
    speeds = angles - np.roll(angles, 1)  # speeds[k] leads from sample k - 1 to k [rad/sample]
    fastest = float(np.max(np.abs(speeds)))
    after = speeds[step:]
    begun = int(np.argmax(np.abs(after - after[0]) > VISIBLE * fastest))
    full = int(np.argmax(after <= -(1.0 - VISIBLE) * fastest))
    lag = begun - 1  # sample `begun` ends the first interval in which the speed is another
    return StepResponse(
        amplitude=amplitude,
        requests=requests,
        angles=angles,
        step=step,
        lag=lag,
        acceleration=full - lag,
        v_max=fastest / model.period,
    )
