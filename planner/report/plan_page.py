"""The page about a plan for any joints or any leg: verdict first, sources last."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.model.evidence import OPEN_TOP_SPEED
from planner.planning.plan import DEGREE, Plan
from planner.report import figure, style
from planner.report.figure import Figure, Timeline
from planner.report.page import Page, models_table
from planner.report.plan_results import PlanAnswer, motions_table, no_bound
from planner.report.wording import (
    Column,
    Row,
    Table,
    by_columns,
    percent,
    signed,
    thousandths,
    words_of,
)
from planner.trajectory import Array, size

WITHOUT = style.DIRECT._replace(label="without a plan")
"""The desired angles as requests."""


def plan_page(
    answer: PlanAnswer, *, title: str, foot_given: Array | None = None, notes: Sequence[str] = ()
) -> Page:
    """The whole page.

    ``foot_given`` [m], (n, 3), is the desired path of the foot before it was clamped to what the
    leg reaches.
    """
    plan, role, timeline = answer.plan, style.ROLES[answer.method], Timeline.of(answer.plan)
    requests = [
        Row(f"{timeline.step * k:.6g}", thousandths(angles))
        for k, angles in enumerate(np.degrees(plan.requests).tolist())
    ]
    foot, joints, as_given = answer.foot, answer.joints, None
    if foot_given is not None:
        as_given = size(np.linalg.norm(plan.foot - foot_given, axis=1), 100.0)
    if foot is None:
        unit, subject = "degrees", "joints" if len(joints) > 1 else "joint"
        planned, direct = (size(errors, DEGREE) for errors in (plan.errors, plan.direct.errors))
        expected = float(np.degrees(np.nan_to_num(plan.expected_rms).max()))
    else:
        unit, subject = "cm", "feet" if answer.parts else "foot"
        planned, direct = foot.planned, foot.direct
        expected = foot.expected or 0.0 if plan.task.leg else 0.0
    parts = answer.parts or ({"": plan} if plan.task.leg else {})
    feet = {name: [(WITHOUT, part.direct), (role, part)] for name, part in parts.items()}
    return Page(
        "plan",
        answer=answer,
        plan=plan,
        title=title,
        good=not (answer.missed or jumps_of(plan)),
        unit=unit,
        subject=subject,
        planned=planned,
        direct=direct,
        expected=expected,
        as_given=as_given,
        jumps=jumps_of(plan),
        unknown=[each.name for each in answer.fast if each.name in answer.open_top_speeds],
        open=OPEN_TOP_SPEED,
        notes=notes,
        worst=max(joints, key=lambda each: each.planned.rms),
        busy=max(joints, key=lambda each: each.load),
        leg=leg_figure(plan, role) if plan.task.leg else None,
        distances=figure.foot_figure(timeline, feet) if feet else None,
        joints=joints_table(answer),
        no_bound=no_bound(plan),
        motions=motions_table(plan.names, plan.motions),
        pictures=[joint_figure(plan, role, j) for j in range(len(plan.names))],
        requests=Table(timeline.unit, plan.names, requests, "Requests"),
        models=models_table(plan.names, plan.models),
    )


def jumps_of(plan: Plan) -> list[int]:
    """Samples after which the desired pose jumps."""
    leg, desired = plan.task.leg, plan.desired
    if leg is None:
        return []
    closed = np.vstack([desired, desired[:1]]) if plan.cyclic else desired
    return [int(sample) for sample in leg.jumps(closed)]


def joints_table(answer: PlanAnswer) -> Table:
    """Errors, speeds and limits of joints, and lower bounds where there are any."""
    task, joints, norms = answer.plan.task, answer.joints, ("rms", "max")
    is_shift, early = answer.plan.method == "shift", [f"{1e3 * each.lead:.0f}" for each in joints]
    shifts = [(f"{each.early:.3f}", lead) for each, lead in zip(joints, early, strict=True)]
    planned = Column("best time shift [deg]" if is_shift else "planned [deg]", norms)
    (bound, least), gaps = answer.bounds
    bounded = any(not math.isnan(each.bound) for each in joints)
    speeds = [(f"{each.speed:.0f}", f"{each.top:.0f}") for each in joints]
    limits = []
    for lower, upper in np.degrees([task.lower, task.upper]).T.tolist():
        low, high = (signed(f"{limit:.1f}").removesuffix(".0") for limit in (lower, upper))
        one_sided = f"at least {low}" if math.isfinite(lower) else f"at most {high}"
        known = [math.isfinite(each) for each in (lower, upper)]
        limits.append(f"{low} to {high}" if all(known) else one_sided if any(known) else "none")
    columns = [
        (planned, [thousandths(each.planned) for each in joints]),
        is_shift and ("early [ms]", early),
        bool(answer.on_robot) and ("on the robot [deg]", answer.on_robot),
        (Column("without a plan [deg]", norms), [thousandths(each.direct) for each in joints]),
        not is_shift and (Column("best time shift", ("rms [deg]", "early [ms]")), shifts),
        bounded and (f"{bound} [deg]", least),
        bounded and gaps,
        (Column("speed [deg/s]", ("desired", "top")), speeds),
        ("too fast", [percent(each.share, 0) for each in joints]),
        ("limits [deg]", limits),
        ("at or beyond limits", [f"{each.at_limit}" for each in joints]),
    ]
    return by_columns("joint", answer.plan.names, columns, label="Joints")


# The figures.


def leg_figure(plan: Plan, role: style.Role) -> Figure:
    """The moving leg, as desired, without a plan and with it."""
    task = plan.task
    assert task.leg is not None, "only a leg moves"
    motions = (plan.desired, plan.direct.predicted, plan.predicted)
    desired, *others = map(task.leg.joint_positions, motions)
    # the leg may not reach where its foot should be
    desired = np.concatenate([desired[:, :-1], task.desired_foot[:, None]], axis=1)
    drawn = zip((WITHOUT, role), others, strict=True)
    return Timeline.of(plan).leg("leg", words_of("plan_leg"), desired, drawn)


def joint_figure(plan: Plan, role: style.Role, j: int) -> Figure:
    """A joint's angles as desired, without a plan and with it, and its requests."""
    desired = (plan.desired[:, j], style.DESIRED)
    return figure.joint_figure(
        Timeline.of(plan),
        f"joint_{j}",
        words_of("plan_joint", name=plan.names[j], shift=plan.method == "shift"),
        angles=[desired, (plan.direct.predicted[:, j], WITHOUT), (plan.predicted[:, j], role)],
        requests=[desired, (plan.requests[:, j], style.REQUESTED)],
        limits=(plan.task.lower[j], plan.task.upper[j]),
        clock=plan.task.leg is not None or len(plan.names) > 1,
    )
