"""The plans for one joint side by side, with their bounds, differences and checks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.evaluation.checks import (
    AS_GOOD,
    FOLLOWED,
    INSIDE,
    NO_WORSE,
    SOLVED,
    SOLVES,
    STATED,
    WITHIN_LIMITS,
    Answer,
    Check,
    answer_checks,
    beyond_limits,
    bound_checks,
    check,
    kept_within,
    no_worse_checks,
    second_answer,
)
from planner.evaluation.differences import Difference, difference
from planner.model.joint import JointModel
from planner.planning.bounds.certify import Certificate, certify
from planner.planning.bounds.cvxpy_statement import stated_bound
from planner.planning.bounds.reachable_set import LEVELS, BoundProblem, Level
from planner.planning.error_norm import relative_gap
from planner.planning.inversion import planned
from planner.planning.result import Inversion
from planner.planning.search import ENCODER_STEP, known_errors
from planner.trajectory import Array

METHODS: Mapping[str, str] = {
    "closed_form_paper": "closed form, paper's rule",
    "closed_form_exact": "closed form, exact rule",
    "optimal": "optimised",
    "optimal_ipopt": "optimised by IPOPT",
    "foot_optimal": "optimised for the foot",
}
"""The plans that are compared, by key, and what to call them."""

CLOSED_FORMS = ("closed_form_paper", "closed_form_exact")
"""Those of them that know no limits, and that the optimised requests are held against."""


@dataclass(frozen=True, eq=False)
class JointComparison:
    """The plans for one joint, side by side.

    Attributes:
        name: The joint.
        plans: Plan by method; all share the model and the desired angles.
        certificates: Bounds on the error of any plan in the plans' norm, by level proved.
        answers: What an independent simulation says, by method.
        differences: How the requests of each closed form differ from the optimised ones.
        checks: Every claim about these plans, held against its tolerance.
    """

    name: str
    plans: Mapping[str, Inversion]
    certificates: Mapping[Level, Certificate]
    answers: Mapping[str, Answer]
    differences: Mapping[str, Difference]
    checks: tuple[Check, ...]

    @property
    def model(self) -> JointModel:
        """The joint's model."""
        return self.plans["optimal"].model

    @property
    def desired(self) -> Array:
        """The desired angles [rad], shape (n,)."""
        return self.plans["optimal"].desired

    @property
    def bounds(self) -> dict[Level, float]:
        """Lower bounds on the error in the plans' norm, by level [rad]."""
        return {level: proof.bound for level, proof in self.certificates.items()}

    @property
    def bound(self) -> float:
        """The sharpest bound [rad]."""
        return max(self.bounds.values())

    def gap(self, method: str) -> float:
        """Relative distance of a plan from the sharpest bound; inf where only that is zero."""
        return relative_gap(self.plans[method].error, self.bound)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, angles in degrees."""
        finest = max(self.bounds, key=lambda level: self.bounds[level])
        return {
            "model": self.model.parameters(),
            "limits_deg": _limits(self.plans["optimal"].limits),
            "desired_deg": _degrees(self.desired),
            "lower_bound_deg": math.degrees(self.bounds[finest]),
            "bounds_deg": {level: math.degrees(each) for level, each in self.bounds.items()},
            "solver_gaps": {
                level: _finite(proof.solver_gap) for level, proof in self.certificates.items()
            },
            "methods": {method: self._plan(method) for method in self.plans},
            "differences": {method: each.to_dict() for method, each in self.differences.items()},
        }

    def _plan(self, method: str) -> dict[str, Any]:
        plan, answer = self.plans[method], self.answers[method]
        apart = np.abs(plan.requests - self.plans["optimal"].requests)
        return {
            "rms_deg": math.degrees(plan.rms),
            "max_deg": math.degrees(plan.max_error),
            "expected_rms_deg": _finite(math.degrees(plan.expected.error)),
            "untested": list(plan.expected.untested),
            "gap": _finite(self.gap(method)),
            "largest_request_difference_deg": math.degrees(float(np.max(apart))),
            "largest_step_deg": math.degrees(plan.largest_step),
            "beyond_desired_deg": math.degrees(plan.excess),
            "agreement_rad": answer.agreement,
            "other_cycle_deg": math.degrees(answer.elsewhere),
            "requests_deg": _degrees(plan.requests),
            "predicted_deg": _degrees(plan.predicted),
        }


def compare_joint(
    name: str,
    plans: Mapping[str, Inversion],
    *,
    levels: Sequence[Level] = LEVELS[:2],
    failed: Sequence[str] = (),
) -> JointComparison:
    """Compare plans for one joint, from any method, and check them.

    Args:
        name: The joint.
        plans: A plan for each method of one joint, all for the same desired angles.
        levels: The bounds to compute; of a joint with friction or inertia those that hold.
        failed: Methods that found no plan.
    """
    optimal = plans["optimal"]
    cyclic, limits = optimal.cyclic, optimal.limits
    proved = (
        certify(
            optimal.model,
            optimal.desired,
            cyclic=cyclic,
            norm=optimal.norm,
            level=level,
            start=optimal.start,
            load=optimal.load,
        )
        for level in levels
    )
    certificates = {proof.level: proof for proof in proved}
    bounds = {level: proof.bound for level, proof in certificates.items()}
    answers = {
        method: second_answer(
            plan.model,
            plan.requests,
            plan.predicted,
            cyclic=cyclic,
            start=plan.start,
            load=plan.load,
        )
        for method, plan in plans.items()
    }
    closed_forms = {method: plan for method, plan in plans.items() if method in CLOSED_FORMS}
    checks: list[Check] = []
    for method, answer in answers.items():
        checks += answer_checks(name, METHODS[method], answer, cyclic=cyclic)
    others, known = {}, _known(_unsmoothed(optimal))
    for method, plan in closed_forms.items():
        kept = kept_within(plan, limits)
        if kept is not None:
            others[METHODS[method]] = math.hypot(kept.error, known)
    rests = optimal.model.dead_band > 0.0 and optimal.error <= ENCODER_STEP
    shown = 0.0 if rests else math.hypot(optimal.error, _known(optimal))
    checks += no_worse_checks(name, METHODS["optimal"], shown, others, NO_WORSE)
    errors = {METHODS[method]: plan.error for method, plan in plans.items()}
    checks += bound_checks(name, bounds, errors)
    problem = BoundProblem(
        optimal.model, optimal.desired, cyclic, optimal.norm, optimal.start, optimal.load
    )
    for level in bounds:
        if level != "exact":
            apart = abs(bounds[level] - stated_bound(problem, level))
            checks.append(check(name, "", f"{level} bound agrees with CVXPY's", apart, STATED))
    checks += [check(name, METHODS[method], SOLVED, 1.0, SOLVES) for method in failed]
    if "optimal_ipopt" in plans:
        checks += _as_good_checks(name, shown, math.hypot(plans["optimal_ipopt"].error, known))
    if limits is not None:
        for method, plan in plans.items():
            if method not in CLOSED_FORMS:
                excess = beyond_limits(plan.requests, limits)
                checks.append(check(name, METHODS[method], INSIDE, excess, WITHIN_LIMITS))
    return JointComparison(
        name=name,
        plans=plans,
        certificates=certificates,
        answers=answers,
        differences={method: difference(plan, optimal) for method, plan in closed_forms.items()},
        checks=tuple(checks),
    )


def planned_methods(joints: Sequence[JointComparison]) -> list[str]:
    """The methods by which every joint is planned."""
    return [method for method in METHODS if all(method in joint.plans for joint in joints)]


def depend_on_motion(models: Sequence[JointModel]) -> bool:
    """Whether some of the models' known errors differ from motion to motion."""
    return any(model.evidence and model.evidence.depends_on_motion for model in models)


