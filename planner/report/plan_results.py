"""A plan in numbers for machines, and as text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.model.evidence import OPEN_TOP_SPEED
from planner.model.joint import JointModel
from planner.planning.plan import Plan
from planner.planning.result import FootInversion, Inversion
from planner.planning.task import NORMS
from planner.planning.time_shift import (
    CLEARLY,
    has_refused,
    refining_recommended,
    shift_recommended,
    shifted,
)
from planner.report.plan_page import (
    advice,
    bound_title,
    expected_words,
    feet_table,
    models_errors_table,
    motions_of,
    no_bound,
    open_top_speeds,
    size,
    too_fast,
)
from planner.report.table import NOTHING, Column, Row, Table, percent
from planner.trajectory import Array, error_norm, rms

if TYPE_CHECKING:
    from kinematics import Leg


def plan_results(
    plan: Plan,
    units: Sequence[str],
    *,
    method: str,
    legs: Mapping[str, Leg],
    of_foot: bool,
    unreachable: int,
    robust: str | None,
    kept: bool | None,
) -> dict[str, Any]:
    """A plan for machines; fields that a plan for the foot does not have are null.

    Args:
        plan: The plan.
        units: Of each joint, "deg" or "percent".
        method: The method as the user names it.
        legs: The legs of a whole robot, by name.
        of_foot: Whether the path is that of a foot.
        unreachable: Samples out of the leg's reach.
        robust: Which error over several models was made small.
        kept: Whether the plan keeps the tolerances; None without any.
    """
    task = plan.task
    joints, shift = {}, shifted(task)
    for j, (name, unit) in enumerate(zip(plan.names, units, strict=True)):
        inversion = plan.inversions[j] if plan.inversions else None
        ends = np.degrees([plan.expected[j].low, plan.expected[j].high]).tolist()
        motion = plan.motions[j]
        joints[name] = {
            **errors_results(np.degrees(plan.errors[:, j]), unit),
            "norm": inversion and inversion.norm,
            "solver": inversion and inversion.solver,
            f"expected_rms_{unit}": math.degrees(plan.expected[j].error),
            f"expected_range_{unit}": ends if np.isfinite(ends).all() else None,
            "untested": list(plan.expected[j].untested),
            f"lower_bound_{unit}": inversion and float(np.degrees(inversion.lower_bound)),
            "gap": inversion and inversion.gap,
            "over_models": inversion and _over_models(inversion, unit, math.degrees(1.0)),
            "best_shift": {
                "lead_s": shift.leads[j],
                f"rms_{unit}": float(np.degrees(rms(shift.errors[:, j]))),
                f"expected_rms_{unit}": math.degrees(shift.expected[j].error),
            },
            **verdict_results(plan.models[j]),
            f"largest_step_{unit}": math.degrees(motion.largest_step),
            "reversals_per_s": motion.reversals_per_s,
            f"path_length_{unit}": math.degrees(motion.path_length),
            f"desired_path_length_{unit}": math.degrees(motion.desired_length),
            f"beyond_desired_{unit}": math.degrees(motion.beyond),
            f"requests_{unit}": np.degrees(plan.requests[:, j]).tolist(),
            f"predicted_{unit}": np.degrees(plan.predicted[:, j]).tolist(),
            **({} if task.load is None else {"load_Nm": task.load[:, j].tolist()}),
        }
    foot = None
    if of_foot:
        bound, foot_inversion = plan.foot_bound, plan.of_foot
        foot = {
            **errors_results(100.0 * plan.distances, "cm"),
            "expected_rms_cm": plan.expected_foot and 100.0 * plan.expected_foot,
            "norm": foot_inversion and foot_inversion.norm,
            "best_shift": {
                "rms_cm": 100.0 * rms(shift.distances),
                "expected_rms_cm": shift.expected_foot and 100.0 * shift.expected_foot,
            },
            "lower_bound_cm": None if bound is None else 100.0 * bound,
            "gap": None if bound is None else foot_inversion and foot_inversion.gap,
            "over_models": foot_inversion and _over_models(foot_inversion, "cm", 100.0),
            "predicted_m": plan.foot.tolist(),
        }
    feet = {}
    for name, leg in legs.items():
        part = plan.of_leg(leg)
        leg_shift = shifted(part.task)
        feet[name] = {
            **errors_results(100.0 * part.distances, "cm"),
            "expected_rms_cm": part.expected_foot and 100.0 * part.expected_foot,
            "without_plan_rms_cm": 100.0 * rms(part.direct_distances),
            "best_shift_rms_cm": 100.0 * rms(leg_shift.distances),
        }
    recommended = "shift" if shift_recommended(plan, shift) else method
    step = float(np.min(task.max_step))
    return {
        "method": method,
        "recommended_method": None if has_refused(plan) else recommended,
        "refining_recommended": bool(refining_recommended(plan, shift)),
        "cyclic": plan.cyclic,
        "period_s": plan.period,
        "robust": robust,
        "max_step_deg": None if math.isinf(step) else math.degrees(step),
        "unreachable_samples": unreachable,
        "lower_bound_withdrawn": no_bound(plan) or None,
        "joints": joints,
        "foot": foot,
        **({"legs": feet} if legs else {}),
        "within_tolerance": kept,
    }


def _over_models(
    inversion: Inversion | FootInversion, unit: str, factor: float
) -> dict[str, Any] | None:
    """Errors over the drawn models, for machines; None without drawn models."""
    if inversion.nominal is None:
        return None
    return {
        name: {
            **{f"{which}_{unit}": factor * e for which, e in plan.over_models._asdict().items()},
            f"of_each_{unit}": (factor * plan.errors_of_models).tolist(),
        }
        for name, plan in (("robust_plan", inversion), ("nominal_plan", inversion.nominal))
    }


def verdict_results(model: JointModel) -> dict[str, str]:
    """The verdict on a model and its reason, for machines; empty if unknown."""
    evidence = model.evidence
    if evidence is None or evidence.verdict is None:
        return {}
    return {"verdict": evidence.verdict, "verdict_reason": evidence.reason}


def errors_results(errors: Array, unit: str, factor: float = 1.0) -> dict[str, float]:
    """Root mean square and largest of some errors, times a factor, for machines."""
    return {
        f"rms_{unit}": factor * error_norm(errors, "rms"),
        f"max_{unit}": factor * error_norm(errors, "max"),
    }


def against_tolerances(
    plan: Plan, units: Sequence[str], *, degrees: float | None, centimetres: float | None
) -> tuple[list[str], list[str]]:
    """Tolerances that a plan misses, in its norm, and those that it keeps by the models alone.

    The latter are of errors to expect on the robot, which are root mean squares.
    """
    missed, doubted, norm = [], [], plan.task.norm
    judged: list[tuple[str, str, float, float, float, str]] = []
    if degrees is not None:
        for name, unit, each in zip(plan.names, units, plan.inversions, strict=False):
            error, least, robot = np.degrees([each.error, each.lower_bound, each.expected.error])
            bound = f"; the lower bound for any requests is {least:.4g}"
            known = least > 0.0 and not plan.task.load_of_pose
            judged.append((name, unit, error, robot, degrees, bound if known else ""))
    if centimetres is not None:
        error, robot = error_norm(100.0 * plan.distances, norm), plan.expected_foot
        robot = math.nan if robot is None else 100.0 * robot
        judged.append(("the foot", "cm", error, robot, centimetres, ""))
    for subject, unit, error, robot, most, bound in judged:
        if error > most:
            missed.append(off_by(subject, error, unit, norm, most) + bound)
        elif norm == "rms" and robot > most:
            doubted.append(
                f"{subject} keeps {most:g} {unit} (rms) by the model; on the robot {robot:.3g} "
                f"{unit} is to be expected"
            )
    return missed, doubted


def off_by(subject: str, error: float, unit: str, norm: str, expected: float) -> str:
    """A missed tolerance in words."""
    return f"{subject} is off by {error:.4g} {unit} ({norm}), expected at most {expected:g}"


def plan_text(
    plan: Plan,
    labels: Sequence[str],
    *,
    model: str,
    legs: Mapping[str, Leg],
    method: str,
    of_foot: bool,
    unreachable: int,
) -> str:
    """A plan in text.

    Args:
        plan: The plan.
        labels: The joints, with their units where these are not degrees.
        model: Where the models come from, in words.
        legs: The legs of a whole robot, by name.
        method: The method as the user names it.
        of_foot: Whether the path is that of a foot.
        unreachable: Samples out of the leg's reach.
    """
    task, shift = plan.task, shifted(plan.task)
    has_estimate = any(np.isfinite(each.error) for each in plan.expected)
    unbounded = method == "foot-optimal" or task.load_of_pose
    rows = []
    for j, (label, expected) in enumerate(zip(labels, plan.expected, strict=True)):
        errors = [error_norm(np.degrees(plan.errors[:, j]), norm) for norm in NORMS]
        bounded = (NOTHING, NOTHING)
        if plan.inversions and not (unbounded or plan.models[j].exceeds_v_max):
            inversion = plan.inversions[j]
            bounded = (f"{np.degrees(inversion.lower_bound):.3f}", percent(inversion.gap))
        robot = [expected_words(expected)] * has_estimate
        rows.append(Row(label, (*(f"{error:.3f}" for error in errors), *robot, *bounded)))
    titles = ["rms [deg]", "max [deg]", *["on the robot"] * has_estimate, bound_title(plan), "gap"]
    lines = [
        f"{len(plan.requests)} requests, one every {1e3 * plan.period:.6g} ms; {model}",
        Table("joint", tuple(map(Column, titles)), tuple(rows)).text(),
        "",
        motions_of(plan).text(),
    ]
    if over_models := models_errors_table(plan, labels):
        draws = max(map(len, task.models)) - 1
        words = f"{task.norm} errors over the nominal model and {draws} drawn from its intervals:"
        lines += ["", words, over_models.text()]
    if legs:
        feet = feet_table({name: plan.of_leg(leg) for name, leg in legs.items()})
        lines += ["", feet.text(), ""]
    if of_foot:
        lines += _foot_lines(plan)
    if plan.method == "shift":
        pairs = zip(plan.names, plan.leads, strict=True)
        lines.append(
            f"early by: {', '.join(f'{name} {1e3 * lead:.0f} ms' for name, lead in pairs)}"
        )
    else:
        lines.append(_shift_line(plan, labels, shift, of_foot=of_foot))
    if fast := too_fast(plan):
        worst = ", ".join(
            f"{each['name']} ({percent(each['share'], 0)} of the path, up to {each['load']:.3g} "
            "times the top speed)"
            for each in fast[:4]
        )
        more = f" and {len(fast) - 4} more" if len(fast) > 4 else ""
        lines.append(
            f"no requests follow exactly where the path is faster than the joint: {worst}{more}"
        )
    if has_estimate:
        has_range = any(np.isfinite(each.high) for each in plan.expected)
        words = ", and the range of 90 % of such motions" if has_range else ""
        lines.append(f"on the robot: rms error to expect, by what the models were tested on{words}")
    lines += advice(plan)
    open_speeds = open_top_speeds(plan)
    unknown = [
        name
        for name, speeds in zip(plan.names, plan.speeds, strict=True)
        if name in open_speeds and speeds.too_fast.any()
    ]
    if unknown:
        lines.append(f"lower bounds of the model only: {', '.join(unknown)} ({OPEN_TOP_SPEED})")
    if words := no_bound(plan):
        lines.append(f"there is no lower bound {words}")
    if np.any(np.isfinite(task.max_step)):
        lines.append("lower bounds are for requests with steps of any size")
    if unreachable:
        lines.append(f"{unreachable} samples were out of the leg's reach")
    return "\n".join(lines)


def _foot_lines(plan: Plan) -> list[str]:
    """The errors of the foot, and their lower bound."""
    errors, on_robot = size(plan.distances, 100.0), ""
    if plan.expected_foot is not None:
        on_robot = f"; on the robot {100.0 * plan.expected_foot:.3f} cm rms to expect"
    lines = [f"foot: {errors.rms:.3f} cm rms from its path, {errors.max:.3f} cm at most{on_robot}"]
    if plan.of_foot is not None and plan.foot_bound:
        norm = "rms" if plan.task.norm == "rms" else "at most"
        weighted = " as weighted" if len(set(plan.of_foot.weights)) > 1 else ""
        lines.append(
            f"no requests within the limits bring it below {100.0 * plan.foot_bound:.3f} cm {norm}"
            f"{weighted}: the plan is {percent(plan.of_foot.gap)} above that"
        )
    return lines


def _shift_line(plan: Plan, labels: Sequence[str], shift: Plan, *, of_foot: bool) -> str:
    """The errors of the best time shift."""
    errors, leads = (
        [np.degrees(rms(column)) for column in shift.errors.T],
        1e3 * np.asarray(shift.leads),
    )
    if len(labels) > 6:  # too many to list
        moving = np.ptp(plan.desired, axis=0) > 0.0
        ends = leads[moving if moving.any() else ...]
        words = f"at most {max(errors):.3f} ({min(ends):.0f} to {max(ends):.0f} ms early)"
    else:
        words = ", ".join(
            f"{label} {error:.3f}"
            + ("" if np.isnan(robot.error) else f", on the robot {np.degrees(robot.error):.3f}")
            + f" ({lead:.0f} ms early)"
            for label, error, robot, lead in zip(labels, errors, shift.expected, leads, strict=True)
        )
    if of_foot:
        words += f"; foot {100.0 * rms(shift.distances):.3f} cm"
    better = any(
        early.error < CLEARLY * planned.error
        for planned, early in zip(plan.expected, shift.expected, strict=True)
    )
    if better and not (shift_recommended(plan, shift) or has_refused(plan)):
        words += "; on the robot that is better for some joints: see --method shift"
    return f"desired angles sent early instead, rms [deg]: {words}"
