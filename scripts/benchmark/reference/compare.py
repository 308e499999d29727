"""New results beside old ones: differences, losses, and their limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmark.reference.record import Numbers
from benchmark.table import Table

Cases = dict[str, Numbers]

WORSE = 1e-3
"""Relative loss from which on a case counts as worse."""

RESTS = {"seconds", "steepest", "over optimum", "solver gap"}
"""Numbers that are no results, or that are differences of two results."""

ROUNDING = 1e-9
"""Relative change that is none."""


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
    """A number that has a limit."""

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether the number keeps its limit; nan, where there is nothing to judge, does."""
        return not self.value > self.limit


def compared(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Compared]:
    """The sections of two runs that both have."""
    sections = {}
    for name in [name for name in old if name in new]:
        before, after = old[name]["cases"], new[name]["cases"]
        both = [case for case in before if case in after]
        sections[name] = Compared(
            {case: before[case] for case in both},
            {case: after[case] for case in both},
            new[name]["pace"] / old[name]["pace"],
        )
    return sections


def table_of(sections: dict[str, Compared]) -> Table:
    """One row for each section."""
    table = Table(
        "New beside old",
        (
            "cases",
            "same bits",
            "largest difference",
            "median loss, %",
            "mean, %",
            "worst, %",
            "best, %",
            "worse by 0.1 %, %",
            "more segments",
            "fewer",
            "slope excess",
            "time ratio",
        ),
        note="Differences are relative to the largest entry; losses are of errors at equal counts "
        "of segments; times are processor times at the same pace of the machine.",
        stub="section",
    )
    for name, section in sections.items():
        counts = [new["segments"] - old["segments"] for _, old, new in section.pairs("segments")]
        losses = [*section.losses.values()]
        summary = [summed(f, losses) for f in (np.median, np.mean, np.max, np.min, worse)]
        differences = [difference(section.old[case], section.new[case]) for case in section.new]
        table.add(
            name,
            len(differences),
            sum(each == 0.0 for each in differences),
            max(differences, default=math.nan),
            *(100.0 * number for number in summary),
            sum(count > 0 for count in counts),
            sum(count < 0 for count in counts),
            section.steepest,
            section.time_ratio,
        )
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
        *CHECKS[name](section),
        Check("median time ratio", section.time_ratio, allowed),
    ]


def _fits(section: Compared) -> list[Check]:
    losses = [*section.losses.values()]
    return [
        Check("median loss", summed(np.median, losses), ROUNDING),
        Check("mean loss", summed(np.mean, losses), 1e-4),
        Check("share worse by more than 0.1 %", summed(worse, losses), 0.03),
        Check("slope excess over v_max", section.steepest, 1e-12),
    ]


def _optima(section: Compared) -> list[Check]:
    excess = [new["over optimum"] for _, _, new in section.pairs("over optimum")]
    return [Check("excess over the proved optimum", summed(max, excess), 0.011)]


def _questions(section: Compared) -> list[Check]:
    more = [new["segments"] > old["segments"] for _, old, new in section.pairs("segments")]
    return [
        Check("answers of more segments", sum(more), 0),
        Check("slope excess over v_max", section.steepest, 1e-12),
    ]


def _plans(section: Compared) -> list[Check]:
    valid = {name for name, _, new in section.pairs("equation 13") if new["equation 13"]}
    losses = [loss for name, loss in section.losses.items() if name in valid]
    return [Check("mean loss where Equation 13 holds", summed(np.mean, losses), 2e-4)]


def _feet(section: Compared) -> list[Check]:
    return [Check("worst loss", summed(max, [*section.losses.values()]), 1e-3)]


def _certificates(section: Compared) -> list[Check]:
    pairs = [*section.pairs("bound")]
    lower = [1.0 - new["bound"] / old["bound"] for _, old, new in pairs if old["bound"] > 0.0]
    above = [new["bound"] / new["plan"] - 1.0 for _, _, new in pairs if new["plan"] > 0.0]
    return [
        Check("bound below the old one", summed(max, lower), 1e-5),
        Check("bound above a plan", summed(max, above), ROUNDING),
    ]


def _identification(section: Compared) -> list[Check]:
    changed = [new["accepted"] != old["accepted"] for _, old, new in section.pairs("accepted")]
    return [
        Check("worst loss", summed(max, [*section.losses.values()]), 2e-3),
        Check("other verdicts", sum(changed), 0),
    ]


CHECKS: dict[str, Callable[[Compared], list[Check]]] = {
    "fits": _fits,
    "optima": _optima,
    "questions": _questions,
    "plans": _plans,
    "closed forms": _plans,
    "feet": _feet,
    "certificates": _certificates,
    "identification": _identification,
}
"""The checks of each section: it may not get worse by more than this."""
