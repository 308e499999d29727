"""The page about a plan for any joints or any leg: what holds first, where it comes from last."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner._version import __version__
from planner.inversion.error_norm import error_norm, relative_gap
from planner.model.evidence import OPEN_TOP_SPEED, untested_words
from planner.report.figure import (
    POSES,
    Axis,
    Figure,
    Motion,
    Movie,
    Panel,
    Timeline,
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
from planner.report.style import (
    CLOSED_FORM,
    DESIRED,
    DIRECT,
    FOOT_OPTIMAL,
    OPTIMAL,
    REQUESTED,
    Role,
)
from planner.report.table import NOTHING, Column, Row, Table, percent, signed

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.evaluation.plan_outcome import PlanOutcome
    from planner.inversion.result import ErrorsOfModels
    from planner.trajectory import Array

METHODS = {"closed-form": CLOSED_FORM, "optimal": OPTIMAL, "foot-optimal": FOOT_OPTIMAL}
"""How the plan of each method is drawn everywhere."""

VIEWS = {"side": (0, "x"), "front": (1, "y")}
"""What a view has across [index and name of the axis]; upward it has z."""

AT_LIMIT = math.radians(1e-6)
"""A request this close to a limit is at it [rad]."""

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


class Size(NamedTuple):
    """Errors of one kind, in one unit: root mean square, and largest."""

    rms: float
    largest: float


def size(errors: Array, factor: float) -> Size:
    """The errors times a factor in two numbers."""
    return Size(factor * error_norm(errors, "rms"), factor * error_norm(errors, "max"))


def verdict(outcome: PlanOutcome) -> tuple[str, str]:
    """The answer in a few words, and what it is worth."""
    if outcome.feet:
        planned, direct = (size(outcome.distances[kind], 100.0) for kind in ("planned", "direct"))
        unit = "cm"
        head = f"The foot stays within {_at_most(planned.largest)} cm of its path"
    else:
        planned, direct = (
            size(outcome.errors[kind], math.degrees(1.0)) for kind in ("planned", "direct")
        )
        unit = "degrees"
        subject = "joint stays" if len(outcome.names) == 1 else "joints stay"
        whose = "its path" if len(outcome.names) == 1 else "their paths"
        head = f"The {subject} within {_at_most(planned.largest)} degrees of {whose}"
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


def expected_errors(outcome: PlanOutcome) -> list[float]:
    """Error to expect of each joint on the robot, rms [deg]; 0 where it is not known."""
    return [math.degrees(each.error) if each.error > 0.0 else 0.0 for each in outcome.expected]


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


# The tables.


class JointRow(NamedTuple):
    """A joint under the plan: angles in degrees, speeds in degrees per second.

    ``bound`` and ``gap`` are None for a plan for the foot, and the gap above a bound of zero is
    infinite. ``too_fast`` is the share of the desired path above the top speed, ``at_limit`` the
    number of requests at one of the ``limits``, which are infinite where there is none.
    """

    name: str
    planned: Size
    direct: Size
    bound: float | None
    gap: float | None
    speed: float
    top_speed: float
    too_fast: float
    limits: tuple[float, float]
    at_limit: int

    @property
    def load(self) -> float:
        """The speed as a share of the top speed."""
        return self.speed / self.top_speed


def joint_rows(outcome: PlanOutcome) -> list[JointRow]:
    """Every joint."""
    rows = []
    for j, name in enumerate(outcome.names):
        planned, direct = (
            size(outcome.errors[kind][:, j], math.degrees(1.0)) for kind in ("planned", "direct")
        )
        lower, upper = outcome.limits.get(name, (-math.inf, math.inf))
        bound = outcome.bounds.get(name)
        error = math.radians(planned.rms if outcome.norm == "rms" else planned.largest)
        requests = outcome.requests[:, j]
        near = (requests <= lower + AT_LIMIT) | (requests >= upper - AT_LIMIT)
        rows.append(
            JointRow(
                name=name,
                planned=planned,
                direct=direct,
                bound=None if bound is None else math.degrees(bound),
                gap=None if bound is None else relative_gap(error, bound),
                speed=math.degrees(float(outcome.speeds[j])),
                top_speed=math.degrees(outcome.models[j].v_max),
                too_fast=float(outcome.too_fast[j]),
                limits=(math.degrees(lower), math.degrees(upper)),
                at_limit=int(np.sum(near)),
            )
        )
    return rows


def joints_table(outcome: PlanOutcome) -> Table:
    """Errors, bounds, speeds and limits of every joint."""
    bounded = bool(outcome.bounds)
    known = any(expected_errors(outcome))
    columns = [
        Column("planned [deg]", ("rms", "max")),
        *([Column("on the robot [deg]")] if known else []),
        Column("without a plan [deg]", ("rms", "max")),
        *([Column("lower bound [deg]"), Column("gap")] if bounded else []),
        Column("speed [deg/s]", ("desired", "top")),
        Column("too fast"),
        Column("limits [deg]"),
        Column("requests at a limit"),
    ]
    rows = []
    for row, expected in zip(joint_rows(outcome), expected_errors(outcome), strict=True):
        bounds = [
            NOTHING if row.bound is None else f"{row.bound:.3f}",
            NOTHING if row.gap is None else percent(row.gap),
        ]
        planned, direct = (
            tuple(f"{error:.3f}" for error in errors) for errors in (row.planned, row.direct)
        )
        cells: list[str | tuple[str, ...]] = [
            planned,
            *([f"{expected:.3f}" if expected else NOTHING] if known else []),
            direct,
            *(bounds if bounded else []),
            (f"{row.speed:.0f}", f"{row.top_speed:.0f}"),
            percent(row.too_fast, 0),
            _limits(*row.limits),
            f"{row.at_limit}",
        ]
        rows.append(Row(row.name, tuple(cells)))
    return Table("joint", tuple(columns), tuple(rows), label="Joints")


def models_errors_table(
    stub: str, over_models: Mapping[str, tuple[ErrorsOfModels, ErrorsOfModels]], unit: str
) -> Table | None:
    """Errors of the robust plan over the models that joints may have, beside the nominal plan's.

    Args:
        stub: What has a row each.
        over_models: Their errors, in SI units; there is no table where there are none.
        unit: In which they are shown, "deg" or "cm".
    """
    if not over_models:
        return None
    parts, factor = ("nominal", "mean", "worst"), {"deg": math.degrees(1.0), "cm": 100.0}[unit]
    columns = (
        Column(f"robust plan [{unit}]", parts),
        Column(f"plan for the nominal model [{unit}]", parts),
    )
    rows = (
        Row(name, tuple(tuple(f"{factor * error:.3f}" for error in errors) for errors in plans))
        for name, plans in over_models.items()
    )
    return Table(stub, columns, tuple(rows), label="Errors over the models")


def _limits(lower: float, upper: float) -> str:
    """Limits [deg] in words."""
    low, high = (signed(f"{limit:.1f}") for limit in (lower, upper))
    if math.isfinite(lower) and math.isfinite(upper):
        return f"{low} to {high}"
    if math.isfinite(lower):
        return f"at least {low}"
    return f"at most {high}" if math.isfinite(upper) else "none"


def motions_table(outcome: PlanOutcome) -> Table:
    """How the requests of every joint move, beside the desired path."""
    columns = (
        Column("largest step [deg]"),
        Column("reversals per second"),
        Column("length [deg]", ("requests", "desired")),
        Column("beyond the desired range [deg]"),
    )
    rows = []
    for name, motion in zip(outcome.names, outcome.motions, strict=True):
        step, length, desired, beyond = np.degrees(
            [motion.largest_step, motion.path_length, motion.desired_length, motion.beyond]
        )
        lengths = (f"{length:.1f}", f"{desired:.1f}")
        cells = (f"{step:.2f}", f"{motion.reversals_per_s:.1f}", lengths, f"{beyond:.2f}")
        rows.append(Row(name, cells))
    return Table("joint", columns, tuple(rows), label="How the requests move")


def requests_table(outcome: PlanOutcome) -> Table:
    """Every request."""
    timeline = _timeline(outcome)
    rows = (
        Row(f"{timeline.step * k:.6g}", tuple(f"{angle:.3f}" for angle in angles))
        for k, angles in enumerate(np.degrees(outcome.requests).tolist())
    )
    return Table(timeline.unit, tuple(map(Column, outcome.names)), tuple(rows), label="Requests")


# The figures.


def foot_figures(outcome: PlanOutcome, role: Role) -> list[Figure]:
    """The foot from the side, which moves on a screen, from the front, and its error over time."""
    if outcome.leg is None:
        return []
    side, front = (_view(outcome, outcome.leg, role, view) for view in VIEWS)
    timeline = _timeline(outcome)
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
        _timeline(outcome).path(positions, looks, across)
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
    timeline, name = _timeline(outcome), outcome.names[j]
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


def _timeline(outcome: PlanOutcome) -> Timeline:
    return Timeline(outcome.period, len(outcome.desired), outcome.cyclic)
