"""The page about a sweep: the Pareto front of speed and error, and the points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.evaluation.sweep import WORDS, Outcome, Swept
from planner.report.figure import Axis, Curve, Figure, Panel
from planner.report.page import Page
from planner.report.style import DIRECT, FOOT_OPTIMAL, INK, LIMIT, OPTIMAL, Role
from planner.report.table import Column, Row, Table
from planner.report.wording import words_of


def sweep_page(swept: Swept) -> Page:
    """The whole page."""
    rows = [
        Row(f"{points[0].number}", (swept.words(points[0]), f"{len(points)}", reason))
        for reason, points in list(swept.failures.items())[:20]
    ]
    columns = Column("parameters", words=True), Column("points"), Column("reason", words=True)
    failures = Table("first point", columns, tuple(rows), label="Points without a plan")
    return Page(
        "sweep",
        swept=swept,
        good=not swept.missed,
        planned=sum(each.planned for each in swept.outcomes),
        figure=front_figure(swept) if swept.front else None,
        points=points_table(swept),
        failures=failures if rows else None,
    )


def sweep_results(swept: Swept) -> list[dict[str, Any]]:
    """The columns of every point; values that a point without a plan lacks are None."""
    speed = "speed_cm_s" if swept.speed_unit == "cm/s" else "speed_factor"
    unit, front = swept.error_unit, {each.number for each in swept.front}
    return [
        {
            "point": each.number,
            **dict(zip(swept.names, each.point, strict=True)),
            **{
                name: value if math.isfinite(value) else None
                for name, value in {
                    speed: each.speed,
                    f"error_{unit}": each.error,
                    f"largest_error_{unit}": each.largest,
                    f"direct_error_{unit}": each.direct,
                    "too_fast_percent": 100.0 * each.too_fast,
                }.items()
            },
            "slowest_joint": each.slowest or None,
            "unreachable_samples": each.unreachable,
            "on_front": each.number in front,
            "reason": each.reason or None,
        }
        for each in swept.outcomes
    ]


def sweep_text(swept: Swept) -> str:
    """The sweep for people: the verdict, the front, and the first ten reasons for no plan."""
    lines = [swept.verdict]
    if swept.front:
        planned = sum(each.planned for each in swept.outcomes)
        lines.append(f"{planned} of {len(swept.outcomes)} points have a plan; the front:")
        lines.append(points_table(swept).text())
        lines.append(f"again: {swept.command(swept.best or swept.front[-1])}")
    for reason, outcomes in list(swept.failures.items())[:10]:
        more = f" and {len(outcomes) - 1} more" if len(outcomes) > 1 else ""
        lines.append(f"point {outcomes[0].number}{more}: {reason}")
    if (rest := len(swept.failures) - 10) > 0:
        lines.append(f"{rest} more reasons in points.csv")
    return "\n".join(lines)


def points_table(swept: Swept) -> Table:
    """The points of the front with their parameters, speeds and errors."""
    quantities = [WORDS[name] for name in swept.names]
    if "speed" not in swept.names:
        quantities.append(("speed", swept.speed_unit))
    quantities.append(("error", swept.error_unit))
    quantities.append(("without a plan", swept.error_unit))
    quantities.append(("too fast", ""))
    titles = [f"{words} [{unit}]" if unit else words for words, unit in quantities]
    rows = []
    for each in swept.front:
        numbers = [*each.point]
        if "speed" not in swept.names:
            numbers.append(each.speed)
        numbers += [each.error, each.direct]
        fast = f"{100.0 * each.too_fast:.0f} % {each.slowest}" if each.slowest else "nowhere"
        best = "\nbest" if each is swept.best else ""
        rows.append(Row(f"{each.number}{best}", (*(f"{value:.4g}" for value in numbers), fast)))
    return Table("point", tuple(map(Column, titles)), tuple(rows), label="The Pareto front")


def front_figure(swept: Swept) -> Figure:
    """Speed against error of every point, with the parameters under the pointer."""

    def curve(role: Role, outcomes: Sequence[Outcome], label: str, **more: Any) -> Curve:
        errors = [each.direct if role is DIRECT else each.error for each in outcomes]
        notes = tuple(f"{each.number}: {swept.words(each)}" for each in outcomes)
        speeds = np.array([each.speed for each in outcomes])
        return Curve(role, speeds, np.array(errors), label, notes=notes, **more)

    planned = [each for each in swept.outcomes if each.planned]
    low, high = (end(each.speed for each in planned) for end in (min, max))
    curves = [
        curve(DIRECT, planned, "without a plan", marks="dots", hidden=True),
        curve(OPTIMAL, planned, "planned", marks="dots"),
        curve(FOOT_OPTIMAL, swept.front, "Pareto front"),
        curve(FOOT_OPTIMAL, swept.front, "Pareto front", marks="rings"),
    ]
    if swept.requirement is not None:
        limit, every = np.full(2, swept.requirement.value), curves[1]
        ends = np.array([every.x.min(), every.x.max()]), limit
        if swept.requirement.of == "speed":
            ends = limit, np.array([0.0, every.y.max()])
        curves.insert(0, Curve(LIMIT._replace(label="required"), *ends))
    if swept.best is not None:
        curves.append(curve(INK, [swept.best], "best", marks="dots"))
    return Figure(
        "front",
        *words_of("front"),
        Axis("speed", swept.speed_unit, None if high > low else (0.9 * low, 1.1 * high)),
        (Panel(Axis("error", swept.error_unit, from_zero=True, decimals=3), tuple(curves),
               height=2.4),),
    )  # fmt: skip
