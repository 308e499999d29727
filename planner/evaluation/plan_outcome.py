"""A plan for any joints: predicted motion, errors, and the same for direct requests."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kinematics.leg import Leg
from planner.evaluation.metrics import RequestMotion, request_motion
from planner.model.evidence import Expectation, expectation
from planner.model.joint import JointModel
from planner.model.response import PathSpeeds, path_speeds, simulate_joints
from planner.planning.plan import ErrorsOfModels
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanOutcome:
    """A plan, with what it is to be judged by.

    Attributes:
        names: The joints.
        models: Their models.
        desired: Their desired angles [rad], shape (n, k).
        requests: What is sent to them [rad], shape (n, k).
        predicted: What they then do [rad], shape (n, k).
        cyclic: Whether the path repeats for ever.
        limits: Smallest and largest request [rad], of joints that have limits.
        bounds: What the error of a joint cannot go below [rad], of joints planned one by one.
        norm: The error that these bounds are about, "rms" or "max".
        leg: The leg whose joints these are, in its order; or None.
        foot: Where its foot should be [m], shape (n, 3), for a foot path.
        foot_given: The same before it was clamped to what the leg reaches; None where it was not.
        foot_bound: What the foot's error, in the same norm, cannot go below [m], if that is known.
        foot_gap: How far the plan is above that.
        loads: Torques on the joints for which the requests are [N m], shape (n, k); None for none.
        no_bound: Why there is no lower bound; None where there is one.
        robust: Which error over the models that joints may have was minimised, "mean" or "worst";
            None where only that of the nominal models was.
        over_models: With it, errors over these models of each joint, under its robust plan and
            under the plan for its nominal model.
        foot_over_models: The same of the foot [m], where the plan is for the foot.
    """

    names: tuple[str, ...]
    models: tuple[JointModel, ...]
    desired: Array
    requests: Array
    predicted: Array
    cyclic: bool
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    bounds: Mapping[str, float] = field(default_factory=dict)
    norm: str = "rms"
    leg: Leg | None = None
    foot: Array | None = None
    foot_given: Array | None = None
    foot_bound: float | None = None
    foot_gap: float | None = None
    loads: Array | None = None
    no_bound: str | None = None
    robust: str | None = None
    over_models: Mapping[str, tuple[ErrorsOfModels, ErrorsOfModels]] = field(default_factory=dict)
    foot_over_models: tuple[ErrorsOfModels, ErrorsOfModels] | None = None

    @cached_property
    def expected(self) -> tuple[Expectation, ...]:
        """What to expect of each joint on the robot."""
        return tuple(
            expectation(
                model.evidence,
                self.desired[:, j],
                self.predicted[:, j],
                period=self.period,
                cyclic=self.cyclic,
                load=None if self.loads is None else self.loads[:, j],
            )
            for j, model in enumerate(self.models)
        )

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0].period

    @cached_property
    def direct(self) -> Array:
        """What the joints do when the desired angles are requested as they are [rad], (n, k)."""
        return simulate_joints(self.models, self.desired, cyclic=self.cyclic, loads=self.loads)

    @cached_property
    def feet(self) -> Mapping[str, Array]:
        """Foot positions [m], (n, 3), as "desired", "direct" and "planned"; empty without a leg."""
        if self.leg is None:
            return {}
        desired = self.leg.foot_positions(self.desired) if self.foot is None else self.foot
        direct, planned = map(self.leg.foot_positions, (self.direct, self.predicted))
        return {"desired": desired, "direct": direct, "planned": planned}

    @cached_property
    def distances(self) -> Mapping[str, Array]:
        """How far the foot is from where it should be [m], (n,), as "direct" and "planned"."""
        return {
            name: np.linalg.norm(positions - self.feet["desired"], axis=1)
            for name, positions in self.feet.items()
            if name != "desired"
        }

    @cached_property
    def expected_foot(self) -> float | None:
        """Root mean square distance of the foot to expect on the robot [m]; None where unknown."""
        if self.leg is None:
            return None
        return expected_foot(
            self.leg, self.feet["desired"], self.desired, self.predicted, self.expected
        )

    @property
    def distances_given(self) -> Array:
        """How far the planned foot is from the path before it was clamped [m], shape (n,)."""
        given = self.feet["desired"] if self.foot_given is None else self.foot_given
        return np.asarray(np.linalg.norm(self.feet["planned"] - given, axis=1))

    @cached_property
    def errors(self) -> Mapping[str, Array]:
        """Actual minus desired angles [rad], (n, k), as "direct" and "planned"."""
        return {"direct": self.direct - self.desired, "planned": self.predicted - self.desired}

    @cached_property
    def speeds(self) -> tuple[PathSpeeds, ...]:
        """Speeds of every joint on the desired path, and how fast it can be."""
        loads = [None] * len(self.models) if self.loads is None else list(self.loads.T)
        return tuple(
            path_speeds(model, self.desired[:, j], cyclic=self.cyclic, load=load)
            for j, (model, load) in enumerate(zip(self.models, loads, strict=True))
        )

    @property
    def too_fast(self) -> Array:
        """Share of the desired path that is faster than the joint can be, shape (k,)."""
        return np.array([float(np.mean(each.too_fast)) for each in self.speeds])

    @property
    def motions(self) -> tuple[RequestMotion, ...]:
        """How the requests of every joint move."""
        columns = zip(self.requests.T, self.desired.T, strict=True)
        return tuple(
            request_motion(sent, desired, period=self.period, cyclic=self.cyclic)
            for sent, desired in columns
        )

    @cached_property
    def jumps(self) -> tuple[int, ...]:
        """Samples from which the desired pose leaps to another one."""
        if self.leg is None:
            return ()
        closed = np.vstack([self.desired, self.desired[:1]]) if self.cyclic else self.desired
        return tuple(self.leg.jumps(closed).tolist())


def expected_foot(
    leg: Leg, foot: Array, desired: Array, predicted: Array, expected: Sequence[Expectation]
) -> float | None:
    """Root mean square distance of the foot to expect on the robot [m]; None where unknown.

    The models' errors, as independent ones, move the foot from where the plan has it.

    Args:
        leg: The leg.
        foot: Where its foot should be [m], shape (n, 3).
        desired: The angles of its joints [rad], shape (n, k).
        predicted: What the joints do by the plan [rad], shape (n, k).
        expected: What to expect of each joint.
    """
    if not all(math.isfinite(each.error) for each in expected):
        return None
    planned = leg.foot_positions(predicted)
    squares = float(np.mean(np.sum((planned - foot) ** 2, axis=1)))
    own = np.mean((predicted - desired) ** 2, axis=0)
    for j, each in enumerate(expected):
        moved = predicted.copy()
        moved[:, j] += math.sqrt(max(each.error**2 - own[j], 0.0))
        away = leg.foot_positions(moved) - planned
        squares += float(np.mean(np.sum(away**2, axis=1)))
    return math.sqrt(squares)
