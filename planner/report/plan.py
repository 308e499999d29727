"""The page about a plan for any joints or any leg, and its tables: verdict first, sources last."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.model.evidence import ENCODER_STEP, OPEN_TOP_SPEED, Expectation, untested_words
from planner.planning.plan import Plan, RequestMotion
from planner.planning.result import ErrorsOfModels, FootInversion, Inversion
from planner.planning.time_shift import refining_recommended, shift_recommended, shifted
from planner.report import figure, style
from planner.report.figure import Figure, Motion, Timeline
from planner.report.page import (
    Card,
    Listing,
    Page,
    Section,
    footer,
    heading,
    models_table,
    sentence,
    spoken,
    table_section,
)
from planner.report.table import (
    NO_BOUND,
    NOTHING,
    Column,
    Row,
    Table,
    at_most,
    number,
    percent,
    signed,
    two_digits,
)
from planner.trajectory import Array, Distance, error_norm, rms

if TYPE_CHECKING:
    from kinematics.leg import Leg


WITHOUT = style.DIRECT._replace(label="without a plan")
"""The desired angles as requests."""

METHODS = {
    "shift": style.SHIFT,
    "closed-form": style.CLOSED_FORM,
    "optimal": style.OPTIMAL,
    "foot-optimal": style.FOOT_OPTIMAL,
}
"""The role of each method's plan in all figures."""
AT_LIMIT = math.radians(1e-6)
"""A request this close to a limit is at it [rad]."""


