"""The page about a plan for any joints or any leg: verdict first, sources last."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.model.evidence import OPEN_TOP_SPEED, untested_words
from planner.planning.plan import Plan
from planner.planning.result import ErrorsOfModels, FootInversion, Inversion
from planner.planning.time_shift import refining_recommended, shift_recommended, shifted
from planner.report import figure
from planner.report.figure import Figure, Motion, Movie
from planner.report.page import (
    Card,
    LinkedFile,
    Page,
    Section,
    footer,
    heading,
    models_table,
    origin_lists,
    sentence,
    spoken,
    table_section,
)
from planner.report.plan_tables import (
    expected_errors,
    feet_table,
    is_bounded,
    joint_rows,
    joints_table,
    models_errors_table,
    motions_table,
    requests_table,
    size,
    timeline_of,
)
from planner.report.style import (
    CLOSED_FORM,
    DESIRED,
    DIRECT,
    FOOT_OPTIMAL,
    OPTIMAL,
    REQUESTED,
    SHIFT,
    Role,
)
from planner.report.table import NO_BOUND, at_most, percent, two_digits
from planner.trajectory import Array

if TYPE_CHECKING:
    from kinematics.leg import Leg

WITHOUT = DIRECT._replace(label="without a plan")
"""The desired angles as requests."""

METHODS = {
    "shift": SHIFT,
    "closed-form": CLOSED_FORM,
    "optimal": OPTIMAL,
    "foot-optimal": FOOT_OPTIMAL,
}
"""The role of each method's plan in all figures."""


