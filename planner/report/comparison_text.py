"""A cross-check as text: how good each plan is, where requests differ and why, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from operator import attrgetter

import numpy as np

from planner.evaluation.checks import Check
from planner.evaluation.cross_check import CrossCheck
from planner.evaluation.differences import Reason
from planner.evaluation.foot_comparison import FootComparison
from planner.evaluation.joint_comparison import METHODS, JointComparison
from planner.report.text_table import NOTHING, number, percent, text_table

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


def comparison_text(check: CrossCheck) -> str:
    """Everything that a terminal should show."""
    parts = [_plans(check.joints)]
    if check.foot is not None:
        parts.append(_foot(check.foot))
    parts += [_differences(check.joints), _verdict(check.checks)]
    parts += list(_notes(check.joints))
    return "\n\n".join(parts)


def verdict_line(check: CrossCheck) -> str:
    """How many checks hold, and which do not."""
    held = f"{len(check.checks) - len(check.failures)} of {len(check.checks)} checks hold"
    if check.passed:
        return f"passed: {held}"
    first = check.failures[0]
    plan = f", {first.plan}" if first.plan else ""
    return (
        f"failed: {held}; {first.subject}{plan}: {first.name}: got {first.value:.3g} "
        f"{first.unit}, tolerance {first.tolerance:.2g} {first.unit}"
    )


def _plans(joints: Sequence[JointComparison]) -> str:
    rows = []
    for joint in joints:
        for method, plan in joint.plans.items():
            apart = np.degrees(plan.requests - joint.plans["optimal"].requests)
            most = int(np.argmax(np.abs(apart)))
            same = method == "optimal"
            rows.append(
                [
                    f"{joint.name}, {METHODS[method]}",
                    f"{math.degrees(plan.rms):.3f}",
                    f"{math.degrees(plan.max_error):.3f}",
                    percent(joint.gap(method)),
                    NOTHING if same else f"{math.sqrt(float(np.mean(apart**2))):.2f}",
                    NOTHING if same else f"{abs(apart[most]):.2f}",
                    NOTHING if same else f"{most}",
                ]
            )
        column = 0 if joint.plans["optimal"].norm == "rms" else 1
        for level, bound in joint.bounds.items():
            cells = ["", ""]
            cells[column] = f"{math.degrees(bound):.3f}"
            unsolved = joint.certificates[level].solver_gap
            said = f"{level}, solver gap {percent(unsolved)}" if unsolved else level
            rows.append([f"{joint.name}, no plan below ({said})", *cells, "", "", "", ""])
    header = ["joint, plan", "rms [deg]", "max [deg]", "gap"]
    return text_table([*header, "requests differ: rms [deg]", "most [deg]", "at"], rows)


def _foot(foot: FootComparison) -> str:
    rows = [
        [
            f"foot, {METHODS[method]}",
            f"{100.0 * plan.outcome.distance.rms:.3f}",
            f"{100.0 * plan.outcome.distance.max:.3f}",
            *(
                [NOTHING] * 2
                if method == "foot_optimal"
                else [number(math.degrees(apart)) for apart in foot.differences[method]]
            ),
        ]
        for method, plan in foot.plans.items()
    ]
    header = ["foot, plan", "rms [cm]", "max [cm]", "requests differ: rms [deg]", "most [deg]"]
    return text_table(header, rows)


def _differences(joints: Sequence[JointComparison]) -> str:
    rows = []
    for joint in joints:
        intervals = joint.differences[SHOWN].intervals
        largest = sorted(intervals, key=attrgetter("share"), reverse=True)[:MOST_ROWS]
        rows += [
            [
                f"{joint.name}, requests {interval.start} to {interval.end}",
                REASON_WORDS[interval.reason],
                f"{100.0 * interval.share:.0f} %",
                f"{math.degrees(interval.closed_form_rms):.3f}",
                f"{math.degrees(interval.optimal_rms):.3f}",
                BETTER_WORDS[interval.better],
            ]
            for interval in intervals
            if interval in largest and interval.share >= WORTH_A_ROW
        ]
    header = [f"{METHODS[SHOWN]}, and optimised", "why they differ", "share"]
    return text_table([*header, "rms [deg]", "optimised", "tracks better"], rows)


def _verdict(checks: Sequence[Check]) -> str:
    """One row per claim: the plan that is closest to breaking it, or every one that does."""
    claims: dict[tuple[str, str], list[Check]] = {}
    for each in checks:
        claims.setdefault((each.name, each.unit), []).append(each)
    rows = [
        [
            each.name,
            f"{each.value:.1e}",
            f"{each.tolerance:.1e} {each.unit}",
            "yes" if each.passed else "NO",
            ", ".join(part for part in (each.subject, each.plan) if part),
        ]
        for same in claims.values()
        for each in [each for each in same if not each.passed] or [max(same, key=_room_used)]
    ]
    why = {each.reason: each for each in checks}
    reasons = [f"  {each.unit}, {each.name}: {reason}" for reason, each in why.items()]
    table = text_table(["check", "worst", "tolerance", "holds", "where"], rows)
    return "\n".join([table, "tolerances:", *reasons])


def _room_used(check: Check) -> float:
    return check.value - check.tolerance


def _notes(joints: Sequence[JointComparison]) -> Iterator[str]:
    for joint in joints:
        for method, answer in joint.answers.items():
            if answer.elsewhere > 0.0:
                yield (
                    f"note: {joint.name}, {METHODS[method]}: every request saturates the joint, "
                    "which so keeps whatever angle it starts with; another steady cycle is "
                    f"{math.degrees(answer.elsewhere):.2f} deg away"
                )
