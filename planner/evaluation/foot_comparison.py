"""The cross-check in the foot's space: the plans for single joints beside the plan for all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.leg import Leg
from planner.evaluation.checks import (
    ABOVE,
    AGREEMENT,
    FOOT_ABOVE_BOUND,
    FOOT_NO_WORSE,
    INSIDE,
    WITHIN_LIMITS,
    Check,
    answer_checks,
    beyond_limits,
    check,
    kept_within,
    no_worse_checks,
    second_answer,
)
from planner.evaluation.joint_comparison import (
    METHODS,
    JointComparison,
    depend_on_motion,
    planned_methods,
)
from planner.evaluation.metrics import Distance, angle_distance
from planner.planning.arguments import Norm
from planner.planning.error_norm import error_norm, relative_gap
from planner.planning.inversion import invert_foot, planned
from planner.planning.plan import Plan, joined
from planner.planning.result import FootInversion, Inversion
from planner.planning.search import ENCODER_STEP, known_errors
from planner.planning.task import axis_scales
from planner.trajectory import Array

FOOT = "foot"
"""What checks are about that are about no single joint."""


@dataclass(frozen=True, eq=False)
class FootComparison:
    """The plans for a leg, by where they bring its foot.

    Attributes:
        desired: Where the desired angles bring the foot [m], shape (n, 3).
        plans: Plan by method, one more than for a joint; all judged by the foot.
        differences: How far each method's requests are from those for the foot, all joints [rad].
        cyclic: Whether the trajectory repeats for ever.
        norm: The error that the plan for the foot minimises, and that the bound is about.
        limits: Smallest and largest request of each joint [rad], two arrays of shape (k,).
        bound: What no requests within the limits bring the foot's error below [m]; None where a
            path is too long for it.
        checks: Every claim about the foot, held against its tolerance.
    """

    desired: Array
    plans: Mapping[str, Plan]
    differences: Mapping[str, Distance]
    cyclic: bool
    norm: Norm
    limits: tuple[Array, Array]
    bound: float | None
    checks: tuple[Check, ...]

    def gap(self, method: str) -> float | None:
        """Relative distance of a plan from the bound; None without a bound that applies to it.

        It is about requests within the limits that, from rest, set out from the same pose.
        """
        plan = self.plans[method]
        if not self.bound or beyond_limits(plan.requests, self.limits) > WITHIN_LIMITS.value:
            return None
        began = self.plans["foot_optimal"].requests[0]
        if not self.cyclic and np.any(np.abs(plan.requests[0] - began) > AGREEMENT.value):
            return None
        return relative_gap(error_norm(plan.distances, self.norm), self.bound)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, lengths in centimetres and angles in degrees."""
        best = self.plans["foot_optimal"]
        return {
            "desired_cm": (100.0 * self.desired).tolist(),
            "requests_deg": np.degrees(best.requests).tolist(),
            "norm": self.norm,
            "lower_bound_cm": None if self.bound is None else 100.0 * self.bound,
            "methods": {
                method: {
                    "gap": self.gap(method),
                    "rms_cm": 100.0 * float(plan.rms[0]),
                    "max_cm": 100.0 * float(plan.max_error[0]),
                    "request_difference_rms_deg": math.degrees(self.differences[method].rms),
                    "largest_request_difference_deg": math.degrees(self.differences[method].max),
                    "positions_cm": (100.0 * plan.foot).tolist(),
                }
                for method, plan in self.plans.items()
            },
        }


def compare_foot(
    leg: Leg,
    joints: Sequence[JointComparison],
    *,
    cyclic: bool,
    norm: Norm,
    limits: tuple[Array, Array],
) -> FootComparison:
    """Plan for the foot, and compare with the plans that were made joint by joint.

    The foot should be where the desired angles bring it.

    Args:
        leg: The leg.
        joints: Its joints, compared one by one.
        cyclic: Whether the trajectory repeats for ever.
        norm: The error to minimise.
        limits: Smallest and largest request of each joint [rad], two arrays of shape (k,).
    """
    desired = leg.foot_positions(np.column_stack([joint.desired for joint in joints]))
    plans = [joint.plans["optimal"] for joint in joints]
    torques = [np.zeros(len(desired)) if plan.load is None else plan.load for plan in plans]
    together = invert_foot(
        [plan.model for plan in plans],
        leg,
        desired,
        cyclic=cyclic,
        limits=limits,
        norm=norm,
        load=np.column_stack(torques),
    )
    return judge_foot(joints, together)


