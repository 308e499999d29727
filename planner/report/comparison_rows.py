"""The rows of a comparison's tables, in words: what the terminal and the page both show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from planner.evaluation.checks import Check
from planner.evaluation.differences import Reason
from planner.evaluation.foot_comparison import FootComparison
from planner.evaluation.joint_comparison import METHODS, JointComparison
from planner.report.text_table import NOTHING, number, percent

SHOWN = "closed_form_paper"
"""The closed form whose differences are listed and drawn; JSON has those of both rules."""

WORTH_A_ROW = 0.01
"""Share in the squared difference from which on an interval is listed."""

MOST_ROWS = 10
"""Intervals listed per joint, those with the largest shares."""

REASON_WORDS: Mapping[Reason, str] = {
    "saturated": "joint at top speed",
    "limit": "request at a limit",
    "corner": "corner of the lines",
    "after_end": "after the end",
    "free": "none of these",
}
"""What the reasons are called, in tables and pictures."""

BETTER_WORDS = {"closed_form": "closed form", "optimal": "optimised", "neither": "neither"}


class Row(NamedTuple):
    """A row of a table.

    Attributes:
        subject: The joint that it is about, or the foot.
        about: What of it: a plan, a bound, a span of requests.
        cells: The other cells.
        bound: Whether it is about what no plan can go below.
    """

    subject: str
    about: str
    cells: tuple[str, ...]
    bound: bool = False


class Table(NamedTuple):
    """A table.

    Attributes:
        about: What its rows are about.
        header: Names of the other columns.
        rows: The rows; those with the same subject follow one another.
    """

    about: str
    header: tuple[str, ...]
    rows: tuple[Row, ...]

    def by_subject(self) -> list[tuple[str, list[Row]]]:
        """The rows of every subject together."""
        return [(name, list(rows)) for name, rows in groupby(self.rows, attrgetter("subject"))]

    @property
    def single(self) -> bool:
        """Whether all rows have the same subject."""
        return len(self.by_subject()) == 1


def plans_table(joints: Sequence[JointComparison]) -> Table:
    """How good each plan is, and what none can go below."""
    rows = []
    for joint in joints:
        for method, plan in joint.plans.items():
            apart = np.degrees(plan.requests - joint.plans["optimal"].requests)
            most = int(np.argmax(np.abs(apart)))
            differs = (
                (NOTHING,) * 3
                if method == "optimal"
                else (
                    f"{math.sqrt(float(np.mean(apart**2))):.2f}",
                    f"{abs(apart[most]):.2f}",
                    f"{most}",
                )
            )
            errors = (f"{math.degrees(plan.rms):.3f}", f"{math.degrees(plan.max_error):.3f}")
            gap = percent(joint.gap(method))
            rows.append(Row(joint.name, METHODS[method], (*errors, gap, *differs)))
        column = 0 if joint.plans["optimal"].norm == "rms" else 1
        for level, bound in joint.bounds.items():
            cells = [""] * 6
            cells[column] = f"{math.degrees(bound):.3f}"
            unsolved = joint.certificates[level].solver_gap
            said = f"{level}, solver gap {percent(unsolved)}" if unsolved else level
            rows.append(Row(joint.name, f"no plan below ({said})", tuple(cells), bound=True))
    header = ("rms [deg]", "max [deg]", "gap", "requests differ: rms [deg]", "most [deg]", "at")
    return Table("joint, plan", header, tuple(rows))


def _gap(foot: FootComparison, method: str) -> str:
    """How far above the foot's bound a plan within the limits is."""
    gap = foot.gap(method)
    return NOTHING if gap is None else percent(gap)


def foot_table(foot: FootComparison) -> Table:
    """Where the plans bring the foot."""
    rows = [
        Row(
            "foot",
            METHODS[method],
            (
                f"{100.0 * plan.outcome.distance.rms:.3f}",
                f"{100.0 * plan.outcome.distance.max:.3f}",
                _gap(foot, method),
                *(
                    [NOTHING] * 2
                    if method == "foot_optimal"
                    else [number(math.degrees(apart)) for apart in foot.differences[method]]
                ),
            ),
        )
        for method, plan in foot.plans.items()
    ]
    if foot.bound is not None:
        cells = [""] * 5
        cells[0 if foot.norm == "rms" else 1] = f"{100.0 * foot.bound:.3f}"
        rows.append(Row("foot", "no plan within the limits below", tuple(cells), bound=True))
    header = ("rms [cm]", "max [cm]", "gap", "requests differ: rms [deg]", "most [deg]")
    return Table("foot, plan", header, tuple(rows))


def differences_table(joints: Sequence[JointComparison]) -> Table:
    """Where the requests differ, and why."""
    rows = []
    for joint in joints:
        intervals = joint.differences[SHOWN].intervals
        largest = sorted(intervals, key=attrgetter("share"), reverse=True)[:MOST_ROWS]
        rows += [
            Row(
                joint.name,
                f"requests {interval.start} to {interval.end}",
                (
                    REASON_WORDS[interval.reason],
                    f"{100.0 * interval.share:.0f} %",
                    f"{math.degrees(interval.closed_form_rms):.3f}",
                    f"{math.degrees(interval.optimal_rms):.3f}",
                    BETTER_WORDS[interval.better],
                ),
            )
            for interval in intervals
            if interval in largest and interval.share >= WORTH_A_ROW
        ]
    header = ("why they differ", "share", "rms [deg]", "optimised", "tracks better")
    return Table(f"{METHODS[SHOWN]}, and optimised", header, tuple(rows))


def worst_checks(checks: Sequence[Check]) -> list[Check]:
    """Of every claim, the check that is closest to breaking it, or every one that does."""
    claims: dict[tuple[str, str], list[Check]] = {}
    for each in checks:
        claims.setdefault((each.name, each.unit), []).append(each)
    return [
        each
        for same in claims.values()
        for each in [each for each in same if not each.passed] or [max(same, key=_room_used)]
    ]


def tolerance_reasons(checks: Sequence[Check]) -> list[Check]:
    """One check for every reason of a tolerance."""
    return list({each.reason: each for each in checks}.values())


def notes(joints: Sequence[JointComparison]) -> Iterator[str]:
    """What must be known of single plans."""
    for joint in joints:
        for method, answer in joint.answers.items():
            if answer.elsewhere > 0.0:
                yield (
                    f"{joint.name}, {METHODS[method]}: every request saturates the joint, "
                    "which so keeps whatever angle it starts with; another steady cycle is "
                    f"{math.degrees(answer.elsewhere):.2f} deg away"
                )


def _room_used(check: Check) -> float:
    return check.value - check.tolerance
