"""What a sweep comes to: speed and error of every point, and the Pareto front of both."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

Point = tuple[float, ...]
"""A value for each parameter, in their order."""


@dataclass(frozen=True)
class Outcome:
    """What a point comes to: speeds and errors in the units of the sweep.

    Attributes:
        point: The point.
        speed: How fast it is; NaN without a plan.
        error: The plan's error, in its norm, of the foot or of the worst joint.
        largest: Its largest error.
        direct: The error of the desired angles as requests.
        too_fast: Share of the path on which a joint would have to exceed its top speed.
        slowest: The joint that would; "" where none has to.
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


@dataclass(frozen=True)
class Requirement:
    """What is required of a point: at most an error, or at least a speed."""

    of: Literal["error", "speed"]
    value: float


@dataclass(frozen=True)
class Swept:
    """All points of a sweep.

    Attributes:
        file: The sweep file, as the user named it.
        names: The parameters.
        outcomes: Every point that was tried, in order.
        speed_unit: Of speeds: "cm/s", or "times" that of the path.
        error_unit: Of errors: "cm" of a foot, or "deg".
        requirement: What is required of a point; None where the whole front is sought.
    """

    file: str
    names: tuple[str, ...]
    outcomes: tuple[Outcome, ...]
    speed_unit: str
    error_unit: str
    requirement: Requirement | None = None

    @cached_property
    def front(self) -> tuple[Outcome, ...]:
        """The points than which no other is better in both, speed and error, by speed."""
        found, least = list[Outcome](), math.inf
        planned = (each for each in self.outcomes if each.planned)
        for each in sorted(planned, key=lambda each: (-each.speed, each.error)):
            if each.error < least:
                least = each.error
                found.append(each)
        return tuple(reversed(found))

    @property
    def best(self) -> Outcome | None:
        """The best point that meets the requirement; None without one."""
        kept = [each for each in self.front if not each.reason]
        if self.requirement is None or not kept:
            return None
        return kept[-1] if self.requirement.of == "error" else kept[0]

    def number(self, outcome: Outcome) -> int:
        """The number of a point, from 1."""
        return self._numbers[outcome.point]

    def command(self, outcome: Outcome) -> str:
        """The command that plans a point again, with all files of a run."""
        values = zip(self.names, outcome.point, strict=True)
        given = " ".join(f"--at {name}={value!r}" for name, value in values)
        number = self.number(outcome)
        return f"request-planner sweep {shlex.quote(self.file)} {given} --out point-{number}"

    @cached_property
    def _numbers(self) -> dict[Point, int]:
        return {each.point: number for number, each in enumerate(self.outcomes, 1)}
