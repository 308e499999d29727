"""The page about a plan for any joints or any leg, and its tables: verdict first, sources last."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.model.evidence import ENCODER_STEP, OPEN_TOP_SPEED, Expectation, untested_words
from planner.planning.plan import Plan, RequestMotion
from planner.planning.result import ErrorsOfModels, FootInversion, Inversion
from planner.planning.time_shift import refining_recommended, shift_recommended, shifted
from planner.report import figure, style
from planner.report.figure import Figure, Timeline
from planner.report.page import Page, models_table
from planner.report.table import (
    NO_BOUND,
    NOTHING,
    Column,
    Row,
    Table,
    by_columns,
    percent,
    signed,
)
from planner.report.wording import words_of
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
DEGREE = math.degrees(1.0)

AT_LIMIT = math.radians(1e-6)
"""A request this close to a limit is at it [rad]."""


def plan_page(
    plan: Plan,
    *,
    title: str,
    method: str,
    foot_given: Array | None = None,
    unreachable: int = 0,
    legs: Mapping[str, Leg] | None = None,
    missed: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> Page:
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
    requests = Table(timeline.unit, tuple(map(Column, plan.names)), tuple(rows), label="Requests")
    parts = {name: plan.of_leg(leg) for name, leg in (legs or {}).items()}
    joint_sizes = [sizes(errors) for errors in (plan.errors, plan.direct - plan.desired)]
    joints = [
        {**speeds, "planned": planned.rms, "direct": direct.rms}
        for speeds, planned, direct in zip(joint_speeds(plan), *joint_sizes, strict=True)
    ]
    feet, unit, early = list(parts.values()) or ([plan] if plan.task.leg else []), "degrees", None
    expected = max(expected_errors(plan)) if not feet else 0.0
    if feet:
        unit, (planned, direct, early) = "cm", foot_sizes(feet)
        subject = "feet" if parts else "foot"
        if plan.task.leg and plan.expected_foot:
            expected = 100.0 * plan.expected_foot
    else:
        planned, direct = (size(errors) for errors in (plan.errors, plan.direct - plan.desired))
        subject = "joints" if len(joints) > 1 else "joint"
    fast = too_fast(plan)
    limited = [*zip(plan.names, *beyond_limits(plan), strict=True)]
    as_given = None
    if foot_given is not None:
        as_given = size(np.linalg.norm(plan.foot - foot_given, axis=1), 100.0)
    bounded = is_bounded(plan) and method != "foot-optimal"  # of a robot, too: its joints, by feet
    return Page(
        "plan",
        plan=plan,
        title=title,
        method=method,
        draws=max(map(len, plan.task.models)) - 1,
        good=not (missed or jumps_of(plan)),
        legs=parts,
        unit=unit,
        subject=subject,
        planned=planned,
        direct=direct,
        early=early,
        expected=expected,
        missed=missed,
        advice=advice(plan),
        unreachable=unreachable,
        as_given=as_given,
        jumps=jumps_of(plan),
        fast=fast,
        unknown=[each["name"] for each in fast if each["name"] in open_top_speeds(plan)],
        open=OPEN_TOP_SPEED,
        outside={name: beyond for name, _, beyond in limited if beyond},
        at_limit={name: count for name, count, beyond in limited if count and not beyond},
        notes=notes,
        worst=max(joints, key=lambda each: each["planned"]),
        busy=max(joints, key=lambda each: each["load"]),
        leg=leg_figure(plan, role) if plan.task.leg else None,
        distances=distances_figure({"": plan}, role) if plan.task.leg else None,
        feet=feet_table(parts) if parts else None,
        feet_distances=distances_figure(parts, role) if parts else None,
        joints=joints_table(plan, bounded=bounded),
        bounded=bounded,
        no_bound=no_bound(plan),
        has_expected=any(expected_errors(plan)),
        over_models=models_errors_table(plan, plan.names),
        pictures=[joint_figure(plan, role, j) for j in range(len(plan.names))],
        motions=motions_of(plan),
        requests=requests,
        models=models_table(plan.names, plan.models),
    )


def joint_speeds(plan: Plan) -> list[dict[str, Any]]:
    """Of each joint the share of the path beyond its top speed, and where it is fastest for it.

    There ``speed`` is the path's, ``top`` the joint's [deg/s], and ``load`` their ratio.
    """
    speeds = (np.degrees(each.highest) for each in plan.speeds)
    return [
        {"name": name, "share": share, "speed": speed, "top": top, "load": speed / top}
        for name, share, (speed, top) in zip(plan.names, plan.too_fast, speeds, strict=True)
    ]


def too_fast(plan: Plan) -> list[dict[str, Any]]:
    """The joints of :func:`joint_speeds` that cannot follow, the worst first."""
    fast = (each for each in joint_speeds(plan) if each["share"] >= 0.005 or each["load"] > 1.01)
    return sorted(fast, key=lambda each: -each["load"])  # less leaves no error worth a remark


def open_top_speeds(plan: Plan) -> list[str]:
    """The joints whose top speed their logs leave open: lower bounds are of their models only."""
    pairs = zip(plan.names, plan.models, strict=True)
    return [name for name, m in pairs if m.evidence and m.evidence.leaves_top_speed_open]


def jumps_of(plan: Plan) -> list[int]:
    """Samples after which the desired pose jumps."""
    leg, desired = plan.task.leg, plan.desired
    if leg is None:
        return []
    closed = np.vstack([desired, desired[:1]]) if plan.cyclic else desired
    return [int(sample) for sample in leg.jumps(closed)]


# The tables.


def size(errors: Array, factor: float = DEGREE) -> Distance:
    """The errors times a factor in two numbers."""
    return Distance(factor * error_norm(errors, "rms"), factor * error_norm(errors, "max"))


def sizes(errors: Array) -> list[Distance]:
    """The errors of each joint [rad], (n, k), in two numbers [deg]."""
    return [size(np.ascontiguousarray(column)) for column in errors.T]


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


def beyond_limits(plan: Plan) -> tuple[list[int], list[float]]:
    """How many requests of each joint are at or beyond a limit, and how far they go [deg]."""
    excess = np.maximum(plan.task.lower - plan.requests, plan.requests - plan.task.upper)
    most = excess.max(axis=0)
    beyond = np.degrees(np.where(most > AT_LIMIT, most, 0.0))
    return np.sum(excess >= -AT_LIMIT, axis=0).tolist(), beyond.tolist()


def joints_table(plan: Plan, *, bounded: bool = True) -> Table:
    """Errors, speeds and limits of joints, and lower bounds if wanted and available."""
    shift, norms, is_shift = shifted(plan.task), ("rms", "max"), plan.method == "shift"
    early = [f"{1e3 * lead:.0f}" for lead in shift.leads]
    planned, direct = (
        [tuple(f"{error:.3f}" for error in each) for each in sizes(errors)]
        for errors in (plan.errors, plan.direct - plan.desired)
    )
    pairs = zip((f"{np.degrees(rms(errors)):.3f}" for errors in shift.errors.T), early, strict=True)
    robot = [expected_words(each).replace(" (", "\n").removesuffix(")") for each in plan.expected]
    bounded = bounded and is_bounded(plan)
    gaps = [NOTHING if math.isinf(gap) else percent(gap) for gap in plan.gaps] if bounded else []
    bounds = [f"{math.degrees(each):.3f}" for each in plan.lower_bounds] if bounded else []
    fastest = (np.degrees(each.highest) for each in plan.speeds)
    limits = zip(plan.task.lower, plan.task.upper, strict=True)
    return by_columns(
        "joint",
        plan.names,
        [
            (Column("best time shift [deg]" if is_shift else "planned [deg]", norms), planned),
            is_shift and ("early [ms]", early),
            any(expected_errors(plan)) and ("on the robot [deg]", robot),
            (Column("without a plan [deg]", norms), direct),
            not is_shift and (Column("best time shift", ("rms [deg]", "early [ms]")), [*pairs]),
            bounded and (f"{bound_title(plan)} [deg]", bounds),
            bounded and ("gap", gaps),
            (
                Column("speed [deg/s]", ("desired", "top")),
                [tuple(f"{speed:.0f}" for speed in each) for each in fastest],
            ),
            ("too fast", [percent(share, 0) for share in plan.too_fast]),
            ("limits [deg]", [_limits(*np.degrees(each).tolist()) for each in limits]),
            ("at or beyond limits", list(map(str, beyond_limits(plan)[0]))),
        ],
        label="Joints",
    )


def models_errors_table(plan: Plan, labels: Sequence[str]) -> Table | None:
    """Errors of a robust plan over the models that joints may have, beside the nominal plan's."""
    unit, factor, rows = "deg", DEGREE, list[Row]()
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
    return motions_table(zip(plan.names, plan.motions, [DEGREE] * len(plan.names), strict=True))