def plan_page(
    plan: Plan,
    *,
    title: str,
    method: str,
    origins: Sequence[tuple[str, str]] = (),
    files: Sequence[LinkedFile] = (),
    foot_given: Array | None = None,
    unreachable: int = 0,
    legs: Mapping[str, Leg] | None = None,
    missed: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """The whole page.

    Args:
        plan: The plan.
        title: Title of the plan.
        method: The method, by its name on the command line.
        origins: Inputs of the plan: pairs of a kind and a name.
        files: Files of the run to link to.
        foot_given: Desired positions of the foot [m], shape (n, 3), before they were clamped to
            what the leg reaches; None where they were not.
        unreachable: How many positions are out of the leg's reach.
        legs: The legs of a robot whose joints are all planned, by name.
        missed: Tolerances that the plan misses, in words.
        notes: Further remarks, shown first.
    """
    role = METHODS[method]
    parts = {name: plan.of_leg(leg) for name, leg in (legs or {}).items()}
    head, tail = verdict(plan, parts)
    bounded = is_bounded(plan) and method != "foot-optimal"  # of a robot, too: its joints, by feet
    foot = foot_figures(plan, role)
    count = max(map(len, plan.task.models)) - 1
    over = f" · robust, {plan.task.robust} of the nominal and {count} drawn models" if count else ""
    common: dict[str, Any] = {
        "norm": plan.task.norm,
        "robust": plan.task.robust,
        "no_bound": NO_BOUND if plan.task.load_of_pose else "",
        "bounded": bounded,
    }
    of_joints = {each.plan.names[each.column]: _over_models(each) for each in plan.inversions}
    of_foot = {"foot": _over_models(plan.of_foot)} if plan.of_foot else {}
    joints = {
        **common,
        "table": joints_table(plan, bounded=bounded),
        "over_models": models_errors_table("joint", of_joints, "deg"),
        "has_expected": any(expected_errors(plan)),
        "joints": [joint_figure(plan, role, j) for j in range(len(plan.names))],
    }
    sections = [
        Section("The joints", JOINTS, joints),
        Section(
            "The requests",
            REQUESTS,
            {"motions": motions_table(plan), "table": requests_table(plan)},
        ),
        table_section("The models", models_table(plan.names, plan.models)),
    ]
    if parts:
        feet = {"table": feet_table(parts), "feet": [distances_figure(parts, role)]}
        sections.insert(0, Section("The feet", "{{ table }}{{ figures(feet) }}", feet))
    if foot:
        over_models = models_errors_table("", of_foot, "cm")
        values = {**common, "over_models": over_models, "foot": foot[1:]}
        sections.insert(0, Section("The foot", OVER_MODELS + "{{ figures(foot) }}", values))
    return Page(
        heading=f"Plan for the leg “{title}”" if plan.task.leg else heading(title),
        eyebrow=f"request-planner plan · {method}{over}",
        verdict=spoken(head, tail),
        good=not (missed or jumps_of(plan)),
        remarks=[
            *remarks(plan, foot_given=foot_given, unreachable=unreachable, missed=missed),
            *notes,
        ],
        cards=cards(plan, parts),
        figure=foot[0] if foot else None,
        sections=sections,
        listings=origin_lists(origins, files),
        footer=footer("plan"),
    ).html()


OVER_MODELS = """
{% if over_models %}{{ over_models }}
<p class="note">Errors ({{ norm }}) over the nominal model and others drawn from the
intervals of its parameters; the mean is a root mean square. The robust plan makes the
{{ robust }} error small.</p>
{% endif %}"""

JOINTS = (
    """
{{ table }}
<p class="note">Errors are predicted minus desired angles at each request, by the exact models.
{% if has_expected %}On the robot, expect the error of the plan and of its model, by what the model
  was tested on.
{% endif %}{% if no_bound %}There is no lower bound under {{ no_bound }}.
{% elif bounded %}No requests bring the {{ norm }} error below the lower bound.
{% else %}The plan is for the foot: single joints may have errors that compensate for one
  another.{% endif %}</p>
"""
    + OVER_MODELS
    + """
{{ hints }}
{{ figures(joints) }}
"""
)

REQUESTS = """
{{ motions }}
<p class="note">The length is the sum of all changes. Where requests step, turn or travel more than
a gearbox likes, limit their steps (--max-step-deg, --max-request-speed-deg-s) or let smoother ones
cost more accuracy (--smoothness).</p>
<details>
  <summary>All {{ table.rows | length }} of them [deg]</summary>
  {{ table }}
</details>
"""


# The verdict in words.


def verdict(plan: Plan, legs: Mapping[str, Plan] | None = None) -> tuple[str, str]:
    """The verdict: a headline and its details; of a robot by the parts of its legs."""
    feet = list((legs or {}).values()) or ([plan] if plan.task.leg else [])
    if feet:
        planned, direct = (
            size(np.concatenate(each), 100.0)
            for each in zip(*((leg.distances, leg.direct_distances) for leg in feet), strict=True)
        )
        unit = "cm"
        words = "feet stay" if legs else "foot stays", "their paths" if legs else "its path"
        head = f"By the model the {words[0]} within {at_most(planned.max)} cm of {words[1]}"
    else:
        planned, direct = (
            size(errors, math.degrees(1.0)) for errors in (plan.errors, plan.direct - plan.desired)
        )
        unit = "degrees"
        subject = "joint stays" if len(plan.names) == 1 else "joints stay"
        whose = "its path" if len(plan.names) == 1 else "their paths"
        head = f"By the model the {subject} within {at_most(planned.max)} degrees of {whose}"
    tail = (
        f"{two_digits(planned.rms)} {unit} rms. Without a plan, with the desired angles as "
        f"requests, the error is up to {at_most(direct.max)} {unit}, "
        f"{two_digits(direct.rms)} {unit} rms"
    )
    if plan.task.leg and plan.expected_foot:
        tail += f". On the robot expect about {two_digits(100.0 * plan.expected_foot)} cm rms"
    elif any(expected_errors(plan)) and not feet:
        largest = max(each for each in expected_errors(plan) if each)
        tail += f". On the robot expect about {two_digits(largest)} degrees rms"
    return head, tail


def remarks(
    plan: Plan, *, foot_given: Array | None = None, unreachable: int, missed: Sequence[str]
) -> list[str]:
    """Remarks for users of these requests."""
    lines = [f"{each}." for each in missed]
    if words := untested_words(plan.names, plan.expected):
        lines.append(sentence(words))
    if plan.method != "shift":
        shift = shifted(plan.task)
        if why := shift_recommended(plan, shift):
            lines.append(f"The best time shift is recommended instead (--method shift): {why}.")
        if why := refining_recommended(plan, shift):
            lines.append(f"Play the requests, and refine them by what is measured: {why}.")
    if unreachable:
        lines.append(_out_of_reach(plan, foot_given, unreachable))
    if jumps := jumps_of(plan):
        samples = ", ".join(str(sample) for sample in jumps[:5])
        lines.append(
            f"The leg jumps to another pose after {len(jumps)} samples ({samples}): the "
            "desired angles are no smooth path. Start near another pose (--near), or move the path."
        )
    rows = sorted(joint_rows(plan), key=lambda row: row.load, reverse=True)
    if fast := [row for row in rows if row.too_fast > 0.0]:
        names = ", ".join(
            f"{row.name} ({100 * row.too_fast:.0f} % of the path, up to {row.speed:.0f} deg/s; "
            f"the joint reaches {row.top_speed:.0f})"
            for row in fast
        )
        lines.append(
            f"The desired path is faster than the top speed of: {names}. There no requests make "
            "the joint follow exactly; a slower or smaller path has no such error."
        )
        by_name = dict(zip(plan.names, (each.evidence for each in plan.models), strict=True))
        evidence = {row.name: by_name[row.name] for row in fast}
        unknown = [name for name, each in evidence.items() if each and each.leaves_top_speed_open]
        if unknown:
            lines[-1] += (
                f" For {', '.join(unknown)} this holds for the model only: {OPEN_TOP_SPEED}."
            )
    if outside := [row for row in rows if row.beyond]:
        names = ", ".join(f"{row.name} by {row.beyond:.3g} degrees" for row in outside)
        lines.append(
            f"Requests go beyond the limits of {names}. A robot that clips its requests would "
            "track less well than this."
        )
    if at_limit := [row for row in rows if row.at_limit and not row.beyond]:
        names = ", ".join(f"{row.name} ({row.at_limit})" for row in at_limit)
        lines.append(f"Requests at a limit of their joint: {names}.")
    return lines


def jumps_of(plan: Plan) -> list[int]:
    """Samples after which the desired pose jumps."""
    leg, desired = plan.task.leg, plan.desired
    if leg is None:
        return []
    closed = np.vstack([desired, desired[:1]]) if plan.cyclic else desired
    return [int(sample) for sample in leg.jumps(closed)]


def _over_models(plan: Inversion | FootInversion) -> tuple[ErrorsOfModels, ErrorsOfModels] | None:
    """Errors over the models, of a robust plan and the nominal one; None where it is not."""
    return None if plan.nominal is None else (plan.over_models, plan.nominal.over_models)


def _out_of_reach(plan: Plan, foot_given: Array | None, unreachable: int) -> str:
    head = f"{unreachable} of {len(plan.desired)} positions are out of the leg's reach"
    if foot_given is None:
        return f"{head}; the distances count them."
    original = size(np.linalg.norm(plan.foot - foot_given, axis=1), 100.0)
    return (
        f"{head}. The path was clamped to what the leg can reach, and all distances here are to "
        f"the clamped path. To the path as given the foot's distance is {original.rms:.3f} cm rms, "
        f"{original.max:.3f} cm at most."
    )


def cards(plan: Plan, legs: Mapping[str, Plan] | None = None) -> list[Card]:
    """The key figures; of a robot also of its feet."""
    rows = joint_rows(plan)
    foot_cards = []
    if feet := list((legs or {}).values()) or ([plan] if plan.task.leg else []):
        planned, direct, early = (
            size(np.concatenate(each), 100.0)
            for each in (
                [leg.distances for leg in feet],
                [leg.direct_distances for leg in feet],
                [shifted(leg.task).distances for leg in feet],
            )
        )
        shift = [f", with the best time shift {each:.3g} cm" for each in early]
        shift = ["", ""] if plan.method == "shift" else shift
        whose = "the feet from their paths" if legs else "the foot from its path"
        foot_cards += [
            Card(f"{planned.rms:.3g}", "cm rms",
                 f"{whose}; without a plan {direct.rms:.3g} cm{shift[0]}"),
            Card(f"{planned.max:.3g}", "cm",
                 f"at most; without a plan {direct.max:.3g} cm{shift[1]}"),
        ]  # fmt: skip
    if plan.foot_bound:
        kind = {"rms": "rms", "max": "at most"}[plan.task.norm]
        foot_cards.append(
            Card(percent(float(plan.gaps[0])), "",
                 f"above the lower bound for requests within the limits, "
                 f"{100.0 * plan.foot_bound:.3g} cm {kind}, proved")
        )  # fmt: skip
    worst = max(rows, key=lambda row: row.planned.rms)
    busy = max(rows, key=lambda row: row.load)
    count, joints = len(plan.desired), len(rows)
    return [
        *foot_cards,
        Card(f"{worst.planned.rms:.3g}", "deg rms",
             f"the joint with the largest error, {worst.name}; without a plan "
             f"{worst.direct.rms:.3g} deg"),
        Card(f"{busy.speed:.0f}", "deg/s",
             f"{busy.name}, the fastest for its top speed, which is {busy.top_speed:.0f} deg/s"),
        Card(f"{plan.period * count:.3g}", "s",
             f"{count} requests to {joints} joint{'s' * (joints > 1)}, one every "
             f"{1000 * plan.period:.3g} ms; "
             + ("the path repeats" if plan.cyclic else "from rest")),
    ]  # fmt: skip


# The figures.


def foot_figures(plan: Plan, role: Role) -> list[Figure]:
    """The moving leg, and its foot's error over time."""
    leg = plan.task.leg
    if leg is None:
        return []
    moving = Figure(
        "leg",
        "The leg and the paths of its foot",
        "Move the slider and the leg follows, drag it and it turns.",
        timeline_of(plan).axis,
        movie=_movie(plan, leg, role),
    )
    return [moving, distances_figure({"": plan}, role)]


def distances_figure(legs: Mapping[str, Plan], role: Role) -> Figure:
    """The error of each foot over time, without a plan and with it; "" for the only leg."""
    timeline = timeline_of(next(iter(legs.values())))
    feet = {
        name: [
            timeline.curve(100.0 * distances, looks)
            for distances, looks in ((plan.direct_distances, WITHOUT), (plan.distances, role))
        ]
        for name, plan in legs.items()
    }
    return figure.foot_figure(timeline, feet)


def _movie(plan: Plan, leg: Leg, role: Role) -> Movie:
    motions = []
    for looks, angles, distances in (
        (DESIRED, plan.desired, None),
        (WITHOUT, plan.direct, plan.direct_distances),
        (role, plan.predicted, plan.distances),
    ):
        points = leg.joint_positions(angles)
        if looks is DESIRED:  # the desired position may be out of reach
            points = np.concatenate([points[:, :-1], plan.task.desired_foot[:, None]], axis=1)
        motions.append(Motion(looks, points, distances))
    return Movie(tuple(motions), plan.period, plan.cyclic)


def joint_figure(plan: Plan, role: Role, j: int) -> Figure:
    """A joint's angles as desired, without a plan and with it, and its requests."""
    timeline, limits = timeline_of(plan), plan.task.limits[j]
    desired, direct, predicted = (
        timeline.degrees(values[:, j], looks)
        for values, looks in (
            (plan.desired, DESIRED),
            (plan.direct, WITHOUT),
            (plan.predicted, role),
        )
    )
    comparison = "without a plan, and with it"
    if plan.method == "shift":
        comparison = "with the desired angles as requests, and with these the best time early"
    return figure.joint_figure(
        timeline,
        f"joint_{j}",
        (
            heading(plan.names[j]),
            f"Above: the joint's angle as desired, {comparison}. Below: its requests; limits are "
            "drawn where they are near.",
        ),
        angles=(desired, direct, predicted),
        requests=(desired, timeline.degrees(plan.requests[:, j], REQUESTED, held=True)),
        limits=limits and (math.degrees(limits[0]), math.degrees(limits[1])),
        clock=plan.task.leg is not None or len(plan.names) > 1,
    )
