"""A sweep and its page: the Pareto front of speed and error, and the command of each point."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from planner.report.figure import Axis, Curve, Figure, Panel
from planner.report.page import Page
from planner.report.style import DIRECT, FOOT_OPTIMAL, INK, LIMIT, OPTIMAL, Role
from planner.report.table import Column, Row, Table
from planner.report.wording import words_of

WORDS = {
    "length": ("half stroke", "m"),
    "height": ("height", "m"),
    "forward": ("forward", "m"),
    "sideways": ("sideways", "m"),
    "hip_height": ("hip height", "m"),
    "ground_fraction": ("part on the ground", ""),
    "heading_deg": ("heading", "deg"),
    "period_s": ("period", "s"),
    "speed": ("speed", "times"),
    "smoothness": ("smoothness", ""),
}
"""Name and unit of each parameter."""

Point = tuple[float, ...]
"""A value for each parameter, in their order."""


@dataclass(frozen=True)
class Outcome:
    """Result of a point: speeds and errors in the units of the sweep."""

    point: Point
    speed: float = math.nan  # how fast it is; NaN without a plan
    error: float = math.nan  # the plan's error, in its norm, of the foot or of the worst joint
    largest: float = math.nan  # its largest error
    direct: float = math.nan  # the error of the desired angles as requests

    # share of the path on which a joint would have to exceed its top speed
    too_fast: float = math.nan
    slowest: str = ""  # that joint; "" where there is none
    unreachable: int = 0  # samples out of the leg's reach, where the settings let these be clamped
    reason: str = ""  # why there is no plan, or which requirement it misses
    number: int = 1  # its number among the points of a sweep, from 1

    @property
    def planned(self) -> bool:
        """Whether there is a plan."""
        return math.isfinite(self.error)


@dataclass(frozen=True)
class Requirement:
    """Requirement on a point: at most an error, or at least a speed."""

    of: Literal["error", "speed"]
    value: float

    def missed_by(self, outcome: Outcome) -> str:
        """The reason if a planned point misses it; empty otherwise."""
        if self.of == "speed":
            return f"speed below {self.value:g}" if outcome.speed < self.value else ""
        if outcome.error <= self.value:
            return ""
        slow = (
            f"; {outcome.slowest} would have to exceed its top speed on "
            f"{100.0 * outcome.too_fast:.0f} % of the path"
        )
        return f"error above {self.value:g}{slow if outcome.slowest else ''}"


@dataclass(frozen=True)
class Swept:
    """All points of a sweep in order; speeds are "cm/s" or "times" that of the path."""

    file: str
    names: tuple[str, ...]
    outcomes: tuple[Outcome, ...]
    speed_unit: str
    error_unit: str
    requirement: Requirement | None = None

    @cached_property
    def front(self) -> tuple[Outcome, ...]:
        """The Pareto-optimal points in speed and error, by speed."""
        points, least = list[Outcome](), math.inf
        planned = (each for each in self.outcomes if each.planned)
        for each in sorted(planned, key=lambda each: (-each.speed, each.error)):
            if each.error < least:
                least = each.error
                points.append(each)
        return tuple(reversed(points))

    @property
    def best(self) -> Outcome | None:
        """The best point that meets the requirement; None without one."""
        points = [each for each in self.front if not each.reason]
        if self.requirement is None or not points:
            return None
        return points[-1] if self.requirement.of == "error" else points[0]

    @cached_property
    def failures(self) -> dict[str, list[Outcome]]:
        """The points without a plan, by their reason."""
        reasons: dict[str, list[Outcome]] = {}
        for each in self.outcomes:
            if not each.planned:
                reasons.setdefault(each.reason, []).append(each)
        return reasons

    @property
    def verdict(self) -> str:
        """The answer in a few words."""
        if not self.front:
            return f"None of {len(self.outcomes)} points has a plan"
        slow, fast = self.front[0], self.front[-1]
        if self.requirement is not None:
            value, best = self.requirement.value, self.best
            nearest, limit = slow, f"at most {value:g} {self.error_unit}"
            if self.requirement.of == "speed":
                nearest, limit = fast, f"at least {value:g} {self.speed_unit}"
            if best is None:
                return f"No point has {limit}: the nearest has {self.sizes(nearest)}"
            return f"The best point with {limit} has {self.sizes(best)}: {self.words(best)}"
        if len(self.front) == 1:
            return f"One point is best in both: {self.sizes(slow)}"
        ends = f"from {self.sizes(slow)} to {self.sizes(fast)}"
        return f"{len(self.front)} points on the front: {ends}"

    @property
    def missed(self) -> str:
        """Why the sweep failed, in words; empty where it did not."""
        failed = not self.front or (self.requirement is not None and self.best is None)
        return self.verdict if failed else ""

    def sizes(self, outcome: Outcome) -> str:
        """Speed and error of a point."""
        speed = f"{outcome.speed:.3g} {self.speed_unit}"
        return f"{speed} at {outcome.error:.3g} {self.error_unit}"

    def words(self, outcome: Outcome) -> str:
        """The parameters of a point."""
        values = zip((WORDS[name] for name in self.names), outcome.point, strict=True)
        return ", ".join(f"{name} {value:.4g} {unit}".rstrip() for (name, unit), value in values)

    def command(self, outcome: Outcome) -> str:
        """The command that plans a point again, with all files of a run."""
        values = zip(self.names, outcome.point, strict=True)
        options = " ".join(f"--at {name}={value!r}" for name, value in values)
        folder = f"point-{outcome.number}"
        return f"request-planner sweep {shlex.quote(self.file)} {options} --out {folder}"


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
