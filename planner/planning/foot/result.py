"""The result of an inversion in the foot's space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from planner.model.joint import JointModel
from planner.model.load import felt
from planner.model.response import simulate_joints
from planner.planning.arguments import Norm, load_of_each
from planner.planning.error_norm import error_norm, largest_step, relative_gap
from planner.planning.foot.arguments import axis_scales, joints_of
from planner.planning.foot.bound import foot_bound
from planner.planning.result import ErrorsOfModels
from planner.planning.trials import Learning
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class FootInversion:
    """Requests for all joints of a leg, with what the exact models make of them.

    Attributes:
        models: The joints, in the leg's order.
        leg: The leg.
        desired_foot: Desired foot positions in the leg's base frame [m], shape (n, 3).
        requests: What to send to the joints [rad], shape (n, k).
        cyclic: Whether the path repeats for ever.
        norm: Distance that was minimised.
        weights: Weight of each axis in that distance, shape (3,).
        limits: Smallest and largest request of each joint [rad], two arrays of shape (k,).
        max_step: Largest change allowed from one request to the next [rad], shape (k,), or None.
        smoothness: Relative rise of the error that smoother requests were allowed to cost [-].
        scenarios: All models that are judged, the nominal ones first: in each scenario one for
            each joint; () for the nominal ones alone.
        robust: Whether the "mean" or the "worst" of the errors in them was minimised; None where
            only that of the nominal models was.
        nominal: With several scenarios: the plan for the nominal models alone, to compare with.
        reachable: Which of the desired positions the leg can reach, shape (n,).
        start: From rest: angles at which the joints rest before the first request [rad], (k,).
        loads: Torque on each joint at every sample [N m], (n,), or None where none of its models
            feels it; () for none at all.
        load_of_pose: Whether that is the load of the predicted angles; there is no lower bound
            then, unless the nominal models feel no load, see :class:`planner.Inversion`.
        disturbance: What executed cycles add to the models' angles [rad], shape (n, k): see
            :func:`planner.refine`; None before any was measured.
        learning: The executed cycles that the plan has learnt from; None where there are none.
    """

    models: tuple[JointModel, ...]
    leg: Leg
    desired_foot: Array
    requests: Array
    cyclic: bool
    norm: Norm
    weights: Array
    limits: tuple[Array, Array]
    reachable: npt.NDArray[np.bool_]
    max_step: Array | None = None
    smoothness: float = 0.0
    scenarios: tuple[tuple[JointModel, ...], ...] = ()
    robust: Literal["mean", "worst"] | None = None
    nominal: FootInversion | None = None
    start: Array | None = None
    method: str = "foot_optimal"
    loads: tuple[Array | None, ...] = ()
    load_of_pose: bool = False
    disturbance: Array | None = None
    learning: Learning | None = None

    def under(self, torques: Array) -> Self:
        """The same requests under the load of a pose [N m], shape (n, k)."""
        joints = joints_of(self.leg)
        scenarios = self.scenarios or (self.models,)
        by_scenario = [
            load_of_each(torques, each, len(self.requests), joints=joints) for each in scenarios
        ]
        loads = tuple(felt(each) for each in zip(*by_scenario, strict=True))
        return replace(
            self,
            loads=loads,
            load_of_pose=any(load is not None for load in loads),
            nominal=self.nominal and self.nominal.under(torques),
        )

    @cached_property
    def predicted(self) -> Array:
        """Angles of the exact models under the requests, plus the disturbance [rad], (n, k)."""
        angles = simulate_joints(
            self.models, self.requests, cyclic=self.cyclic, starts=self.start, loads=self.loads
        )
        if self.disturbance is not None:
            angles += self.disturbance
        angles.setflags(write=False)
        return angles

    @cached_property
    def foot(self) -> Array:
        """Where the foot then is [m], shape (n, 3)."""
        return self.leg.foot_positions(self.predicted)

    @property
    def distances(self) -> Array:
        """Distance of the foot from where it should be, all axes alike [m], shape (n,)."""
        distances: Array = np.linalg.norm(self.foot - self.desired_foot, axis=1)
        return distances

    @property
    def rms(self) -> float:
        """Root mean square of the distances [m]."""
        return error_norm(self.distances, "rms")

    @property
    def max_error(self) -> float:
        """Largest distance [m]."""
        return error_norm(self.distances, "max")

    @property
    def error(self) -> float:
        """What was minimised [m]: in the plan's norm, the axes weighted, the heaviest by 1."""
        return self.error_of(self.predicted)

    def error_of(self, angles: Array) -> float:
        """The same of other angles [m]; ``angles`` [rad], shape (n, k)."""
        away = (self.leg.foot_positions(angles) - self.desired_foot) * axis_scales(self.weights)
        return error_norm(np.linalg.norm(away, axis=1), self.norm)

    @cached_property
    def errors_of_models(self) -> Array:
        """The error in each scenario [m], that of the nominal models first, (scenarios,)."""
        others = [replace(self, models=each, scenarios=()).error for each in self.scenarios[1:]]
        errors = np.array([self.error, *others])
        errors.setflags(write=False)
        return errors

    @property
    def over_models(self) -> ErrorsOfModels:
        """The nominal, the mean and the worst of them [m]."""
        return ErrorsOfModels.of(self.errors_of_models)

    @cached_property
    def lower_bound(self) -> float:
        """Lower bound on :attr:`error` for any requests within the limits [m].

        From rest it is about plans that start at ``start``. It is computed, and proved, when it is
        first asked for: some 30 ms a sample, and up to ten seconds where a path is short. There is
        none, and it is 0, where the load depends on the pose, or with a disturbance.
        """
        feels = self.load_of_pose and any(model.feels_load for model in self.models)
        if feels or self.disturbance is not None:
            return 0.0
        return foot_bound(
            self.models,
            self.leg,
            self.desired_foot,
            self.predicted,
            cyclic=self.cyclic,
            norm=self.norm,
            weights=self.weights,
            limits=self.limits,
            start=self.start,
            loads=self.loads or None,
        )

    @property
    def stopped(self) -> str:
        """Why learning from executed cycles has ended; empty while it goes on, and before it."""
        return "" if self.learning is None else self.learning.stopped

    @property
    def gap(self) -> float:
        """Relative distance of the error from the lower bound; inf where only the bound is 0."""
        return relative_gap(self.error, self.lower_bound)

    @property
    def largest_step(self) -> float:
        """Largest change from one request of a joint to its next, cycles closed [rad]."""
        return largest_step(self.requests, cyclic=self.cyclic)
