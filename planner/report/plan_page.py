"""The page about a plan for any joints or any leg: verdict first, sources last."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.model.evidence import OPEN_TOP_SPEED
from planner.planning.plan import Plan
from planner.report import figure
from planner.report.figure import Figure, Timeline
from planner.report.page import Page, models_table
from planner.report.plan_results import Numbers, PlanAnswer, no_bound, sizes_of
from planner.report.wording import signed, words_of

DIRECT = figure.DIRECT._replace(label="without a plan")
"""The desired angles as requests."""


def plan_page(
    answer: PlanAnswer, *, title: str, foot_given: Array | None = None, notes: Sequence[str] = ()
) -> Page:
    """The whole page; ``foot_given`` [m], (n, 3), is what the leg may not reach."""
    plan, role, timeline = answer.plan, figure.ROLES[answer.method], Timeline.of(answer.plan)
    foot, joints, as_given = answer.foot, answer.joints, None
    groups = dict[str, Numbers]()  # by the name of their unit
    if foot_given is not None:
        as_given = sizes_of(np.linalg.norm(plan.foot - foot_given, axis=1), 100.0)
    if foot is None:
        subject = "joints" if len(joints) > 1 else "joint"
        known = np.degrees(np.nan_to_num(plan.expected_rms))
        for each in dict.fromkeys(answer.shown.values()):
            own = [answer.shown[name] == each for name in plan.names]
            groups[each.name] = {
                **sizes_of(plan.errors[:, own]),
                "without_plan": sizes_of(plan.direct.errors[:, own]),
                "expected_rms": float(known[own].max()),
            }
    else:
        subject = "feet" if answer.parts else "foot"
        groups["cm"] = foot if plan.task.leg else foot | {"expected_rms": None}
    parts = answer.parts or ({"": plan} if plan.task.leg else {})
    feet = {name: [(DIRECT, part.direct), (role, part)] for name, part in parts.items()}
    return Page(
        "plan",
        answer=answer,
        plan=plan,
        title=title,
        good=not (answer.missed or jumps_of(plan)),
        of_joints=foot is None,
        subject=subject,
        planned=foot,
        most={unit: each["max"] for unit, each in groups.items()},
        rms={unit: each["rms"] for unit, each in groups.items()},
        direct={
            size: {unit: each["without_plan"][size] for unit, each in groups.items()}
            for size in ("max", "rms")
        },
        expected={u: each["expected_rms"] for u, each in groups.items() if each["expected_rms"]},
        as_given=as_given,
        jumps=jumps_of(plan),
        unknown=[name for name in answer.fast if name in answer.open_top_speeds],
        open=OPEN_TOP_SPEED,
        notes=notes,
        worst=max(joints, key=lambda name: float(joints[name]["rms"])),
        busy=max(joints, key=lambda name: float(joints[name]["speed_ratio"])),
        leg=leg_figure(plan, role) if plan.task.leg else None,
        distances=figure.foot_figure(timeline, feet) if feet else None,
        **limits_of(answer),
        no_bound=no_bound(plan),
        pictures=[joint_figure(answer, role, j) for j in range(len(plan.names))],
        models=models_table(dict(zip(plan.names, plan.models, strict=True)), answer.shown),
    )


def jumps_of(plan: Plan) -> list[int]:
    """Samples after which the desired pose jumps."""
    leg, desired = plan.task.leg, plan.desired
    if leg is None:
        return []
    closed = np.vstack([desired, desired[:1]]) if plan.cyclic else desired
    return [int(sample) for sample in leg.jumps(closed)]


def limits_of(answer: PlanAnswer) -> dict[str, Any]:
    """Limits of every joint in words, "" for none, and whether there are lower bounds."""
    task, known = answer.plan.task, (each["lower_bound"] for each in answer.joints.values())
    ends = np.round(np.degrees([task.lower, task.upper]).T, 1) + 0.0  # no negative zero
    words = [
        [signed(f"{end:.1f}").removesuffix(".0") if math.isfinite(end) else "" for end in pair]
        for pair in ends.tolist()
    ]
    return {"limits": words, "bounded": any(bound is not None for bound in known)}


# The figures.


def leg_figure(plan: Plan, role: figure.Role) -> Figure:
    """The moving leg, as desired, without a plan and with it."""
    task = plan.task
    assert task.leg is not None, "only a leg moves"
    motions = (plan.desired, plan.direct.predicted, plan.predicted)
    desired, *others = map(task.leg.joint_positions, motions)
    # the leg may not reach where its foot should be
    desired = np.concatenate([desired[:, :-1], task.desired_foot[:, None]], axis=1)
    drawn = zip((DIRECT, role), others, strict=True)
    return Timeline.of(plan).leg("leg", words_of("plan_leg"), desired, drawn)


def joint_figure(answer: PlanAnswer, role: figure.Role, j: int) -> Figure:
    """A joint's angles as desired, without a plan and with it, and its requests."""
    plan, unit = answer.plan, answer.shown[answer.plan.names[j]]
    desired = (plan.desired[:, j], figure.DESIRED)
    return figure.joint_figure(
        Timeline.of(plan),
        f"joint_{j}",
        words_of("plan_joint", name=plan.names[j], shift=plan.method == "shift"),
        angles=[desired, (plan.direct.predicted[:, j], DIRECT), (plan.predicted[:, j], role)],
        requests=[desired, (plan.requests[:, j], figure.REQUESTED)],
        unit=unit,
        limits=(plan.task.lower[j], plan.task.upper[j]),
        clock=plan.task.leg is not None or len(plan.names) > 1,
    )
