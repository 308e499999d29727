"""The page about a plan for any joints or any leg: what holds first, where it comes from last."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from planner._version import __version__
from planner.model.evidence import OPEN_TOP_SPEED, untested_words
from planner.report.figure import (
    POSES,
    Axis,
    Figure,
    Motion,
    Movie,
    Panel,
    leg_sketches,
    near_limits,
)
from planner.report.page import (
    Card,
    LinkedFile,
    Page,
    Section,
    heading,
    models_table,
    origin_lists,
)
from planner.report.plan_tables import (
    expected_errors,
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
    Role,
)
from planner.report.table import percent

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.evaluation.plan_outcome import PlanOutcome

METHODS = {"closed-form": CLOSED_FORM, "optimal": OPTIMAL, "foot-optimal": FOOT_OPTIMAL}
"""How the plan of each method is drawn everywhere."""

VIEWS = {"side": (0, "x"), "front": (1, "y")}
"""What a view has across [index and name of the axis]; upward it has z."""

ROUNDING = 1e-12
"""What the division by a decimal step may add to a quotient, as a share of it."""


def plan_page(
    outcome: PlanOutcome,
    *,
    title: str,
    method: str,
    origins: Sequence[tuple[str, str]] = (),
    files: Sequence[LinkedFile] = (),
    unreachable: int = 0,
    missed: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """The whole page.

    Args:
        outcome: The plan.
        title: What was planned for.
        method: How, as the command line calls it.
        origins: What the plan was made from: pairs of what it is and which.
        files: Files of the run to link to.
        unreachable: How many positions are out of the leg's reach.
        missed: Tolerances that the plan misses, in words.
        notes: What else should be known first.
    """
    from markupsafe import Markup

    role = METHODS[method]
    head, tail = verdict(outcome)
    foot = foot_figures(outcome, role)
    joints = {
        "outcome": outcome,
        "table": joints_table(outcome),
        "over_models": models_errors_table("joint", outcome.over_models, "deg"),
        "known": any(expected_errors(outcome)),
        "joints": [joint_figure(outcome, role, j) for j in range(len(outcome.names))],
    }
    models = models_table(outcome.names, outcome.models)
    sections = [
        Section("The joints", JOINTS, joints),
        Section(
            "The requests",
            REQUESTS,
            {"motions": motions_table(outcome), "table": requests_table(outcome)},
        ),
        Section("The models", "{{ table }}", {"table": models}),
    ]
    if foot:
        errors = {"foot": outcome.foot_over_models} if outcome.foot_over_models else {}
        over_models = models_errors_table("", errors, "cm")
        values = {"outcome": outcome, "over_models": over_models, "foot": foot[1:]}
        sections.insert(0, Section("The foot", OVER_MODELS + "{{ figures(foot) }}", values))
    return Page(
        heading=f"Plan for the leg “{title}”" if outcome.feet else heading(title),
        eyebrow=f"request-planner plan · {method}",
        verdict=Markup("<strong>{}</strong>, {}.").format(head, tail),
        good=not (missed or outcome.jumps),
        remarks=[*remarks(outcome, unreachable=unreachable, missed=missed), *notes],
        cards=cards(outcome),
        figure=foot[0] if foot else None,
        sections=sections,
        listings=origin_lists(origins, files),
        footer=Markup(
            f"request-planner {__version__} plan. The model is that of Stronger &amp; Stone, "
            "<cite>A Model-Based Approach to Robot Joint Control</cite>, Equations 2 and 3."
        ),
    ).html()


OVER_MODELS = """
{% if over_models %}{{ over_models }}
<p class="note">Errors ({{ outcome.norm }}) over the nominal model and others drawn from the
intervals of its parameters; the mean is a root mean square. The robust plan makes the
{{ outcome.robust }} error small.</p>
{% endif %}"""

JOINTS = (
    """
{{ table }}
<p class="note">Errors are predicted minus desired angles at each request, by the exact models.
{% if known %}On the robot, expect the error of the plan and of its model, by what the model was
  tested on.
{% endif %}{% if outcome.no_bound %}There is no lower bound under {{ outcome.no_bound }}.
{% elif outcome.bounds %}No requests bring the {{ outcome.norm }} error below the lower bound.
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


# What the plan amounts to, in words.


