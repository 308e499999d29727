"""The tables of the page about a plan."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.model.evidence import Expectation
from planner.planning.plan import Plan
from planner.planning.result import ErrorsOfModels
from planner.planning.time_shift import shifted
from planner.report.table import NOTHING, Column, Row, Table, percent, signed
from planner.trajectory import Array, Distance, error_norm, rms

if TYPE_CHECKING:
    from planner.report.figure import Timeline

AT_LIMIT = math.radians(1e-6)
"""A request this close to a limit is at it [rad]."""


def size(errors: Array, factor: float) -> Distance:
    """The errors times a factor in two numbers."""
    return Distance(factor * error_norm(errors, "rms"), factor * error_norm(errors, "max"))


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
    return plan.task.goal == "angles" and not plan.task.load_of_pose


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
        bound = float(plan.lower_bounds[j]) if is_bounded(plan) else None
        requests = plan.requests[:, j]
        speed, top_speed = plan.speeds[j].highest
        excess = np.maximum(lower - requests, requests - upper)
        beyond = float(excess.max())
        rows.append(
            JointRow(
                name=name,
                planned=planned,
                direct=direct,
                bound=None if bound is None else math.degrees(bound),
                gap=None if bound is None else float(plan.gaps[j]),
                speed=math.degrees(speed),
                top_speed=math.degrees(top_speed),
                too_fast=float(plan.too_fast[j]),
                limits=(math.degrees(lower), math.degrees(upper)),
                at_limit=int(np.sum(excess >= -AT_LIMIT)),
                beyond=math.degrees(beyond) if beyond > AT_LIMIT else 0.0,
            )
        )
    return rows


def joints_table(plan: Plan, *, bounded: bool = True) -> Table:
    """Errors, speeds and limits of joints, and lower bounds if wanted and available."""
    bounded = bounded and is_bounded(plan)
    has_expected = any(expected_errors(plan))
    is_shift = plan.method == "shift"
    columns = [
        Column("best time shift [deg]" if is_shift else "planned [deg]", ("rms", "max")),
        *([Column("early [ms]")] if is_shift else []),
        *([Column("on the robot [deg]")] if has_expected else []),
        Column("without a plan [deg]", ("rms", "max")),
        *([] if is_shift else [Column("best time shift", ("rms [deg]", "early [ms]"))]),
        *([Column("lower bound [deg]"), Column("gap")] if bounded else []),
        Column("speed [deg/s]", ("desired", "top")),
        Column("too fast"),
        Column("limits [deg]"),
        Column("at or beyond limits"),
    ]
    rows, shift = [], shifted(plan.task)
    early = zip((np.degrees(rms(errors)) for errors in shift.errors.T), shift.leads, strict=True)
    for row, expected, (error, lead) in zip(joint_rows(plan), plan.expected, early, strict=True):
        bounds = [
            NOTHING if row.bound is None else f"{row.bound:.3f}",
            NOTHING if row.gap is None or math.isinf(row.gap) else percent(row.gap),
        ]
        planned, direct = (
            tuple(f"{error:.3f}" for error in errors) for errors in (row.planned, row.direct)
        )
        early_by = f"{1e3 * lead:.0f}"
        robot = expected_words(expected).replace(" (", "\n").removesuffix(")")
        cells: list[str | tuple[str, ...]] = [
            planned,
            *([early_by] if is_shift else []),
            *([robot] if has_expected else []),
            direct,
            *([] if is_shift else [(f"{error:.3f}", early_by)]),
            *(bounds if bounded else []),
            (f"{row.speed:.0f}", f"{row.top_speed:.0f}"),
            percent(row.too_fast, 0),
            _limits(*row.limits),
            f"{row.at_limit}",
        ]
        rows.append(Row(row.name, tuple(cells)))
    return Table("joint", tuple(columns), tuple(rows), label="Joints")


def models_errors_table(
    stub: str, over_models: Mapping[str, tuple[ErrorsOfModels, ErrorsOfModels] | None], unit: str
) -> Table | None:
    """Errors of the robust plan over the models that joints may have, beside the nominal plan's.

    Args:
        stub: Title of the first column.
        over_models: Errors by row, in SI units, None for no row; there is no table without any.
        unit: Unit of the table, "deg" or "cm".
    """
    planned = {name: plans for name, plans in over_models.items() if plans is not None}
    if not planned:
        return None
    parts, factor = ("nominal", "mean", "worst"), {"deg": math.degrees(1.0), "cm": 100.0}[unit]
    columns = (
        Column(f"robust plan [{unit}]", parts),
        Column(f"plan for the nominal model [{unit}]", parts),
    )
    rows = (
        Row(name, tuple(tuple(f"{factor * error:.3f}" for error in errors) for errors in plans))
        for name, plans in planned.items()
    )
    return Table(stub, columns, tuple(rows), label="Errors over the models")


def _limits(lower: float, upper: float) -> str:
    low, high = (signed(f"{limit:.1f}").removesuffix(".0") for limit in (lower, upper))
    if math.isfinite(lower) and math.isfinite(upper):
        return f"{low} to {high}"
    if math.isfinite(lower):
        return f"at least {low}"
    return f"at most {high}" if math.isfinite(upper) else "none"


def motions_table(plan: Plan) -> Table:
    """How the requests of every joint move, beside the desired path."""
    columns = (
        Column("largest step [deg]"),
        Column("reversals per second"),
        Column("length [deg]", ("requests", "desired")),
        Column("outside the desired range [deg]"),
    )
    rows = []
    for name, motion in zip(plan.names, plan.motions, strict=True):
        step, length, desired, beyond = np.degrees(
            [motion.largest_step, motion.path_length, motion.desired_length, motion.beyond]
        )
        lengths = (f"{length:.1f}", f"{desired:.1f}")
        cells = (f"{step:.2f}", f"{motion.reversals_per_s:.1f}", lengths, f"{beyond:.2f}")
        rows.append(Row(name, cells))
    return Table("joint", columns, tuple(rows), label="How the requests move")


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


def requests_table(plan: Plan) -> Table:
    """Every request."""
    timeline = timeline_of(plan)
    rows = (
        Row(f"{timeline.step * k:.6g}", tuple(f"{angle:.3f}" for angle in angles))
        for k, angles in enumerate(np.degrees(plan.requests).tolist())
    )
    return Table(timeline.unit, tuple(map(Column, plan.names)), tuple(rows), label="Requests")


def timeline_of(plan: Plan) -> Timeline:
    """The times of the samples."""
    from planner.report.figure import Timeline  # not for the tables of a terminal

    return Timeline(plan.period, len(plan.desired), plan.cyclic)