def _unsmoothed(plan: Inversion) -> Inversion:
    """The best plan, whose known error counts in (12b) of ``docs/math.md``, or one with the same.

    Other plans are judged with that error too: the search minimises the plan's own.
    """
    task = plan.plan.joint(plan.column).task
    if task.unsmoothed is task or not depend_on_motion([plan.model]):
        return plan
    return Inversion(planned(task.unsmoothed))


def _known(plan: Inversion) -> float:
    """The known error of the model for the plan's motion [rad], (12b) of ``docs/math.md``."""
    angles = plan.predicted[:, np.newaxis]
    return float(known_errors((plan.model,), angles, cyclic=plan.cyclic)[0])


def _as_good_checks(name: str, optimal: float, second: float) -> list[Check]:
    """That the error of the optimised requests [rad] is that of CasADi's solver, or less."""
    excess = optimal - second
    relative = 0.0 if excess <= FOLLOWED else excess / optimal
    label = METHODS["optimal_ipopt"]
    return [
        check(name, label, SOLVED, 0.0, SOLVES),
        check(name, METHODS["optimal"], "as good as IPOPT's", relative, AS_GOOD),
    ]


def _degrees(angles: Array) -> list[float]:
    degrees: list[float] = np.degrees(angles).tolist()
    return degrees


def _limits(limits: tuple[float, float] | None) -> list[float | None] | None:
    return None if limits is None else [_finite(math.degrees(limit)) for limit in limits]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