def judge_foot(joints: Sequence[JointComparison], together: FootInversion) -> FootComparison:
    """Compare a plan for the foot with plans for its joints, from any method."""
    desired = together.desired_foot
    plans = {
        method: _foot_plan(together, [joint.plans[method] for joint in joints])
        for method in planned_methods(joints)
    }
    best = together.plan
    bound = together.plan.foot_bound
    return FootComparison(
        cyclic=together.cyclic,
        norm=together.norm,
        limits=together.limits,
        bound=bound,
        desired=desired,
        plans={**plans, "foot_optimal": best},
        differences={
            method: angle_distance(plan.requests.ravel(), best.requests.ravel())
            for method, plan in {**plans, "foot_optimal": best}.items()
        },
        checks=tuple(_checks(joints, together, bound)),
    )


def _checks(
    joints: Sequence[JointComparison],
    together: FootInversion,
    bound: float | None,
) -> list[Check]:
    label = METHODS["foot_optimal"]
    norm, cyclic = together.norm, together.cyclic
    best = error_norm(together.distances, norm)
    found = []
    for column, joint in enumerate(joints):
        answer = second_answer(
            joint.model,
            together.requests[:, column],
            together.predicted[:, column],
            cyclic=cyclic,
            start=None if together.start is None else float(together.start[column]),
            load=together.loads[column] if together.loads else None,
        )
        found += answer_checks(joint.name, label, answer, cyclic=cyclic)
    excess = beyond_limits(together.requests, together.limits)
    found.append(check(FOOT, label, INSIDE, excess, WITHIN_LIMITS))
    if bound is not None:
        found.append(check(FOOT, label, ABOVE, bound - best, FOOT_ABOVE_BOUND))
    others, known = {}, _known(together, _unsmoothed(together).predicted)
    for method in planned_methods(joints):
        kept = [
            kept_within(joint.plans[method], (low, high))
            for joint, low, high in zip(joints, *together.limits, strict=True)
        ]
        usable = [plan for plan in kept if plan is not None]
        if len(usable) == len(joints):
            other = error_norm(_foot_plan(together, usable).distances, norm)
            others[METHODS[method]] = math.hypot(other, known)
    steps = np.full(len(together.models), ENCODER_STEP)
    unseen = best <= _through_leg(together, together.predicted, steps)
    shown = 0.0 if unseen else math.hypot(best, _known(together, together.predicted))
    return found + no_worse_checks(FOOT, label, shown, others, FOOT_NO_WORSE)


def _unsmoothed(together: FootInversion) -> FootInversion:
    """The best plan, whose known error counts in (12b) of ``docs/math.md``, or one with the same.

    Other plans are judged with that error too: the search minimises the plan's own.
    """
    task = together.plan.task
    if task.unsmoothed is task or not depend_on_motion(together.models):
        return together
    return FootInversion(planned(task.unsmoothed))


def _known(together: FootInversion, angles: Array) -> float:
    """What the models' known errors for a motion make of the foot's [m], (12b)."""
    known = known_errors(together.models, angles, cyclic=together.cyclic)
    return _through_leg(together, angles, known)


def _through_leg(together: FootInversion, angles: Array, errors: Array) -> float:
    """Where errors of the joints [rad], (k,), move the foot [m], rms."""
    moved = together.leg.jacobians(angles) * axis_scales(together.weights)[:, np.newaxis] * errors
    return math.sqrt(float(np.vdot(moved, moved)) / len(angles))


def _foot_plan(together: FootInversion, plans: Sequence[Inversion]) -> Plan:
    """Plans of the joints, one by one, judged by where they bring the foot, all axes alike."""
    one_by_one = joined([plan.plan.joint(plan.column) for plan in plans])
    task = replace(
        one_by_one.task,
        goal="foot",
        leg=together.leg,
        foot=together.desired_foot,
        weights=np.ones(3),
    )
    return replace(one_by_one, task=task)
