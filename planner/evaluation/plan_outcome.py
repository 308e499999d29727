"""What a plan for any joints makes of them, and what they would do without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kinematics.leg import Leg
from planner.model.joint import JointModel
from planner.model.response import simulate
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
        foot_bound: What the foot's error, in the same norm, cannot go below [m], if that is known.
        foot_gap: How far the plan is above that.
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
    foot_bound: float | None = None
    foot_gap: float | None = None

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0].period

    @cached_property
    def direct(self) -> Array:
        """What the joints do when the desired angles are requested as they are [rad], (n, k)."""
        columns = zip(self.models, self.desired.T, strict=True)
        angles = [simulate(model, column, cyclic=self.cyclic) for model, column in columns]
        return np.column_stack(angles)

    @cached_property
    def feet(self) -> Mapping[str, Array]:
        """Where the foot is [m], (n, 3), as "desired", "direct" and "planned"; nothing without."""
        if self.leg is None:
            return {}
        wanted = self.leg.foot_positions(self.desired) if self.foot is None else self.foot
        direct, planned = map(self.leg.foot_positions, (self.direct, self.predicted))
        return {"desired": wanted, "direct": direct, "planned": planned}

    @cached_property
    def distances(self) -> Mapping[str, Array]:
        """How far the foot is from where it should be [m], (n,), as "direct" and "planned"."""
        return {
            name: np.linalg.norm(positions - self.feet["desired"], axis=1)
            for name, positions in self.feet.items()
            if name != "desired"
        }

    @property
    def errors(self) -> Mapping[str, Array]:
        """Actual minus desired angles [rad], (n, k), as "direct" and "planned"."""
        return {"direct": self.direct - self.desired, "planned": self.predicted - self.desired}

    @cached_property
    def speeds(self) -> Array:
        """Largest speed of every joint on the desired path [rad/s], shape (k,)."""
        return np.asarray(np.abs(self._steps(self.desired)).max(axis=0) / self.period)

    @cached_property
    def too_fast(self) -> Array:
        """Share of the desired path that is faster than the joint's top speed, shape (k,)."""
        top = np.array([model.v_max for model in self.models])
        return np.asarray((np.abs(self._steps(self.desired)) > top * self.period).mean(axis=0))

    @cached_property
    def jumps(self) -> tuple[int, ...]:
        """Samples from which the desired pose leaps to another one."""
        if self.leg is None:
            return ()
        closed = np.vstack([self.desired, self.desired[:1]]) if self.cyclic else self.desired
        return tuple(self.leg.jumps(closed).tolist())

    def _steps(self, angles: Array) -> Array:
        """Steps from sample to sample, that from the last to the first included in a cycle."""
        following = np.roll(angles, -1, axis=0) - angles
        return following if self.cyclic else following[:-1]
