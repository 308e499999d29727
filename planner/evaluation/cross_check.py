"""The cross-check: closed form, our optimiser and CasADi's, each compared with the others.

Plans of a joint are compared by its angles, those of a leg by the positions of its foot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from planner.arrays import (
    Array,
    Distance,
    Summarised,
    Summary,
    as_rows,
    check_choice,
    error_norm,
    finite,
    relative_gap,
    rms,
    shown,
    size,
)
from planner.evaluation.checks import (
    CLAIMS,
    FOLLOWED,
    SHARE,
    Answer,
    Check,
    Claim,
    answer_checks,
    beyond_limits,
    bound_checks,
    kept_within,
    second_answer,
)
from planner.exceptions import InvalidInput, SolverFailed, about
from planner.model.evidence import ENCODER_STEP
from planner.model.joint import JointModel
from planner.planning.bounds.certify import Certificate, certified
from planner.planning.bounds.cvxpy_statement import stated_bound
from planner.planning.bounds.reachable_set import LEVELS, Level
from planner.planning.inversion import invert_foot, planned
from planner.planning.line_inverse import RULES
from planner.planning.plan import FootInversion, Inversion, Plan
from planner.planning.search import known_errors
from planner.planning.task import Norm, Task, checked_leg

# The compared plans: label by key.
METHODS: Mapping[str, str] = {
    "closed_form_paper": "closed form, paper's rule",
    "closed_form_exact": "closed form, exact rule",
    "optimal": "optimised",
    "optimal_ipopt": "optimised by IPOPT",
    "foot_optimal": "optimised for the foot",
}
CLOSED_FORMS = ("closed_form_paper", "closed_form_exact")  # the plans that ignore limits
SECOND = "optimal_ipopt"  # the plan of CasADi's solver, a second opinion on the optimised one
FOOT = "foot"  # subject of checks of all joints together


@dataclass(frozen=True, eq=False, repr=False)
class CrossCheck(Summarised):
    """Closed form against optimised inversion, with a verdict.

    Attributes:
        joints: Every joint.
        foot: The foot, where a leg was given.
    """

    joints: tuple[JointComparison, ...]
    foot: FootComparison | None

    def _summarised(self) -> Summary:
        """The verdict, and the error of every plan of each joint."""
        methods = self.methods
        rows = list[list[str]]()
        for joint in self.joints:
            values = [*(joint.plans[method].error for method in methods), joint.bound]
            rows.append([joint.name, *(f"{np.degrees(value):.4g}" for value in values)])
        held = len(self.checks) - len(self.failures)
        return Summary(
            f"Cross-check: {held} of {len(self.checks)} checks hold; {self.norm} errors [deg]",
            ("", *methods, "lower bound"),
            rows,
        )

    @property
    def cyclic(self) -> bool:
        """Whether the trajectory repeats for ever."""
        return self.joints[0].plans["optimal"].cyclic

    @property
    def norm(self) -> Norm:
        """The error that was minimised."""
        return self.joints[0].plans["optimal"].norm

    @property
    def methods(self) -> list[str]:
        """The methods by which every joint is planned."""
        return planned_methods(self.joints)

    @property
    def checks(self) -> tuple[Check, ...]:
        """Every check."""
        of_joints = tuple(check for joint in self.joints for check in joint.checks)
        return of_joints if self.foot is None else of_joints + self.foot.checks

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that do not hold."""
        return tuple(check for check in self.checks if not check.passed)

    @property
    def passed(self) -> bool:
        """Whether every check holds."""
        return not self.failures

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.joints[0].model.period

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, with all that is needed to compute them again.

        Angles are in degrees and lengths in centimetres, as the keys say; a figure that is not
        finite becomes None.
        """
        return {
            "passed": self.passed,
            "cyclic": self.cyclic,
            "norm": self.norm,
            "period_s": self.period,
            "joints": {joint.name: joint.to_dict() for joint in self.joints},
            "foot": None if self.foot is None else self.foot.to_dict(),
            "checks": [check.to_dict() for check in self.checks],
        }


def cross_check(
    model: JointModel | Sequence[JointModel],
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    segments: int | None = None,
    leg: Leg | None = None,
    norm: Norm = "rms",
    level: Level = "envelope",
    names: Sequence[str] | None = None,
    load: npt.ArrayLike | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> CrossCheck:
    """Plan by the closed form, by our own optimiser and by CasADi with IPOPT, and judge the plans.

    Each plan's predicted angles are compared with an independent simulation, the optimised plan
    against the closed forms, with both of their rules, and against IPOPT's, all of them against
    lower bounds; where the requests differ, the answer gives the reason.

    Args:
        model: One joint model for all joints, or one for each.
        desired: Desired angles [rad], shape (n,) or (n, k), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever, or starts from rest at its first sample.
        limits: Smallest and largest request allowed [rad], each a number or shape (k,); by default
            those of the leg, if there is one.
        segments: Number of lines of the closed form; chosen automatically where not given.
        leg: A leg whose joints these are: then the foot is compared too, and a plan for all joints
            at once (:func:`planner.invert_foot`) with the others.
        norm: "rms" or "max": the error that the optimised plans minimise and the bounds are about.
        level: The sharpest bound to compute; those before it are computed too.
        names: Names of the joints; by default those of the leg.
        load: Torque on the joints in the direction of positive angles [N m], a number, shape (k,)
            for each joint's, or (n, k), at the samples; see :func:`planner.simulate`.
        progress: Called with the name of each joint before it is compared, and with ``"foot"``.

    Returns:
        Plans, bounds, differences and the verdict, ``.passed``.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) or (n, k) with n >= 3.
        InvalidInput: The models, names, limits, the load or the leg do not fit the joints, or the
            level is not known for one of them.
        Infeasible: The limits exclude each other, or a desired angle.
        SolverFailed: A plan or a bound was not found. A plan that IPOPT does not find is missing,
            and fails a check instead.

    Example:
        >>> import numpy as np
        >>> desired = 0.5 * np.sin(2 * np.pi * np.arange(40) / 40)  # [rad], every 8 ms
        >>> check = cross_check(JointModel.ers210a(), desired, level="slope")
        >>> check.passed, check.methods
        (True, ['closed_form_paper', 'closed_form_exact', 'optimal', 'optimal_ipopt'])
    """
    if not callable(progress):
        raise InvalidInput(f"progress: got {shown(progress)}, expected a function")
    check_choice("level", level, LEVELS)
    levels = LEVELS[: LEVELS.index(level) + 1]
    if leg is not None:
        names_of_leg = checked_leg(leg).joint_names
        count = as_rows(desired, name="desired").shape[1]
        if len(names_of_leg) != count:
            each = f"{len(names_of_leg)}, one for each joint of the leg ({', '.join(names_of_leg)})"
            raise InvalidInput(f"desired: got {count} columns, expected {each}")
    task = Task.of(
        model,
        desired,
        names=leg.joint_names if names is None and leg is not None else names,
        cyclic=cyclic,
        norm=norm,
        limits=leg.limits if limits is None and leg is not None else limits,
        load=load,
    )
    if len(task.scenarios) > 1:
        raise InvalidInput("model: got several of a joint, expected one of each")
    joints = []
    for j, name in enumerate(task.names):
        progress(name)
        with about(name):
            plans = _plans(task.joint(j), segments)
            failed = () if SECOND in plans else (SECOND,)
        joints.append(compare_joint(name, plans, levels=levels, failed=failed))
    foot = None
    if leg is not None:
        progress("foot")
        together = invert_foot(
            task.nominal,
            leg,
            leg.foot_positions(task.desired),
            cyclic=cyclic,
            limits=(task.lower, task.upper),
            norm=norm,
            load=task.load,
        )
        foot = judge_foot(joints, together)
    return CrossCheck(joints=tuple(joints), foot=foot)


def _plans(task: Task, segments: int | None) -> dict[str, Inversion]:
    """The plans for a joint by all methods; one that a solver does not find is missing."""
    plans = {
        f"closed_form_{rule}": planned(
            task, method="closed_form", lines={"rule": rule, "segments": segments}
        )
        for rule in RULES
    }
    plans["optimal"] = planned(task)
    with suppress(SolverFailed):  # costs its plan and a check, not the comparison of the others
        plans[SECOND] = planned(task, solver="ipopt")
    return {method: Inversion(plan) for method, plan in plans.items()}


@dataclass(frozen=True, eq=False)
class JointComparison:
    """The plans for one joint, side by side.

    Attributes:
        name: The joint.
        plans: Plan by method; all share the model and the desired angles.
        certificates: Bounds on the error of any plan in the plans' norm, by level proved.
        answers: Results of an independent simulation, by method.
        checks: Every claim about these plans, with its tolerance.
    """

    name: str
    plans: Mapping[str, Inversion]
    certificates: Mapping[Level, Certificate]
    answers: Mapping[str, Answer]
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

    @property
    def limits(self) -> tuple[float, float] | None:
        """Smallest and largest request of the plans that keep them [rad]; None without limits."""
        optimal = self.plans["optimal"]
        return optimal.plan.task.limits[optimal.column]

    def gap(self, method: str) -> float:
        """Relative distance of a plan from the bound; inf if that is at most 10 % of its error."""
        return relative_gap(self.plans[method].error, self.bound)

    def difference(self, method: str) -> Array:
        """A plan's requests less the optimised ones [rad], shape (n,)."""
        return self.plans[method].requests - self.plans["optimal"].requests

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, angles in degrees."""
        limits = self.limits and [finite(math.degrees(limit)) for limit in self.limits]
        return {
            "model": self.model.parameters(),
            "limits_deg": limits,
            "desired_deg": np.degrees(self.desired).tolist(),
            "lower_bound_deg": math.degrees(self.bound),
            "bounds_deg": {level: math.degrees(each) for level, each in self.bounds.items()},
            "solver_gaps": {
                level: finite(proof.solver_gap) for level, proof in self.certificates.items()
            },
            "methods": {
                method: {
                    **self.numbers(method),
                    "requests_deg": np.degrees(plan.requests).tolist(),
                    "predicted_deg": np.degrees(plan.predicted).tolist(),
                }
                for method, plan in self.plans.items()
            },
        }

    def numbers(self, method: str) -> dict[str, Any]:
        """The figures of a plan, angles in degrees; one that is not finite is None."""
        plan, apart = self.plans[method], self.difference(method)
        return {
            "rms_deg": math.degrees(plan.rms),
            "max_deg": math.degrees(plan.max_error),
            "expected_rms_deg": finite(math.degrees(plan.expected.error)),
            "untested": list(plan.expected.untested),
            "gap": finite(self.gap(method)),
            "request_difference_rms_deg": math.degrees(rms(apart)),
            "largest_request_difference_deg": math.degrees(float(np.max(np.abs(apart)))),
            "largest_step_deg": math.degrees(plan.largest_step),
            "beyond_desired_deg": math.degrees(plan.excess),
            "agreement_deg": math.degrees(self.answers[method].agreement),
        }


def compare_joint(
    name: str,
    plans: Mapping[str, Inversion],
    *,
    levels: Sequence[Level] = LEVELS[:2],
    failed: Sequence[str] = (),
) -> JointComparison:
    """Compare plans of any method for one joint, by bounds of these levels, and check them."""
    optimal = plans["optimal"]
    task, j = optimal.plan.task, optimal.column
    joint, limits = task.joint(j), task.limits[j]
    proved = (certified(joint, level) for level in levels)
    certificates = {proof.level: proof for proof in proved}
    bounds = {level: proof.bound for level, proof in certificates.items()}
    answers = {method: second_answer(plan.plan, plan.column) for method, plan in plans.items()}
    errors = {METHODS[method]: plan.error for method, plan in plans.items()}
    checks = list[Check]()
    for method, answer in answers.items():
        checks += answer_checks(name, METHODS[method], answer, cyclic=optimal.cyclic)
    rivals = {
        METHODS[method]: clipped.error
        for method, plan in plans.items()
        if method in CLOSED_FORMS and (clipped := kept_within(plan, limits)) is not None
    }
    checks += no_worse_checks(name, optimal.plan, optimal.error, rivals, CLAIMS["no_worse"])
    checks += bound_checks(name, bounds, errors)
    for level in bounds:
        if level != "exact" and not optimal.model.exceeds_v_max:
            apart = bounds[level] - stated_bound(joint, level)
            # With a sag by the pose the statement has fewer conditions.
            apart = max(-apart, 0.0) if optimal.model.most_pose_sag else abs(apart)
            checks.append(Check(name, "", CLAIMS["stated"].of(level), apart))
    checks += [Check(name, METHODS[method], CLAIMS["solved"], 1.0) for method in failed]
    if SECOND in plans:
        shown, other = errors_shown(optimal.plan, optimal.error, [plans[SECOND].error])
        relative = 0.0 if shown - other <= FOLLOWED else (shown - other) / shown
        checks += [
            Check(name, METHODS[SECOND], CLAIMS["solved"], 0.0),
            Check(name, METHODS["optimal"], CLAIMS["as_good"], relative),
        ]
    for method, plan in plans.items():
        if limits is not None and method not in CLOSED_FORMS:
            excess = beyond_limits(plan.requests, limits)
            checks.append(Check(name, METHODS[method], CLAIMS["inside"], excess))
    return JointComparison(name, plans, certificates, answers, tuple(checks))


def no_worse_checks(
    subject: str, plan: Plan, error: float, rivals: Mapping[str, float], claim: Claim
) -> list[Check]:
    """That a plan's error is no larger than those of its rivals, as a robot shows them."""
    shown, *others = errors_shown(plan, error, list(rivals.values()))
    return [
        Check(subject, METHODS[plan.method], claim.of(rival, SHARE * other), shown - other)
        for rival, other in zip(rivals, others, strict=True)
    ]


