"""New results beside old ones: differences, losses, and their limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmark.reference.record import Numbers
from benchmark.table import Table

Cases = dict[str, Numbers]

WORSE = 1e-3  # relative loss from which on a case counts as worse
RESTS = {"seconds", "steepest", "over optimum", "solver gap"}
"""Numbers that are no results, or that are differences of two results."""

ROUNDING = 1e-9  # relative change that is none


class Compared(NamedTuple):
    """One section of two runs, the cases that both have."""

    old: Cases
    new: Cases
    pace: float  # time of the same fixed work, new over old

    def pairs(self, *needed: str) -> Iterator[tuple[str, Numbers, Numbers]]:
        """The cases that have these numbers in both runs."""
        for name, new in self.new.items():
            if all(key in new and key in self.old[name] for key in needed):
                yield name, self.old[name], new

    @property
    def losses(self) -> dict[str, float]:
        """Relative loss of every case that has an error and no fewer segments than before."""
        return {
            name: max(new["error"], new["floor"]) / max(old["error"], old["floor"]) - 1.0
            for name, old, new in self.pairs("error")
            if old.get("segments") == new.get("segments")
        }

    def loss(self, function: Callable[[Any], Any]) -> float:
        """The function of all losses; nan where there are none."""
        return summed(function, [*self.losses.values()])

    @property
    def steepest(self) -> float:
        """Largest relative excess of a slope over v_max."""
        return max((new["steepest"] for _, _, new in self.pairs("steepest")), default=math.nan)

    @property
    def time_ratio(self) -> float:
        """Median of new over old processor time, at the same pace of the machine."""
        ratios = [new["seconds"] / old["seconds"] for _, old, new in self.pairs("seconds")]
        return float(np.median(ratios)) / self.pace


class Check(NamedTuple):
    """A number that has a limit, and keeps it where it is nan: there is nothing to judge."""

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        return not self.value > self.limit


def compared(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Compared]:
    """The sections of two runs that both have."""
    sections = {}
    for name in [name for name in old if name in new]:
        before, after = old[name]["cases"], new[name]["cases"]
        both = [case for case in before if case in after]
        cases = ({case: each[case] for case in both} for each in (before, after))
        sections[name] = Compared(*cases, new[name]["pace"] / old[name]["pace"])
    return sections


def table_of(sections: dict[str, Compared]) -> Table:
    """One row for each section."""
    table = Table(
        "New beside old",
        "section | cases | same bits | largest difference | median loss, % | mean, % | worst, %"
        " | best, % | worse by 0.1 %, % | more segments | fewer | slope excess | time ratio",
        note="Differences are relative to the largest entry; losses are of errors at equal counts "
        "of segments; times are processor times at the same pace of the machine.",
    )
    for name, section in sections.items():
        counts = [new["segments"] - old["segments"] for _, old, new in section.pairs("segments")]
        counted = sum(count > 0 for count in counts), sum(count < 0 for count in counts)
        summaries = (section.loss(f) for f in (np.median, np.mean, np.max, np.min, worse))
        apart = [difference(section.old[case], section.new[case]) for case in section.new]
        same = sum(each == 0.0 for each in apart)
        row = len(apart), same, max(apart, default=math.nan), *(100.0 * each for each in summaries)
        table.add(name, *row, *counted, section.steepest, section.time_ratio)
    return table


def summed(function: Callable[[Any], Any], losses: Sequence[float]) -> float:
    """The function of the losses; nan where there are none."""
    return float(function(losses)) if losses else math.nan


def worse(losses: Sequence[float]) -> float:
    """Share of the losses that count."""
    return float(np.mean(np.array(losses) > WORSE))


def difference(old: Numbers, new: Numbers) -> float:
    """Largest relative difference of any two numbers; inf where their kinds differ.

    Errors are relative to the floor at least. Rounding of two equal numbers is left out.
    """
    kept = old.keys() - RESTS
    if kept != new.keys() - RESTS or old.get("failed") != new.get("failed"):
        return math.inf
    largest, floor = 0.0, old.get("floor", 0.0)
    for name in kept - {"failed"}:
        before, after = (np.atleast_1d(np.array(run[name], float)) for run in (old, new))
        if before.shape != after.shape:
            return math.inf
        if np.array_equal(before, after, equal_nan=True):
            continue
        finite = np.isfinite(before)
        if not np.array_equal(before[~finite], after[~finite], equal_nan=True):
            return math.inf
        apart = float(np.max(np.abs(after[finite] - before[finite])))
        size = max(float(np.max(np.abs(before[finite]))), floor)
        largest = max(largest, apart / size if size > 0.0 else math.inf)
    return largest


def worst_cases(section: Compared, count: int = 5) -> list[str]:
    """The cases that lost most, in words."""
    losses = sorted(section.losses.items(), key=lambda item: -item[1])[:count]
    return [f"{name}: {100.0 * loss:+.3g} %" for name, loss in losses if loss > WORSE]


def checks_of(name: str, section: Compared) -> list[Check]:
    """The checks of this section."""
    new_failures = [
        f"{case} {after.get('failed')}"
        for case, before, after in section.pairs()
        if "failed" in after and after["failed"] != before.get("failed")
    ]
    allowed = 2.0 if name == "identification" else 1.2
    return [
        Check(f"new failures {', '.join(new_failures[:5])}".strip(), len(new_failures), 0),
        *_of_its_own(name, section),
        Check("median time ratio", section.time_ratio, allowed),
    ]


def _of_its_own(name: str, section: Compared) -> Iterator[Check]:
    """What this section, and not every one, may not get worse in."""

    def changes(number: str) -> list[tuple[Any, Any]]:
        return [(old[number], new[number]) for _, old, new in section.pairs(number)]

    if name == "fits":
        yield Check("median loss", section.loss(np.median), ROUNDING)
        yield Check("mean loss", section.loss(np.mean), 1e-4)
        yield Check("share worse by more than 0.1 %", section.loss(worse), 0.03)
    if name == "questions":
        more = sum(new > old for old, new in changes("segments"))
        yield Check("answers of more segments", more, 0)
    if name in ("fits", "questions"):
        yield Check("slope excess over v_max", section.steepest, 1e-12)
    if name == "optima":
        excess = [new for _, new in changes("over optimum")]
        yield Check("excess over the proved optimum", summed(max, excess), 0.011)
    if name in ("plans", "closed forms"):
        valid = {case for case, _, new in section.pairs("equation 13") if new["equation 13"]}
        losses = [loss for case, loss in section.losses.items() if case in valid]
        yield Check("mean loss where Equation 13 holds", summed(np.mean, losses), 2e-4)
    if name == "certificates":
        lower = [1.0 - new / old for old, new in changes("bound") if old > 0.0]
        plans = [(new["bound"], new["plan"]) for _, _, new in section.pairs("bound")]
        above = [bound / plan - 1.0 for bound, plan in plans if plan > 0.0]
        yield Check("bound below the old one", summed(max, lower), 1e-5)
        yield Check("bound above a plan", summed(max, above), ROUNDING)
    if name in ("feet", "identification"):
        yield Check("worst loss", section.loss(max), {"feet": 1e-3}.get(name, 2e-3))
    if name == "identification":
        verdicts = sum(old != new for old, new in changes("accepted"))
        yield Check("other verdicts", verdicts, 0)