def motions_table(motions: Iterable[tuple[str, RequestMotion, float]]) -> Table:
    """How requests move, beside the desired path: by joint, with the factor to degrees."""
    names, each, factors = zip(*motions, strict=True)
    pairs = [*zip(each, factors, strict=True)]
    return by_columns(
        "requests",
        names,
        [
            ("largest step [deg]", [f"{factor * m.largest_step:.2f}" for m, factor in pairs]),
            ("reversals/s", [f"{m.reversals_per_s:.1f}" for m in each]),
            ("length [deg]", [f"{factor * m.path_length:.1f}" for m, factor in pairs]),
            ("desired", [f"{factor * m.desired_length:.1f}" for m, factor in pairs]),
            ("outside desired [deg]", [f"{factor * m.beyond:.2f}" for m, factor in pairs]),
        ],
        label="How the requests move",
    )


def feet_table(legs: Mapping[str, Plan]) -> Table:
    """How far the foot of each leg of a robot is from its path."""
    plans, norms = legs.values(), ("rms", "at most")
    robot = [100.0 * plan.expected_foot for plan in plans if plan.expected_foot is not None]

    def cells(distances: Iterable[Array]) -> list[tuple[str, ...]]:
        return [tuple(f"{error:.3f}" for error in size(each, 100.0)) for each in distances]

    shifts = cells(shifted(plan.task).distances for plan in plans)
    return by_columns(
        "foot",
        legs,
        [
            (Column("plan [cm]", norms), cells(plan.distances for plan in plans)),
            (
                Column("without a plan [cm]", norms),
                cells(plan.direct_distances for plan in plans),
            ),
            (Column("best shift [cm]", norms), shifts),
            len(robot) == len(legs)
            and ("on the robot, rms [cm]", list(map("{:.3f}".format, robot))),
        ],
        label="Feet",
    )


# The figures.


def leg_figure(plan: Plan, role: style.Role) -> Figure:
    """The moving leg, as desired, without a plan and with it."""
    task = plan.task
    assert task.leg is not None, "only a leg moves"
    others = ((WITHOUT, plan.direct), (role, plan.predicted))
    return Timeline.of(plan).leg(
        "leg", words_of("plan_leg"), task.leg, plan.desired, others, task.desired_foot
    )


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
    desired = (plan.desired[:, j], style.DESIRED)
    return figure.joint_figure(
        Timeline.of(plan),
        f"joint_{j}",
        words_of("plan_joint", name=plan.names[j], shift=plan.method == "shift"),
        angles=[desired, (plan.direct[:, j], WITHOUT), (plan.predicted[:, j], role)],
        requests=[desired, (plan.requests[:, j], style.REQUESTED)],
        limits=(plan.task.lower[j], plan.task.upper[j]),
        clock=plan.task.leg is not None or len(plan.names) > 1,
    )
