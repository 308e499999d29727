"""The page about a sweep: the Pareto front of speed and error, and the command of each point."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from planner.report.figure import Axis, Curve, Figure, Panel
from planner.report.page import (
    Card,
    LinkedFile,
    Page,
    Section,
    footer,
    heading,
    origin_lists,
    spoken,
    table_section,
)
from planner.report.style import DIRECT, FOOT_OPTIMAL, INK, LIMIT, OPTIMAL
from planner.report.table import Column, Row, Table

if TYPE_CHECKING:
    from planner.trajectory import Array

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
}
"""Name and unit of a parameter that is not shown by its key."""

MOST_REASONS = 20
"""Most reasons that are listed for points without a plan."""

Point = tuple[float, ...]
"""A value for each parameter, in their order."""


@dataclass(frozen=True)
class Outcome:
    """Result of a point: speeds and errors in the units of the sweep.

    Attributes:
        point: The point.
        speed: How fast it is; NaN without a plan.
        error: The plan's error, in its norm, of the foot or of the worst joint.
        largest: Its largest error.
        direct: The error of the desired angles as requests.
        too_fast: Share of the path on which a joint would have to exceed its top speed.
        slowest: That joint; "" where there is none.
        unreachable: Samples out of the leg's reach, where the settings let these be clamped.
        reason: Why there is no plan, or which requirement it misses.
    """

    point: Point
    speed: float = math.nan
    error: float = math.nan
    largest: float = math.nan
    direct: float = math.nan
    too_fast: float = math.nan
    slowest: str = ""
    unreachable: int = 0
    reason: str = ""

    @property
    def planned(self) -> bool:
        """Whether there is a plan."""
        return math.isfinite(self.error)


def _words(name: str) -> tuple[str, str]:
    """Name and unit of a parameter."""
    return WORDS.get(name, (name, ""))


@dataclass(frozen=True)
class Requirement:
    """Requirement on a point: at most an error, or at least a speed."""

    of: Literal["error", "speed"]
    value: float


@dataclass(frozen=True)
class Swept:
    """All points of a sweep.

    Attributes:
        file: The sweep file, as the user named it.
        names: The parameters.
        outcomes: Every evaluated point, in order.
        speed_unit: Unit of speeds: "cm/s", or "times" that of the path.
        error_unit: Unit of errors: "cm" of a foot, or "deg".
        requirement: Requirement on a point; None for the whole front.
    """

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

    def number(self, outcome: Outcome) -> int:
        """The number of a point, from 1."""
        return self._numbers[outcome.point]

    def command(self, outcome: Outcome) -> str:
        """The command that plans a point again, with all files of a run."""
        values = zip(self.names, outcome.point, strict=True)
        options = " ".join(f"--at {name}={value!r}" for name, value in values)
        number = self.number(outcome)
        return f"request-planner sweep {shlex.quote(self.file)} {options} --out point-{number}"

    @cached_property
    def _numbers(self) -> dict[Point, int]:
        return {each.point: number for number, each in enumerate(self.outcomes, 1)}


def sweep_page(
    swept: Swept,
    *,
    origins: Sequence[tuple[str, str]] = (),
    files: Sequence[LinkedFile] = (),
) -> str:
    """The whole page.

    Args:
        swept: The sweep.
        origins: Inputs of the sweep: pairs of a kind and a name.
        files: Files of the sweep to link to.
    """
    front = swept.front
    sections = []
    if front:
        sections += [
            Section(
                "The front",
                FRONT,
                {"table": points_table(swept, front), "commands": _commands(swept)},
            ),
            Section(
                "Parameters along the front",
                "{{ hints }}{{ figures(several) }}",
                {"several": parameter_figures(swept)},
            ),
        ]
    if failures := failures_table(swept):
        sections.append(table_section("Points without a plan", failures))
    head, _, tail = verdict(swept).partition(": ")
    return Page(
        heading="Speed against error",
        eyebrow=f"request-planner sweep · {swept.file}",
        verdict=spoken(head, tail, ": "),
        good=not missed(swept),
        cards=cards(swept),
        figure=front_figure(swept) if front else None,
        sections=sections,
        listings=origin_lists(origins, files),
        footer=footer("sweep"),
    ).html()


FRONT = """
<p>No other point that was tried is both faster and closer to its path than one of these.</p>
{{ table }}
<p class="note">Each command plans its point again, with all files of a run; the error that it
prints is that of the table.</p>
<pre>{{ commands }}</pre>
"""


def verdict(swept: Swept) -> str:
    """The answer in a few words."""
    front, best, requirement = swept.front, swept.best, swept.requirement
    if not front:
        return "No point has a plan"
    if requirement is not None:
        unit = swept.error_unit if requirement.of == "error" else swept.speed_unit
        limit = (
            f"{'at most' if requirement.of == 'error' else 'at least'} {requirement.value:g} {unit}"
        )
        if best is None:
            near = front[0] if requirement.of == "error" else front[-1]
            return f"No point has {limit}: the nearest has {sizes(swept, near)}"
        return f"The best point with {limit} has {sizes(swept, best)}: {words_of(swept, best)}"
    if len(front) == 1:
        return f"One point is best in both: {sizes(swept, front[0])}"
    slow, fast = front[0], front[-1]
    return f"{len(front)} points on the front: from {sizes(swept, slow)} to {sizes(swept, fast)}"


def missed(swept: Swept) -> str:
    """Why the sweep failed, in words; empty where it did not."""
    return verdict(swept) if not swept.front or (swept.requirement and not swept.best) else ""


def sizes(swept: Swept, outcome: Outcome) -> str:
    """Speed and error of a point."""
    speed = f"{outcome.speed:.3g} {swept.speed_unit}"
    return f"{speed} at {outcome.error:.3g} {swept.error_unit}"


def words_of(swept: Swept, outcome: Outcome) -> str:
    """The parameters of a point."""
    return ", ".join(
        f"{_words(name)[0]} {value:.4g} {_words(name)[1]}".rstrip()
        for name, value in zip(swept.names, outcome.point, strict=True)
    )


def cards(swept: Swept) -> list[Card]:
    """Key figures."""
    planned = sum(each.planned for each in swept.outcomes)
    entries = [Card(f"{planned}", "", f"of {len(swept.outcomes)} points have a plan")]
    if swept.front:
        slow, fast = swept.front[0], swept.front[-1]
        entries += [
            Card(f"{fast.speed:.3g}", swept.speed_unit,
                 f"the fastest of the front, at {fast.error:.3g} {swept.error_unit}"),
            Card(f"{slow.error:.3g}", swept.error_unit,
                 f"the least error, at {slow.speed:.3g} {swept.speed_unit}"),
            Card(f"{slow.direct / max(slow.error, 1e-9):.3g}", "times",
                 "that error without a plan, with the desired angles as requests"),
        ]  # fmt: skip
    return entries


def _commands(swept: Swept) -> str:
    """The command that plans each point of the front again, below its number."""
    return "\n".join(f"# point {swept.number(each)}\n{swept.command(each)}" for each in swept.front)


def points_table(swept: Swept, outcomes: Sequence[Outcome]) -> Table:
    """Points with their parameters, speeds and errors."""
    units = [f" [{unit}]" if unit else "" for _, unit in (_words(name) for name in swept.names)]
    columns = [
        *(
            Column(f"{_words(name)[0]}{unit}")
            for name, unit in zip(swept.names, units, strict=True)
        ),
        Column(f"speed [{swept.speed_unit}]"),
        Column(f"error [{swept.error_unit}]"),
        Column(f"without a plan [{swept.error_unit}]"),
        Column("too fast"),
    ]
    rows = []
    for each in outcomes:
        fast = f"{100.0 * each.too_fast:.0f} % {each.slowest}" if each.slowest else "nowhere"
        cells = [
            *(f"{value:.4g}" for value in each.point),
            f"{each.speed:.4g}",
            f"{each.error:.4g}",
            f"{each.direct:.4g}",
            fast,
        ]
        best = "\nbest" if each is swept.best else ""
        rows.append(Row(f"{swept.number(each)}{best}", tuple(cells)))
    return Table("point", tuple(columns), tuple(rows), label="The Pareto front")


def failures_table(swept: Swept) -> Table | None:
    """Why points have no plan, and how many; None where all have one."""
    reasons: dict[str, list[Outcome]] = {}
    for each in swept.outcomes:
        if not each.planned:
            reasons.setdefault(each.reason, []).append(each)
    rows = [
        Row(f"{swept.number(points[0])}", (words_of(swept, points[0]), f"{len(points)}", reason))
        for reason, points in list(reasons.items())[:MOST_REASONS]
    ]
    if not rows:
        return None
    headers = (Column("parameters", words=True), Column("points"), Column("reason", words=True))
    return Table("first point", headers, tuple(rows), label="Points without a plan")


def front_figure(swept: Swept) -> Figure:
    """Speed against error of every point, with the parameters under the pointer."""
    planned = [each for each in swept.outcomes if each.planned]
    front = swept.front
    speeds, errors = _columns(planned)
    notes = tuple(f"{swept.number(each)}: {words_of(swept, each)}" for each in planned)
    ahead = tuple(f"{swept.number(each)}: {words_of(swept, each)}" for each in front)
    directs = np.array([each.direct for each in planned])
    best_speeds, best_errors = _columns(front)
    curves = [
        Curve(DIRECT, speeds, directs, "without a plan", marks="dots", notes=notes,
              hidden=True),
        Curve(OPTIMAL, speeds, errors, "planned", marks="dots", notes=notes),
        Curve(FOOT_OPTIMAL, best_speeds, best_errors, "Pareto front", notes=ahead),
        Curve(FOOT_OPTIMAL, best_speeds, best_errors, "Pareto front", marks="rings", notes=ahead),
    ]  # fmt: skip
    requirement = swept.requirement
    if requirement is not None:
        low, high = (float(end) for end in (speeds.min(), speeds.max()))
        ends = ([low, high], [requirement.value] * 2)
        if requirement.of == "speed":
            ends = ([requirement.value] * 2, [0.0, float(errors.max())])
        looks = LIMIT._replace(label="required")
        curves.insert(0, Curve(looks, np.array(ends[0]), np.array(ends[1])))
    if swept.best is not None:
        x, y = _columns([swept.best])
        note = f"{swept.number(swept.best)}: {words_of(swept, swept.best)}"
        curves.append(Curve(INK, x, y, "best", marks="dots", notes=(note,)))
    return Figure(
        "front",
        "Speed against error",
        "Each point is a plan; those on the line are best: none is faster at a smaller error. "
        "Point at one for its parameters.",
        _speeds(swept, planned),
        (Panel(Axis("error", swept.error_unit, from_zero=True, decimals=3), tuple(curves),
               height=2.4),),
    )  # fmt: skip


def parameter_figures(swept: Swept) -> list[Figure]:
    """How each parameter changes along the front."""
    speeds, _ = _columns(swept.front)
    figures = []
    for j, name in enumerate(swept.names):
        words, unit = _words(name)
        values = np.array([each.point[j] for each in swept.front])
        curves = tuple(
            Curve(FOOT_OPTIMAL, speeds, values, "Pareto front", marks=marks)
            for marks in ("", "rings")
        )
        least = 0.2 * float(np.max(np.abs(values))) or 1.0
        figures.append(
            Figure(
                f"parameter_{name}",
                heading(words),
                "Of the points on the front, from the slowest to the fastest.",
                _speeds(swept, swept.front),
                (Panel(Axis(words, unit, decimals=4, least=least), curves, height=1.4),),
            )
        )
    return figures


def _speeds(swept: Swept, outcomes: Sequence[Outcome]) -> Axis:
    """The axis of speeds; of a single one, with room on both sides."""
    speeds, _ = _columns(outcomes)
    low, high = float(speeds.min()), float(speeds.max())
    ends = None if high > low else (0.9 * low, 1.1 * high)
    return Axis("speed", swept.speed_unit, ends)


def _columns(outcomes: Sequence[Outcome]) -> tuple[Array, Array]:
    speeds = np.array([each.speed for each in outcomes])
    return speeds, np.array([each.error for each in outcomes])
