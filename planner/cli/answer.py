"""The answers about a plan: JSON for machines, text and pages for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.cli.desired import Desired
from planner.cli.models import beside, leg_title, model_words, verdict_document
from planner.cli.planning import errors_document
from planner.cli.settings import FROM_URDF
from planner.model.evidence import OPEN_TOP_SPEED
from planner.planning.plan import Plan
from planner.planning.result import FootInversion, Inversion
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
)
from planner.report.table import NOTHING, percent, text_table
from planner.trajectory import rms

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.report.page import Written


def document(desired: Desired, plan: Plan, missed: list[str]) -> dict[str, Any]:
    """The plan for machines; fields that a plan for the foot does not have are null."""
    run, task = desired.settings, plan.task
    joints, shift = {}, shifted(task)
    for j, name in enumerate(desired.names):
        inversion, unit = plan.inversions[j] if plan.inversions else None, desired.unit(j)
        ends = np.degrees([plan.expected[j].low, plan.expected[j].high]).tolist()
        motion = plan.motions[j]
        joints[name] = {
            **errors_document(np.degrees(plan.errors[:, j]), unit),
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
            **verdict_document(desired.models[j]),
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
    if desired.foot is not None:
        bound, foot_inversion = plan.foot_bound, plan.of_foot
        foot = {
            **errors_document(100.0 * plan.distances, "cm"),
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
    legs = {}
    for name, leg in desired.legs.items():
        part = plan.of_leg(leg)
        leg_shift = shifted(part.task)
        legs[name] = {
            **errors_document(100.0 * part.distances, "cm"),
            "expected_rms_cm": part.expected_foot and 100.0 * part.expected_foot,
            "without_plan_rms_cm": 100.0 * rms(part.direct_distances),
            "best_shift_rms_cm": 100.0 * rms(leg_shift.distances),
        }
    recommended = "shift" if shift_recommended(plan, shift) else run.plan.method
    step = float(np.min(task.max_step))
    has_tolerance = run.tolerance.deg is not None or run.tolerance.cm is not None
    return {
        "method": run.plan.method,
        "recommended_method": None if has_refused(plan) else recommended,
        "refining_recommended": bool(refining_recommended(plan, shift)),
        "cyclic": desired.cyclic,
        "period_s": desired.period,
        "robust": run.plan.robust,
        "max_step_deg": None if math.isinf(step) else math.degrees(step),
        "unreachable_samples": desired.unreachable,
        "lower_bound_withdrawn": no_bound(plan) or None,
        "joints": joints,
        "foot": foot,
        **({"legs": legs} if legs else {}),
        "within_tolerance": not missed if has_tolerance else None,
    }


def summary(desired: Desired, plan: Plan) -> str:
    """The plan for people."""
    task, rows, run = plan.task, [], desired.settings
    has_estimate = any(np.isfinite(each.error) for each in plan.expected)
    by_feet = run.plan.method == "foot-optimal"
    for j, (label, expected) in enumerate(zip(desired.labels, plan.expected, strict=True)):
        errors = errors_document(np.degrees(plan.errors[:, j]), "deg")
        bounded = [NOTHING, NOTHING]
        if plan.inversions and not (by_feet or task.load_of_pose or plan.models[j].exceeds_v_max):
            inversion = plan.inversions[j]
            bounded = [f"{np.degrees(inversion.lower_bound):.3f}", percent(inversion.gap)]
        robot = [expected_words(expected)] * has_estimate
        rows.append([label, *(f"{error:.3f}" for error in errors.values()), *robot, *bounded])
    titles = ["joint", "rms [deg]", "max [deg]", *["on the robot"] * has_estimate]
    titles += [bound_title(plan), "gap"]
    text = (
        f"{len(plan.requests)} requests, one every {1e3 * desired.period:g} ms; "
        f"{model_words(run.model)}\n{text_table(titles, rows)}"
        f"\n\n{motions_of(plan).text()}"
    )
    if over_models := models_errors_table(plan, desired.labels):
        text += (
            f"\n\n{task.norm} errors over the nominal model and {max(map(len, task.models)) - 1} "
            f"drawn from its intervals:\n{over_models.text()}"
        )
    if desired.legs:
        parts = {name: plan.of_leg(leg) for name, leg in desired.legs.items()}
        text += f"\n\n{feet_table(parts).text()}\n"
    if desired.foot is not None:
        rms, largest = errors_document(100.0 * plan.distances, "cm").values()
        text += f"\nfoot: {rms:.3f} cm rms from its path, {largest:.3f} cm at most"
        if plan.expected_foot is not None:
            text += f"; on the robot {100.0 * plan.expected_foot:.3f} cm rms to expect"
        if plan.of_foot is not None and plan.foot_bound:
            weighted = "" if len(set(plan.of_foot.weights)) == 1 else " as weighted"
            norm = {"rms": "rms", "max": "at most"}[task.norm]
            text += (
                f"\nno requests within the limits bring it below {100.0 * plan.foot_bound:.3f} cm "
                f"{norm}{weighted}: the plan is {percent(plan.of_foot.gap)} above that"
            )
    if plan.method != "shift":
        text += f"\n{_best_shift(desired, plan)}"
    else:
        leads = zip(desired.names, plan.leads, strict=True)
        text += f"\nearly by: {', '.join(f'{name} {1e3 * lead:.0f} ms' for name, lead in leads)}"
    if has_estimate:
        text += "\non the robot: rms error to expect, by what the models were tested on"
        if any(np.isfinite(each.high) for each in plan.expected):
            text += ", and the range of 90 % of such motions"
    text += "".join(f"\n{words}" for words in advice(plan))
    unknown = [
        name
        for name, model, speeds in zip(plan.names, plan.models, plan.speeds, strict=True)
        if model.evidence and model.evidence.leaves_top_speed_open and speeds.too_fast.any()
    ]
    if unknown:
        text += f"\nlower bounds of the model only: {', '.join(unknown)} ({OPEN_TOP_SPEED})"
    if reason := no_bound(plan):
        text += f"\nthere is no lower bound {reason}"
    if np.any(np.isfinite(task.max_step)):
        text += "\nlower bounds are for requests with steps of any size"
    if desired.unreachable:
        text += f"\n{desired.unreachable} samples were out of the leg's reach"
    return text


def _best_shift(desired: Desired, plan: Plan) -> str:
    """Errors of the desired angles sent early by the best time: the baseline of a plan."""
    shift, each = shifted(plan.task), []
    for j, lead in enumerate(shift.leads):
        expected = np.degrees(shift.expected[j].error)
        robot = "" if np.isnan(expected) else f", on the robot {expected:.3f}"
        error = np.degrees(rms(shift.errors[:, j]))
        each.append(f"{desired.labels[j]} {error:.3f}{robot} ({1e3 * lead:.0f} ms early)")
    if len(each) > 6:  # more are too many to list
        largest = math.degrees(max(rms(errors) for errors in shift.errors.T))
        moving = np.ptp(plan.desired, axis=0) > 0.0
        leads = np.asarray(shift.leads)[moving if moving.any() else ...]
        ends = " to ".join(f"{1e3 * lead:.0f}" for lead in (leads.min(), leads.max()))
        each = [f"at most {largest:.3f} ({ends} ms early)"]
    text = f"desired angles sent early instead, rms [deg]: {', '.join(each)}"
    if desired.foot is not None:
        text += f"; foot {100.0 * rms(shift.distances):.3f} cm"
    pairs = zip(plan.expected, shift.expected, strict=True)
    better = any(early.error < CLEARLY * planned.error for planned, early in pairs)
    if better and not (shift_recommended(plan, shift) or has_refused(plan)):
        text += "; on the robot that is better for some joints: see --method shift"
    return text


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


def plan_report(
    desired: Desired,
    plan: Plan,
    *,
    missed: Sequence[str],
    page: Path | str,
    written: Written = (),
) -> str:
    """The page about a plan, as HTML, with links to the files that were ``written``."""
    from planner.report.plan_page import plan_page

    subjects = desired.legs or desired.names
    about = plan_page(
        plan,
        title=leg_title(desired.settings.leg) or ", ".join(subjects),
        method=desired.settings.plan.method,
        foot_given=desired.foot_given,
        unreachable=desired.unreachable,
        legs=desired.legs,
        missed=missed,
        notes=notes_of(desired),
    )
    return about.html(page, origins_of(desired, plan.task.leg), [*inputs_of(desired), *written])


def notes_of(desired: Desired) -> list[str]:
    """Remarks on the models and the units, for a page."""
    notes = []
    if desired.settings.model.file == FROM_URDF:
        notes.append(
            "The URDF has no more than the top speeds of the servos; the rest of their models is "
            "assumed. Identify the joints before these requests are sent."
        )
    if shares := [name for j, name in enumerate(desired.names) if desired.unit(j) != "deg"]:
        notes.append(f"{', '.join(shares)}: degrees stand for percent of the joint's range.")
    return notes


def inputs_of(desired: Desired) -> list[tuple[str, str]]:
    """The files that the settings name: role and path of each."""
    run = desired.settings
    named = [("path", run.path.file), ("model", run.model.file), ("robot", run.leg.urdf)]
    places = [(role, beside(desired.folder, name)) for role, name in named if name]
    return [(role, place) for role, place in places if Path(place).is_file()]


def origins_of(desired: Desired, leg: Leg | None) -> list[tuple[str, str]]:
    """Inputs and settings of the plans: pairs of name and value."""

    def pairs_of(by_joint: Mapping[str, float] | None) -> list[str]:
        return [f"{joint}={position:g}" for joint, position in (by_joint or {}).items()]

    run = desired.settings
    chosen = [name for name in run.plan.keys if name in run.plan.keys_set - {"method", "cyclic"}]
    values: dict[str, Any] = {
        "path": run.path.file or "a half ellipse",
        "leg": leg and f"{run.leg.name or run.leg.urdf}, from {leg.base} to {leg.foot}",
        "model": run.model.file,
        "unreachable": leg and run.leg.unreachable,
        **{name: getattr(run.plan, name) for name in chosen},
        "lock": [*pairs_of(run.leg.lock), *(f"{each}m" for each in pairs_of(run.leg.lock_m))],
        "near": pairs_of(run.leg.near),
    }
    return [
        (name, ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value))
        for name, value in values.items()
        if value or value == 0.0
    ]