def plan_page(
    plan: Plan,
    *,
    title: str,
    method: str,
    sources: Sequence[Listing] = (),
    foot_given: Array | None = None,
    unreachable: int = 0,
    legs: Mapping[str, Leg] | None = None,
    missed: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """The whole page.

    ``foot_given`` [m], (n, 3), is the desired path of the foot before it was clamped to what the
    leg reaches; ``legs`` are those of a robot whose joints are all planned, ``unreachable`` the
    number of samples out of reach, ``missed`` the tolerances that the plan misses.
    """
    role, timeline = METHODS[method], Timeline.of(plan)
    rows = (
        Row(f"{timeline.step * k:.6g}", tuple(f"{angle:.3f}" for angle in angles))
        for k, angles in enumerate(np.degrees(plan.requests).tolist())
    )
    columns = tuple(map(Column, plan.names))
    requests = Table(timeline.unit, columns, tuple(rows), label="Requests")
    parts = {name: plan.of_leg(leg) for name, leg in (legs or {}).items()}
    bounded = is_bounded(plan) and method != "foot-optimal"  # of a robot, too: its joints, by feet
    foot, over_models = foot_figures(plan, role), models_errors_table(plan, plan.names)
    common: dict[str, Any] = {
        "norm": plan.task.norm,
        "robust": plan.task.robust,
        "no_bound": no_bound(plan),
        "bounded": bounded,
        "over_models": over_models,
    }
    sections = []
    if foot:
        values = {**common, "foot": foot[1:]}
        sections.append(Section("The foot", OVER_MODELS + "{{ figures(foot) }}", values))
    if parts:
        feet = {"table": feet_table(parts), "feet": [distances_figure(parts, role)]}
        sections.append(Section("The feet", "{{ table }}{{ figures(feet) }}", feet))
    joints = {
        **common,
        "table": joints_table(plan, bounded=bounded),
        "over_models": None if plan.of_foot else over_models,
        "has_expected": any(expected_errors(plan)),
        "joints": [joint_figure(plan, role, j) for j in range(len(plan.names))],
    }
    sections += [
        Section("The joints", JOINTS, joints),
        Section("The requests", REQUESTS, {"motions": motions_of(plan), "table": requests}),
        table_section("The models", models_table(plan.names, plan.models)),
    ]
    count = max(map(len, plan.task.models)) - 1
    over = f" · robust, {plan.task.robust} of the nominal and {count} drawn models" if count else ""
    words = remarks(plan, foot_given=foot_given, unreachable=unreachable, missed=missed)
    return Page(
        heading=f"Plan for the leg “{title}”" if plan.task.leg else heading(title),
        eyebrow=f"request-planner plan · {method}{over}",
        verdict=spoken(*verdict(plan, parts)),
        good=not (missed or jumps_of(plan)),
        remarks=[*words, *notes],
        cards=cards(plan, parts),
        figure=foot[0] if foot else None,
        sections=sections,
        listings=sources,
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
{% endif %}{% if no_bound %}There is no lower bound {{ no_bound }}.
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
    several, unit = len(plan.names) > 1, "degrees"
    if feet := list((legs or {}).values()) or ([plan] if plan.task.leg else []):
        planned, direct, _ = foot_sizes(feet)
        unit, several = "cm", bool(legs)
        subject = "feet stay" if legs else "foot stays"
    else:
        planned, direct = (
            size(errors, math.degrees(1.0)) for errors in (plan.errors, plan.direct - plan.desired)
        )
        subject = "joints stay" if several else "joint stays"
    whose = "their paths" if several else "its path"
    tail = (
        f"{two_digits(planned.rms)} {unit} rms. Without a plan, with the desired angles as "
        f"requests, the error is up to {at_most(direct.max)} {unit}, "
        f"{two_digits(direct.rms)} {unit} rms"
    )
    expected = max(expected_errors(plan)) if not feet else 0.0
    if plan.task.leg and plan.expected_foot:
        expected = 100.0 * plan.expected_foot
    tail += f". On the robot expect about {two_digits(expected)} {unit} rms" if expected else ""
    return f"By the model the {subject} within {at_most(planned.max)} {unit} of {whose}", tail


def remarks(
    plan: Plan, *, foot_given: Array | None = None, unreachable: int, missed: Sequence[str]
) -> list[str]:
    """Remarks for users of these requests."""
    lines = [f"{each}." for each in missed]
    lines += map(sentence, advice(plan))
    if unreachable:
        head = f"{unreachable} of {len(plan.desired)} positions are out of the leg's reach"
        words = "; the distances count them."
        if foot_given is not None:
            given = size(np.linalg.norm(plan.foot - foot_given, axis=1), 100.0)
            words = (
                ". The path was clamped to what the leg can reach, and all distances here are to "
                "the clamped path. To the path as given the foot's distance is "
                f"{given.rms:.3f} cm rms, {given.max:.3f} cm at most."
            )
        lines.append(head + words)
    if jumps := jumps_of(plan):
        samples = ", ".join(str(sample) for sample in jumps[:5])
        lines.append(
            f"The leg jumps to another pose after {len(jumps)} samples ({samples}): the "
            "desired angles are no smooth path. Start near another pose (--near), or move the path."
        )
    rows = sorted(joint_rows(plan), key=lambda row: row.load, reverse=True)
    # a smaller excess leaves no error worth a remark
    if fast := [row for row in rows if row.too_fast >= 0.005 or row.load > 1.01]:
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


def cards(plan: Plan, legs: Mapping[str, Plan] | None = None) -> list[Card]:
    """The key figures; of a robot also of its feet."""
    rows = joint_rows(plan)
    foot_cards = []
    if feet := list((legs or {}).values()) or ([plan] if plan.task.leg else []):
        planned, direct, early = foot_sizes(feet)
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


# The tables.


def size(errors: Array, factor: float) -> Distance:
    """The errors times a factor in two numbers."""
    return Distance(factor * error_norm(errors, "rms"), factor * error_norm(errors, "max"))


def foot_sizes(feet: Sequence[Plan]) -> tuple[Distance, ...]:
    """Errors of all feet [cm] by the plan, without one, and under the best time shift."""
    of_each = ((leg.distances, leg.direct_distances, shifted(leg.task).distances) for leg in feet)
    return tuple(size(np.concatenate(each), 100.0) for each in zip(*of_each, strict=True))


def expected_errors(plan: Plan) -> list[float]:
    """Error to expect of each joint on the robot, rms [deg]; 0 where it is unknown."""
    return [math.degrees(each.error) if each.error > 0.0 else 0.0 for each in plan.expected]


def expected_words(expected: Expectation) -> str:
    """Error to expect on the robot with its range, rms [deg], where known."""
    if math.isnan(expected.error):
        return NOTHING
    error = f"{math.degrees(expected.error):.3f}"
    low, high = (f"{math.degrees(end):.3g}" for end in (expected.low, expected.high))
    return error if low == high else f"{error} ({low} to {high})"


def is_bounded(plan: Plan) -> bool:
    """Whether the error of each joint has a lower bound."""
    return plan.task.goal == "angles" and not no_bound(plan)


def bound_title(plan: Plan) -> str:
    """The title of lower bounds: of what error, where that is not the rms error."""
    return "lower bound (max)" if plan.task.norm == "max" else "lower bound"


def no_bound(plan: Plan) -> str:
    """For what there is no lower bound, and why; empty where there is one."""
    if plan.task.load_of_pose:
        return NO_BOUND
    pairs = zip(plan.names, plan.models, strict=True)
    faster = [name or "the joint" for name, model in pairs if model.exceeds_v_max]
    if not faster:
        return ""
    return f"for {', '.join(faster)}: with the integral of a speed loop v_max may be exceeded"


def advice(plan: Plan) -> list[str]:
    """What to know and to do before the requests are sent to the robot."""
    lines = [untested_words(plan.names, plan.expected)]
    if plan.method != "shift":
        shift = shifted(plan.task)
        if why := shift_recommended(plan, shift):
            lines.append(f"recommended: --method shift, as {why}")
        if why := refining_recommended(plan, shift):
            refine = "play the requests and refine them (request-planner refine)"
            lines.append(f"recommended: {refine}: {why}")
    return list(filter(None, [*lines, start_words(plan)]))


def start_words(plan: Plan) -> str:
    """How to bring joints to the start of a plan from rest; "" where it makes no difference.

    The first request holds a joint at its start in the middle of its dead band. A joint that comes
    to rest under it stops short of its start by that band, on either side. An integral term
    overcomes the friction. It is said where that is more than the error to expect, and than a step
    of an encoder.
    """
    if plan.cyclic:
        return ""
    off = {
        name or "the joint": math.degrees(model.steady.dead_band)
        for name, model, expected, own in zip(
            plan.names, plan.models, plan.expected, map(rms, plan.errors.T), strict=True
        )
        if model.steady.dead_band > max(np.nan_to_num(expected.error, nan=own), ENCODER_STEP)
    }
    if not off:
        return ""
    joints = ", ".join(f"{name} by up to {size:.2g} degrees" for name, size in off.items())
    return (
        f"by dry friction a joint may rest beside the start that the plan assumes ({joints}): lead "
        "it there slowly, from below to a request as much above the first one, or from above to "
        "one as much below"
    )


class JointRow(NamedTuple):
    """A joint under the plan: angles in degrees, speeds in degrees per second.

    ``bound`` and ``gap`` are None for a plan for the foot, and the gap above a bound of zero is
    infinite. ``speed`` and ``top_speed`` are the desired speed and the top speed in its direction,
    where their ratio is largest; ``too_fast`` is the share of the desired path above the top speed,
    ``at_limit`` the number of requests at one of the ``limits``, infinite where there is none, or
    beyond it, and ``beyond`` how far they go, 0 where they stay within.
    """

    name: str
    planned: Distance
    direct: Distance
    bound: float | None
    gap: float | None
    speed: float
    top_speed: float
    too_fast: float
    limits: tuple[float, float]
    at_limit: int
    beyond: float

    @property
    def load(self) -> float:
        """The speed as a share of the top speed."""
        return self.speed / self.top_speed


def joint_rows(plan: Plan) -> list[JointRow]:
    """Every joint."""
    rows = []
    for j, name in enumerate(plan.names):
        planned, direct = (
            size(np.ascontiguousarray(errors[:, j]), math.degrees(1.0))
            for errors in (plan.errors, plan.direct - plan.desired)
        )
        lower, upper = float(plan.task.lower[j]), float(plan.task.upper[j])
        excess = np.maximum(lower - plan.requests[:, j], plan.requests[:, j] - upper)
        beyond, bounded = float(excess.max()), is_bounded(plan)
        speed, top_speed, low, high = np.degrees([*plan.speeds[j].highest, lower, upper]).tolist()
        rows.append(
            JointRow(
                name=name,
                planned=planned,
                direct=direct,
                bound=math.degrees(plan.lower_bounds[j]) if bounded else None,
                gap=float(plan.gaps[j]) if bounded else None,
                speed=speed,
                top_speed=top_speed,
                too_fast=float(plan.too_fast[j]),
                limits=(low, high),
                at_limit=int(np.sum(excess >= -AT_LIMIT)),
                beyond=math.degrees(beyond) if beyond > AT_LIMIT else 0.0,
            )
        )
    return rows


def joints_table(plan: Plan, *, bounded: bool = True) -> Table:
    """Errors, speeds and limits of joints, and lower bounds if wanted and available."""
    bounded, has_expected = bounded and is_bounded(plan), any(expected_errors(plan))
    is_shift = plan.method == "shift"
    columns = [Column("best time shift [deg]" if is_shift else "planned [deg]", ("rms", "max"))]
    if is_shift:
        columns.append(Column("early [ms]"))
    if has_expected:
        columns.append(Column("on the robot [deg]"))
    columns.append(Column("without a plan [deg]", ("rms", "max")))
    if not is_shift:
        columns.append(Column("best time shift", ("rms [deg]", "early [ms]")))
    if bounded:
        columns += [Column(f"{bound_title(plan)} [deg]"), Column("gap")]
    columns.append(Column("speed [deg/s]", ("desired", "top")))
    columns += [Column("too fast"), Column("limits [deg]"), Column("at or beyond limits")]
    rows = []
    shift = shifted(plan.task)
    early = zip(shift.errors.T, shift.leads, strict=True)
    for row, expected, (errors, lead) in zip(joint_rows(plan), plan.expected, early, strict=True):
        early_by = f"{1e3 * lead:.0f}"
        cells: list[str | tuple[str, ...]] = [tuple(f"{error:.3f}" for error in row.planned)]
        if is_shift:
            cells.append(early_by)
        if has_expected:
            cells.append(expected_words(expected).replace(" (", "\n").removesuffix(")"))
        cells.append(tuple(f"{error:.3f}" for error in row.direct))
        if not is_shift:
            cells.append((f"{np.degrees(rms(errors)):.3f}", early_by))
        if bounded:
            gap = NOTHING if row.gap is None or math.isinf(row.gap) else percent(row.gap)
            cells += [number(row.bound, 3), gap]
        cells.append((f"{row.speed:.0f}", f"{row.top_speed:.0f}"))
        cells += [percent(row.too_fast, 0), _limits(*row.limits), f"{row.at_limit}"]
        rows.append(Row(row.name, tuple(cells)))
    return Table("joint", tuple(columns), tuple(rows), label="Joints")


def models_errors_table(plan: Plan, labels: Sequence[str]) -> Table | None:
    """Errors of a robust plan over the models that joints may have, beside the nominal plan's."""
    unit, factor, rows = "deg", math.degrees(1.0), list[Row]()
    results: Sequence[Inversion | FootInversion] = plan.inversions
    if plan.of_foot is not None:
        unit, factor, labels, results = "cm", 100.0, ["foot"], [plan.of_foot]
    for label, robust in zip(labels, results, strict=True):
        if robust.nominal is None:
            return None
        for result, kind in ((robust, robust.robust), (robust.nominal, "nominal model")):
            errors = tuple(f"{factor * error:.3f}" for error in result.over_models)
            rows.append(Row(f"{label}, for the {kind}", errors))
    columns = tuple(Column(f"{which} [{unit}]") for which in ErrorsOfModels._fields)
    return Table("plan", columns, tuple(rows), label="Errors over the models")


def _limits(lower: float, upper: float) -> str:
    low, high = (signed(f"{limit:.1f}").removesuffix(".0") for limit in (lower, upper))
    has_lower, has_upper = math.isfinite(lower), math.isfinite(upper)
    if has_lower and has_upper:
        return f"{low} to {high}"
    return f"at least {low}" if has_lower else f"at most {high}" if has_upper else "none"


def motions_of(plan: Plan) -> Table:
    """How the requests of every joint of a plan move; see :func:`motions_table`."""
    factors = [math.degrees(1.0)] * len(plan.names)
    return motions_table(zip(plan.names, plan.motions, factors, strict=True))


def motions_table(motions: Iterable[tuple[str, RequestMotion, float]]) -> Table:
    """How requests move, beside the desired path: by joint, with the factor to degrees."""
    rows = []
    for name, motion, factor in motions:
        cells = (
            factor * motion.largest_step,
            motion.reversals_per_s,
            factor * motion.path_length,
            factor * motion.desired_length,
            factor * motion.beyond,
        )
        rows.append(Row(name, tuple(map(format, cells, (".2f", ".1f", ".1f", ".1f", ".2f")))))
    titles = ("largest step [deg]", "reversals/s", "length [deg]", "desired")
    columns = tuple(map(Column, (*titles, "outside desired [deg]")))
    return Table("requests", columns, tuple(rows), label="How the requests move")


def feet_table(legs: Mapping[str, Plan]) -> Table:
    """How far the foot of each leg of a robot is from its path."""
    on_robot = all(plan.expected_foot is not None for plan in legs.values())
    norms = ("rms", "at most")
    columns = [Column("plan [cm]", norms), Column("without a plan [cm]", norms)]
    columns += [Column("best shift [cm]", norms)] + [Column("on the robot, rms [cm]")] * on_robot
    rows = []
    for name, plan in legs.items():
        each = (plan.distances, plan.direct_distances, shifted(plan.task).distances)
        cells: list[str | tuple[str, ...]] = [
            tuple(f"{error:.3f}" for error in size(distances, 100.0)) for distances in each
        ]
        if plan.expected_foot is not None and on_robot:
            cells.append(f"{100.0 * plan.expected_foot:.3f}")
        rows.append(Row(name, tuple(cells)))
    return Table("foot", tuple(columns), tuple(rows), label="Feet")


# The figures.


def foot_figures(plan: Plan, role: style.Role) -> list[Figure]:
    """The moving leg, and its foot's error over time."""
    leg = plan.task.leg
    if leg is None:
        return []
    motions = []
    for looks, angles, distances in (
        (style.DESIRED, plan.desired, None),
        (WITHOUT, plan.direct, plan.direct_distances),
        (role, plan.predicted, plan.distances),
    ):
        points = leg.joint_positions(angles)
        if looks is style.DESIRED:  # the desired position may be out of reach
            points = np.concatenate([points[:, :-1], plan.task.desired_foot[:, None]], axis=1)
        motions.append(Motion(looks, points, distances))
    words = (
        "The leg and the paths of its foot",
        "Move the slider and the leg follows, drag it and it turns.",
    )
    return [Timeline.of(plan).leg("leg", words, motions), distances_figure({"": plan}, role)]


def distances_figure(legs: Mapping[str, Plan], role: style.Role) -> Figure:
    """The error of each foot over time, without a plan and with it; "" for the only leg."""
    timeline = Timeline.of(next(iter(legs.values())))
    feet = {
        name: [
            timeline.curve(100.0 * distances, looks)
            for distances, looks in ((plan.direct_distances, WITHOUT), (plan.distances, role))
        ]
        for name, plan in legs.items()
    }
    return figure.foot_figure(timeline, feet)


def joint_figure(plan: Plan, role: style.Role, j: int) -> Figure:
    """A joint's angles as desired, without a plan and with it, and its requests."""
    timeline, comparison = Timeline.of(plan), "without a plan, and with it"
    if plan.method == "shift":
        comparison = "with the desired angles as requests, and with these the best time early"
    desired, direct, predicted = (
        timeline.degrees(values[:, j], looks)
        for values, looks in (
            (plan.desired, style.DESIRED),
            (plan.direct, WITHOUT),
            (plan.predicted, role),
        )
    )
    return figure.joint_figure(
        timeline,
        f"joint_{j}",
        (
            heading(plan.names[j]),
            f"Above: the joint's angle as desired, {comparison}. Below: its requests; limits are "
            "drawn where they are near.",
        ),
        angles=(desired, direct, predicted),
        requests=(desired, timeline.degrees(plan.requests[:, j], style.REQUESTED, held=True)),
        limits=(math.degrees(plan.task.lower[j]), math.degrees(plan.task.upper[j])),
        clock=plan.task.leg is not None or len(plan.names) > 1,
    )