def verdict(outcome: PlanOutcome) -> tuple[str, str]:
    """The answer in a few words, and what it is worth."""
    if outcome.feet:
        planned, direct = (size(outcome.distances[kind], 100.0) for kind in ("planned", "direct"))
        unit = "cm"
        head = f"By the model the foot stays within {_at_most(planned.largest)} cm of its path"
    else:
        planned, direct = (
            size(outcome.errors[kind], math.degrees(1.0)) for kind in ("planned", "direct")
        )
        unit = "degrees"
        subject = "joint stays" if len(outcome.names) == 1 else "joints stay"
        whose = "its path" if len(outcome.names) == 1 else "their paths"
        head = f"By the model the {subject} within {_at_most(planned.largest)} degrees of {whose}"
    tail = (
        f"{_two_digits(planned.rms)} {unit} rms. Without a plan, with the desired angles as "
        f"requests, the error is up to {_at_most(direct.largest)} {unit}, "
        f"{_two_digits(direct.rms)} {unit} rms"
    )
    if outcome.feet and outcome.expected_foot:
        tail += f". On the robot expect about {_two_digits(100.0 * outcome.expected_foot)} cm rms"
    elif any(expected_errors(outcome)) and not outcome.feet:
        largest = max(each for each in expected_errors(outcome) if each)
        tail += f". On the robot expect about {_two_digits(largest)} degrees rms"
    return head, tail


def remarks(outcome: PlanOutcome, *, unreachable: int, missed: Sequence[str]) -> list[str]:
    """What somebody who sends these requests should know first."""
    said = [f"{each}." for each in missed]
    if words := untested_words(outcome.names, outcome.expected):
        said.append(f"{words[0].upper()}{words[1:]}.")
    if unreachable:
        said.append(_out_of_reach(outcome, unreachable))
    if outcome.jumps:
        listed = ", ".join(str(sample) for sample in outcome.jumps[:5])
        said.append(
            f"The leg jumps to another pose after {len(outcome.jumps)} samples ({listed}): the "
            "desired angles are no smooth path. Start near another pose (--near), or move the path."
        )
    rows = sorted(joint_rows(outcome), key=lambda row: row.load, reverse=True)
    if fast := [row for row in rows if row.too_fast > 0.0]:
        listed = ", ".join(
            f"{row.name} ({100 * row.too_fast:.0f} % of the path, up to {row.speed:.0f} of "
            f"{row.top_speed:.0f} deg/s)"
            for row in fast
        )
        said.append(
            f"The desired path is faster than the top speed of: {listed}. There no requests make "
            "the joint follow exactly; a slower or smaller path has no such error."
        )
        seen = dict(zip(outcome.names, (each.evidence for each in outcome.models), strict=True))
        evidence = {row.name: seen[row.name] for row in fast}
        unknown = [name for name, each in evidence.items() if each and each.leaves_top_speed_open]
        if unknown:
            said[-1] += f" For {', '.join(unknown)} this is the model's word: {OPEN_TOP_SPEED}."
    if held := [row for row in rows if row.at_limit]:
        listed = ", ".join(f"{row.name} ({row.at_limit})" for row in held)
        said.append(f"Requests at a limit of their joint: {listed}.")
    return said


def _out_of_reach(outcome: PlanOutcome, unreachable: int) -> str:
    """What the distances count of positions that the leg cannot reach."""
    head = f"{unreachable} of {len(outcome.desired)} positions are out of the leg's reach"
    if outcome.foot_given is None:
        return f"{head}; the distances count them."
    given = size(outcome.distances_given, 100.0)
    return (
        f"{head}. The path was clamped to what the leg can reach, and all distances here are to "
        f"the clamped path. To the path as given the foot's distance is {given.rms:.3f} cm rms, "
        f"{given.largest:.3f} cm at most."
    )


def cards(outcome: PlanOutcome) -> list[Card]:
    """The key figures."""
    rows = joint_rows(outcome)
    made = []
    if outcome.feet:
        planned, direct = (size(outcome.distances[kind], 100.0) for kind in ("planned", "direct"))
        made += [
            Card(f"{planned.rms:.3g}", "cm rms",
                 f"the foot from its path; without a plan {direct.rms:.3g} cm"),
            Card(f"{planned.largest:.3g}", "cm",
                 f"at most; without a plan {direct.largest:.3g} cm"),
        ]  # fmt: skip
    if outcome.foot_bound and outcome.foot_gap is not None:
        kind = {"rms": "rms", "max": "at most"}[outcome.norm]
        made.append(
            Card(percent(outcome.foot_gap), "",
                 f"above the lower bound for requests within the limits, "
                 f"{100.0 * outcome.foot_bound:.3g} cm {kind}, proved")
        )  # fmt: skip
    worst = max(rows, key=lambda row: row.planned.rms)
    busy = max(rows, key=lambda row: row.load)
    count, joints = len(outcome.desired), len(rows)
    return [
        *made,
        Card(f"{worst.planned.rms:.3g}", "deg rms",
             f"the joint with the largest error, {worst.name}; without a plan "
             f"{worst.direct.rms:.3g} deg"),
        Card(f"{busy.speed:.0f}", "deg/s",
             f"{busy.name}, the fastest for its top speed, which is {busy.top_speed:.0f} deg/s"),
        Card(f"{outcome.period * count:.3g}", "s",
             f"{count} requests to {joints} joint{'s' * (joints > 1)}, one every "
             f"{1000 * outcome.period:.3g} ms; "
             + ("the path repeats" if outcome.cyclic else "from rest")),
    ]  # fmt: skip


