"""The joints of a plan, in columns, and what they should do: one joint, or those of a foot."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from planner.model.joint import JointModel
from planner.model.load import load_columns
from planner.model.response import simulate_joints
from planner.planning.error_norm import error_norm
from planner.planning.foot.arguments import axis_scales
from planner.planning.foot.invert import invert_foot
from planner.planning.foot.result import FootInversion
from planner.planning.optimal import invert_optimal
from planner.planning.result import Inversion
from planner.trajectory import Array
from planner.validation import freeze


class PlannedJoints(NamedTuple):
    """What a plan is for, joints in columns, whatever its type.

    Attributes:
        plan: The plan.
        models: Its joints.
        loads: Torque on each [N m], (n,), or None.
        starts: From rest: where each rests before [rad].
    """

    plan: Inversion | FootInversion
    models: tuple[JointModel, ...]
    loads: tuple[Array | None, ...]
    starts: tuple[float | None, ...]

    @classmethod
    def of(cls, plan: Inversion | FootInversion) -> PlannedJoints:
        """The task of a plan."""
        if isinstance(plan, Inversion):
            return cls(plan, (plan.model,), (plan.load,), (plan.start,))
        count = len(plan.models)
        starts = [None] * count if plan.start is None else plan.start.tolist()
        return cls(plan, plan.models, plan.loads or (None,) * count, tuple(starts))

    def with_models(self, models: tuple[JointModel, ...]) -> PlannedJoints:
        """The same task for other models of the joints."""
        if isinstance(self.plan, Inversion):
            return PlannedJoints.of(replace(self.plan, model=models[0]))
        return PlannedJoints.of(replace(self.plan, models=models))

    @property
    def desired(self) -> Array:
        """Desired angles of the joints [rad], (n, k); those nearest to the foot's path for a foot.

        They are what a file of the path would hold in place of measured angles.
        """
        plan = self.plan
        if isinstance(plan, Inversion):
            return plan.desired[:, np.newaxis]
        return plan.leg.inverse(plan.desired_foot, unreachable="clamp").angles

    @property
    def cyclic(self) -> bool:
        """Whether the requests repeat."""
        return self.plan.cyclic

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0].period

    def respond(self, requests: Array) -> Array:
        """Angles of the models, without a disturbance [rad], (n, k)."""
        return simulate_joints(
            self.models, requests, cyclic=self.cyclic, starts=self.starts, loads=self.loads
        )

    def error(self, angles: Array) -> float:
        """Error of angles (n, k) in the plan's norm: [rad], or [m] for a foot."""
        plan = self.plan
        if isinstance(plan, Inversion):
            return error_norm(angles[:, 0] - plan.desired, plan.norm)
        return plan.error_of(angles)

    def size(self, deviations: Array) -> float:
        """Error that independent deviations of the joints (k,) [rad] make, rms."""
        plan = self.plan
        if isinstance(plan, Inversion):
            return float(deviations[0])
        jacobians = plan.leg.jacobians(plan.predicted) * axis_scales(plan.weights)[:, np.newaxis]
        return float(np.sqrt(np.mean(np.sum((jacobians * deviations) ** 2, axis=(1, 2)))))

    def planned(self, disturbance: Array) -> Inversion | FootInversion:
        """The requests for which the models and the disturbance (n, k) make the least error.

        What the models were known to miss has been measured: smoothing may no longer cost as much.
        """
        plan, models = self.plan, [model.with_evidence(None) for model in self.models]
        if isinstance(plan, FootInversion):
            made = invert_foot(
                models,
                plan.leg,
                plan.desired_foot,
                cyclic=plan.cyclic,
                limits=plan.limits,
                norm=plan.norm,
                weights=plan.weights,
                load=load_columns(plan.loads, len(disturbance)),
                max_step=plan.max_step,
                smoothness=plan.smoothness,
                disturbance=disturbance,
            )
            return replace(made, models=self.models, load_of_pose=plan.load_of_pose)
        (model,), column = models, disturbance[:, 0].copy()
        freeze(column)
        options: dict[str, Any] = {} if plan.solver is None else {"solver": plan.solver}
        one = invert_optimal(
            model,
            _within_limits(plan.desired - column, plan, model),
            cyclic=plan.cyclic,
            limits=plan.limits,
            norm=plan.norm,
            start=plan.start,
            tolerance=plan.tolerance,
            load=plan.load,
            max_step=plan.max_step,
            smoothness=plan.smoothness,
            **options,
        )
        return replace(
            one,
            model=self.models[0],
            desired=plan.desired,
            disturbance=column,
            load_of_pose=plan.load_of_pose,
        )


def _within_limits(desired: Array, plan: Inversion, model: JointModel) -> Array:
    """The desired angles, shifted by a disturbance, where requests within the limits can hold."""
    if plan.limits is None:
        return desired
    lower, upper = plan.limits
    sag = model.sag(0.0 if plan.load is None else plan.load)
    clipped: Array = np.clip(desired, lower + sag, upper + sag)
    return clipped
