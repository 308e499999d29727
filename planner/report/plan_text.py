"""A plan as text, on terminals."""

from __future__ import annotations

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
    open_top_speeds,
    size,
)
from planner.report.table import NOTHING, Column, Row, Table, percent
from planner.report.wording import rendered_text
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
    task, shift = plan.task, shifted(plan.task)
    has_estimate = any(np.isfinite(each.error) for each in plan.expected)
    rows = []
    for j, (label, expected) in enumerate(zip(labels, plan.expected, strict=True)):
        errors = [error_norm(np.degrees(plan.errors[:, j]), norm) for norm in NORMS]
        bounded = (NOTHING, NOTHING)
        if plan.inversions and not (by_feet or task.load_of_pose or plan.models[j].exceeds_v_max):
            inversion = plan.inversions[j]
            bounded = (f"{np.degrees(inversion.lower_bound):.3f}", percent(inversion.gap))
        robot = [expected_words(expected)] * has_estimate
        rows.append(Row(label, (*(f"{error:.3f}" for error in errors), *robot, *bounded)))
    titles = ["rms [deg]", "max [deg]", *["on the robot"] * has_estimate, bound_title(plan), "gap"]
    moving = np.ptp(plan.desired, axis=0) > 0.0
    better = any(
        early.error < CLEARLY * planned.error
        for planned, early in zip(plan.expected, shift.expected, strict=True)
    )
    return rendered_text(
        "plan.txt",
        plan=plan,
        model=model,
        joints=Table("joint", tuple(map(Column, titles)), tuple(rows)),
        motions=motions_of(plan),
        over_models=models_errors_table(plan, labels),
        draws=max(map(len, task.models)) - 1,
        feet=legs and feet_table({name: plan.of_leg(leg) for name, leg in legs.items()}),
        of_foot=of_foot,
        foot=of_foot and size(plan.distances, 100.0),
        weighted=plan.of_foot is not None and len(set(plan.of_foot.weights)) > 1,
        shifts=[
            {
                "label": label,
                "error": np.degrees(rms(errors)),
                "expected": np.degrees(expected.error),
                "lead": 1e3 * lead,
            }
            for label, errors, expected, lead in zip(
                labels, shift.errors.T, shift.expected, shift.leads, strict=True
            )
        ],
        leads=1e3 * np.asarray(shift.leads)[moving if moving.any() else ...],
        shifted_foot=of_foot and 100.0 * rms(shift.distances),
        shift_better=better and not (shift_recommended(plan, shift) or has_refused(plan)),
        has_estimate=has_estimate,
        has_range=any(np.isfinite(each.high) for each in plan.expected),
        advice=advice(plan),
        unknown=[
            name
            for name, speeds in zip(plan.names, plan.speeds, strict=True)
            if name in open_top_speeds(plan) and speeds.too_fast.any()
        ],
        open=OPEN_TOP_SPEED,
        no_bound=no_bound(plan),
        has_max_step=np.any(np.isfinite(task.max_step)),
        unreachable=unreachable,
    )