def _at_most(value: float) -> str:
    """Two digits of a size, rounded up: what stays below the size stays below them."""
    if not value > 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return _two_digits(step * math.ceil(value / step * (1.0 - ROUNDING)))


def _two_digits(value: float) -> str:
    """Two digits of a number, without a power of ten."""
    return f"{float(f'{value:.2g}'):g}"


# The figures.


def foot_figures(outcome: PlanOutcome, role: Role) -> list[Figure]:
    """The foot from the side, which moves on a screen, from the front, and its error over time."""
    if outcome.leg is None:
        return []
    side, front = (_view(outcome, outcome.leg, role, view) for view in VIEWS)
    timeline = timeline_of(outcome)
    curves = [
        timeline.curve(100.0 * distances, looks)
        for distances, looks in zip(outcome.distances.values(), (DIRECT, role), strict=True)
    ]
    distances = timeline.figure(
        "foot_distances",
        [Panel(Axis("distance", "cm", from_zero=True), tuple(curves), height=1.8)],
        (
            "The foot's error over time",
            "Distance of the foot from its desired position at the same moment.",
        ),
        clock=True,
    )
    return [side, front, distances]


def _view(outcome: PlanOutcome, leg: Leg, role: Role, view: str) -> Figure:
    across, name = VIEWS[view]
    chosen = np.linspace(0, len(outcome.desired), POSES, endpoint=not outcome.cyclic)
    samples = np.minimum(chosen.astype(int), len(outcome.desired) - 1)
    paths = [
        timeline_of(outcome).path(positions, looks, across)
        for positions, looks in zip(outcome.feet.values(), (DESIRED, DIRECT, role), strict=True)
    ]
    moves = "Move the slider and the leg follows, drag it and it turns. " * (view == "side")
    return Figure(
        f"foot_{view}",
        f"The foot from the {view}",
        f"{moves}On paper: the leg at the beginning of the planned motion; thin lines are later "
        "moments.",
        Axis(f"{name} in the frame {leg.base}", "cm"),
        (
            Panel(
                Axis("z", "cm"),
                (*leg_sketches(leg.joint_positions(outcome.predicted[samples]), across), *paths),
                height=2.2,
            ),
        ),
        equal=True,
        movie=_movie(outcome, leg, role) if view == "side" else None,
    )


def _movie(outcome: PlanOutcome, leg: Leg, role: Role) -> Movie:
    """The leg as desired, without a plan, and with it."""
    motions = []
    for looks, angles, distances in (
        (DESIRED, outcome.desired, None),
        (DIRECT, outcome.direct, outcome.distances["direct"]),
        (role, outcome.predicted, outcome.distances["planned"]),
    ):
        points = leg.joint_positions(angles)
        if looks is DESIRED:  # the desired position may be out of reach
            points = np.concatenate([points[:, :-1], outcome.feet["desired"][:, None]], axis=1)
        motions.append(Motion(looks, points, distances))
    return Movie(tuple(motions), outcome.period, outcome.cyclic)


def joint_figure(outcome: PlanOutcome, role: Role, j: int) -> Figure:
    """A joint: above its angles, below its requests against the limits."""
    timeline, name = timeline_of(outcome), outcome.names[j]
    desired, direct, predicted, requests = (
        timeline.curve(np.degrees(values[:, j]), looks)
        for values, looks in (
            (outcome.desired, DESIRED),
            (outcome.direct, DIRECT),
            (outcome.predicted, role),
            (outcome.requests, REQUESTED),
        )
    )
    limits = outcome.limits.get(name)
    in_degrees = None if limits is None else (math.degrees(limits[0]), math.degrees(limits[1]))
    drawn = near_limits(in_degrees, requests, end=timeline.step * timeline.last)
    return timeline.figure(
        f"joint_{j}",
        [
            Panel(Axis("angle", "deg", least=1.0), (desired, direct, predicted), "predicted"),
            Panel(Axis("request", "deg", least=1.0), (desired, *drawn, requests), "requested"),
        ],
        (
            heading(name),
            "Above: the joint's angle as desired, without a plan, and with it. Below: its "
            "requests; limits are drawn where they are near.",
        ),
        clock=bool(outcome.feet) or len(outcome.names) > 1,
    )