def errors_shown(plan: Plan, error: float, rivals: Sequence[float]) -> list[float]:
    """The errors of a plan and of others for its task that a robot may show: (12b) of the maths.

    Those of the models are added: to the others that of the best plan, as the search minimises the
    plan's own. 0 is that of a plan whose error no encoder sees, if many plans do.
    """
    best = plan.task.unsmoothed
    evidence = [model.evidence for model in plan.models]
    smoothed = best is not plan.task and any(e and e.depends_on_motion for e in evidence)
    by_models, of_best = (
        each.task.error_made_by(
            known_errors(each.models, each.predicted, cyclic=each.cyclic), each.predicted
        )
        for each in (plan, planned(best) if smoothed else plan)
    )
    shown = math.hypot(error, by_models)
    if plan.task.goal == "foot" or any(model.dead_band for model in plan.models):
        unseen = np.full(len(plan.models), ENCODER_STEP)
        shown = 0.0 if error <= plan.task.error_made_by(unseen, plan.predicted) else shown
    return [shown, *(math.hypot(each, of_best) for each in rivals)]


def planned_methods(joints: Sequence[JointComparison]) -> list[str]:
    """The methods by which every joint is planned."""
    return [method for method in METHODS if all(method in joint.plans for joint in joints)]


@dataclass(frozen=True, eq=False)
class FootComparison:
    """The plans for a leg, by where they bring its foot.

    Attributes:
        plans: Plan by method, one more than for a joint; all judged by the foot.
        checks: Every claim about the foot, with its tolerance.
    """

    plans: Mapping[str, Plan]
    checks: tuple[Check, ...]

    @property
    def best(self) -> Plan:
        """The plan for all joints at once."""
        return self.plans["foot_optimal"]

    @property
    def differences(self) -> dict[str, Distance]:
        """How far each method's requests are from those for the foot, all joints [rad]."""
        best = self.best.requests.ravel()
        return {method: size(plan.requests.ravel() - best) for method, plan in self.plans.items()}

    def gap(self, method: str) -> float | None:
        """Relative distance of a plan from the bound; None without a bound that applies to it.

        It is about requests within the limits that, from rest, set out from the same pose.
        """
        plan, task, bound = self.plans[method], self.best.task, self.best.foot_bound
        beyond = beyond_limits(plan.requests, (task.lower, task.upper))
        if not bound or beyond > CLAIMS["inside"].tolerance:
            return None
        began = self.best.requests[0]
        if not task.cyclic and np.any(
            np.abs(plan.requests[0] - began) > CLAIMS["agrees"].tolerance
        ):
            return None
        return relative_gap(error_norm(plan.distances, task.norm), bound)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, lengths in centimetres and angles in degrees."""
        pairs = zip(self.plans.items(), self.differences.values(), strict=True)
        task, bound = self.best.task, self.best.foot_bound
        return {
            "desired_cm": (100.0 * task.desired_foot).tolist(),
            "requests_deg": np.degrees(self.best.requests).tolist(),
            "norm": task.norm,
            "lower_bound_cm": None if bound is None else 100.0 * bound,
            "methods": {
                method: {
                    "gap": self.gap(method),
                    "rms_cm": 100.0 * float(plan.rms[0]),
                    "max_cm": 100.0 * float(plan.max_error[0]),
                    "request_difference_rms_deg": math.degrees(apart.rms),
                    "largest_request_difference_deg": math.degrees(apart.max),
                    "positions_cm": (100.0 * plan.foot).tolist(),
                }
                for (method, plan), apart in pairs
            },
        }


def judge_foot(joints: Sequence[JointComparison], together: FootInversion) -> FootComparison:
    """Compare a plan for the foot with plans for its joints, from any method."""
    best, norm, label = together.plan, together.norm, METHODS["foot_optimal"]
    plans, rivals, checks = {}, {}, list[Check]()
    for column, joint in enumerate(joints):
        answer = second_answer(best, column)
        checks += answer_checks(joint.name, label, answer, cyclic=best.cyclic)
    limits = best.task.lower, best.task.upper
    checks.append(Check(FOOT, label, CLAIMS["inside"], beyond_limits(best.requests, limits)))
    error = error_norm(best.distances, norm)
    if best.foot_bound is not None:
        checks.append(Check(FOOT, label, CLAIMS["foot_above"], best.foot_bound - error))
    for method in planned_methods(joints):
        single = [joint.plans[method] for joint in joints]
        plans[method] = _foot_plan(best, single)
        each_within = zip(single, zip(*limits, strict=True), strict=True)
        usable = [plan for each in each_within if (plan := kept_within(*each)) is not None]
        if len(usable) == len(joints):
            rivals[METHODS[method]] = error_norm(_foot_plan(best, usable).distances, norm)
    checks += no_worse_checks(FOOT, best, error, rivals, CLAIMS["foot_no_worse"])
    return FootComparison({**plans, "foot_optimal": best}, tuple(checks))


def _foot_plan(together: Plan, plans: Sequence[Inversion]) -> Plan:
    """Plans of the joints, one by one, judged by where they bring the foot, all axes alike."""
    starts = [plan.plan.task.starts[plan.column] for plan in plans]
    start = None if together.cyclic else np.array(starts)
    task = replace(together.task, start=start, weights=np.ones(3))
    requests = np.column_stack([plan.requests for plan in plans])
    return replace(together, task=task, requests=requests)
