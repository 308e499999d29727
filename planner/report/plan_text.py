"""A plan as text, on terminals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from planner.model.evidence import OPEN_TOP_SPEED
from planner.planning.plan import Plan
from planner.planning.task import NORMS
from planner.planning.time_shift import CLEARLY, has_refused, shift_recommended, shifted
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
from planner.trajectory import error_norm, rms

if TYPE_CHECKING:
    from kinematics import Leg


def plan_text(
    plan: Plan,
    labels: Sequence[str],
    *,
    model: str,
    legs: Mapping[str, Leg],
    by_feet: bool,
    of_foot: bool,
    unreachable: int,
) -> str:
    """A plan in text.

    Args:
        plan: The plan.
        labels: The joints, with their units where these are not degrees.
        model: Where the models come from, in words.
        legs: The legs of a whole robot, by name.
        by_feet: Whether the feet were planned, and not the joints one by one.
        of_foot: Whether the path is that of a foot.
        unreachable: Samples out of the leg's reach.
    """
    task, rows = plan.task, []
    has_estimate = any(np.isfinite(each.error) for each in plan.expected)
    for j, (label, expected) in enumerate(zip(labels, plan.expected, strict=True)):
        errors = [error_norm(np.degrees(plan.errors[:, j]), norm) for norm in NORMS]
        bounded = [NOTHING, NOTHING]
        if plan.inversions and not (by_feet or task.load_of_pose or plan.models[j].exceeds_v_max):
            inversion = plan.inversions[j]
            bounded = [f"{np.degrees(inversion.lower_bound):.3f}", percent(inversion.gap)]
        robot = [expected_words(expected)] * has_estimate
        rows.append([label, *(f"{error:.3f}" for error in errors), *robot, *bounded])
    titles = ["joint", "rms [deg]", "max [deg]", *["on the robot"] * has_estimate]
    titles += [bound_title(plan), "gap"]
    text = (
        f"{len(plan.requests)} requests, one every {1e3 * plan.period:g} ms; "
        f"{model}\n{text_table(titles, rows)}"
        f"\n\n{motions_of(plan).text()}"
    )
    if over_models := models_errors_table(plan, labels):
        text += (
            f"\n\n{task.norm} errors over the nominal model and {max(map(len, task.models)) - 1} "
            f"drawn from its intervals:\n{over_models.text()}"
        )
    if legs:
        parts = {name: plan.of_leg(leg) for name, leg in legs.items()}
        text += f"\n\n{feet_table(parts).text()}\n"
    if of_foot:
        size, largest = (error_norm(100.0 * plan.distances, norm) for norm in NORMS)
        text += f"\nfoot: {size:.3f} cm rms from its path, {largest:.3f} cm at most"
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
        text += f"\n{_best_shift(plan, labels, of_foot=of_foot)}"
    else:
        leads = zip(plan.names, plan.leads, strict=True)
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
    if unreachable:
        text += f"\n{unreachable} samples were out of the leg's reach"
    return text


def _best_shift(plan: Plan, labels: Sequence[str], *, of_foot: bool) -> str:
    """Errors of the desired angles sent early by the best time: the baseline of a plan."""
    shift, each = shifted(plan.task), []
    for j, lead in enumerate(shift.leads):
        expected = np.degrees(shift.expected[j].error)
        robot = "" if np.isnan(expected) else f", on the robot {expected:.3f}"
        error = np.degrees(rms(shift.errors[:, j]))
        each.append(f"{labels[j]} {error:.3f}{robot} ({1e3 * lead:.0f} ms early)")
    if len(each) > 6:  # more are too many to list
        largest = math.degrees(max(rms(errors) for errors in shift.errors.T))
        moving = np.ptp(plan.desired, axis=0) > 0.0
        leads = np.asarray(shift.leads)[moving if moving.any() else ...]
        ends = " to ".join(f"{1e3 * lead:.0f}" for lead in (leads.min(), leads.max()))
        each = [f"at most {largest:.3f} ({ends} ms early)"]
    text = f"desired angles sent early instead, rms [deg]: {', '.join(each)}"
    if of_foot:
        text += f"; foot {100.0 * rms(shift.distances):.3f} cm"
    pairs = zip(plan.expected, shift.expected, strict=True)
    better = any(early.error < CLEARLY * planned.error for planned, early in pairs)
    if better and not (shift_recommended(plan, shift) or has_refused(plan)):
        text += "; on the robot that is better for some joints: see --method shift"
    return text
