"""A comparison of closed form and optimised requests: its tables, its text and its page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from kinematics.leg import Leg
from planner.evaluation.checks import AGREES, Check, beyond_limits
from planner.evaluation.cross_check import (
    METHODS,
    SECOND,
    CrossCheck,
    FootComparison,
    JointComparison,
)
from planner.model.evidence import untested_words
from planner.report import figure, style
from planner.report.figure import Axis, Figure, Panel, Timeline, line
from planner.report.page import Page, models_table
from planner.report.table import NOTHING, Column, Row, Table, number, percent
from planner.report.wording import words_of
from planner.trajectory import error_norm, index_of_largest

SHOWN = "closed_form_paper"
"""The closed form that is drawn."""

FOOT_ROLES = {
    SHOWN: style.CLOSED_FORM,
    "optimal": style.OPTIMAL,
    "foot_optimal": style.FOOT_OPTIMAL,
}
"""The plans whose feet are drawn."""


def comparison_page(
    check: CrossCheck,
    *,
    title: str = "",
    leg: Leg | None = None,
    unreachable: int = 0,
    notes: Sequence[str] = (),
) -> Page:
    """The whole page: verdict and key figures first, sources last; with a leg, it moves."""
    joints, foot = check.joints, check.foot
    names = [joint.name for joint in joints]
    excesses = {
        joint.name: math.degrees(beyond_limits(joint.plans[SHOWN].requests, joint.limits))
        for joint in joints
        if joint.limits is not None
    }
    methods = [method for method in (SHOWN, "optimal", SECOND) if method in check.methods]
    expected = [joint.plans["optimal"].expected.error for joint in joints]
    feet = foot and [foot.plans[method].distances for method in ("optimal", "foot_optimal")]
    pictures = [joint_figure(check, joint, j) for j, joint in enumerate(joints)]
    return Page(
        "comparison",
        check=check,
        title=title or ", ".join(names),
        leg=leg,
        good=check.passed,
        zero=not all(joint.bound for joint in joints),
        gaps={method: above_bound(check, method) for method in methods},
        apart=max(math.degrees(np.max(np.abs(joint.difference(SHOWN)))) for joint in joints),
        failures=[*map(failure_words, check.failures)],
        unreachable=unreachable,
        # more than rounding of degrees
        beyond={name: excess for name, excess in excesses.items() if excess > 1e-7},
        notes=plan_notes(joints),
        more=notes,
        moving=leg_figure(check, foot, leg) if foot is not None and leg else None,
        agreement=max(each.value for each in check.checks if each.name == AGREES),
        foot=feet and [100.0 * error_norm(each, check.norm) for each in feet],
        foot_gap=foot and foot.gap("foot_optimal"),
        worst=max(joints, key=lambda joint: joint.plans["optimal"].error),
        plans=plans_table(joints),
        feet=None if foot is None else foot_table(foot),
        has_expected=bool(np.isfinite(expected).any()),
        pictures=pictures if foot is None else [*pictures, foot_figure(check, foot)],
        table=checks_table(check.checks),
        reasons=tolerance_reasons(check.checks),
        models=models_table(names, [joint.model for joint in joints]),
    )


def above_bound(check: CrossCheck, method: str) -> dict[str, Any]:
    """The joints' gaps, from the smallest to the largest; the error [deg] of a bound of zero."""
    errors = [joint.plans[method].error for joint in check.joints if not joint.bound]
    if errors:
        return {"degrees": math.degrees(max(errors)), "gap": ""}
    gaps = [joint.gap(method) for joint in check.joints]
    least, most = percent(min(gaps)), percent(max(gaps))
    gap = least if least == most else f"{least.removesuffix(' %')} – {most}"
    return {"degrees": None, "gap": gap}


# The tables, and the text of a terminal.


def comparison_text(check: CrossCheck) -> str:
    """The text for a terminal."""
    tables = [plans_table(check.joints)]
    if check.foot is not None:
        tables.append(foot_table(check.foot))
    reasons = [
        f"  {unit}, {names}: {reason}" for unit, names, reason in tolerance_reasons(check.checks)
    ]
    checks = "\n".join([checks_table(check.checks).text(), "tolerances:", *reasons])
    lines = [f"note: {note}" for note in plan_notes(check.joints)]
    return "\n\n".join([*(table.text() for table in tables), checks, *lines])


def verdict_line(check: CrossCheck) -> str:
    """The number of checks that hold, and the first that does not."""
    count = f"{len(check.checks) - len(check.failures)} of {len(check.checks)} checks hold"
    return (
        f"failed: {count}; {failure_words(check.failures[0])}"
        if check.failures
        else f"passed: {count}"
    )


def failure_words(check: Check) -> str:
    """A check that does not hold."""
    plan = f", {check.plan}" if check.plan else ""
    return (
        f"{check.subject}{plan}: {check.name}: got {check.value:.3g} {check.tolerance.unit}, "
        f"tolerance {check.tolerance.value:.2g} {check.tolerance.unit}"
    )


def plans_table(joints: Sequence[JointComparison]) -> Table:
    """How good each plan is, and the lower bounds on its error."""
    rows = []
    has_expected = any(math.isfinite(joint.plans["optimal"].expected.error) for joint in joints)
    for joint in joints:
        for method in joint.plans:
            numbers, apart = joint.numbers(method), np.abs(joint.difference(method))
            cells = [number(numbers["rms_deg"], 3), number(numbers["max_deg"], 3)]
            cells += [number(numbers["expected_rms_deg"], 3)] * has_expected
            difference = [
                number(numbers["request_difference_rms_deg"]),
                number(numbers["largest_request_difference_deg"]),
                f"{index_of_largest(apart)}",
            ]
            cells += [percent(joint.gap(method))]
            cells += [NOTHING] * 3 if method == "optimal" else difference
            rows.append(Row(METHODS[method], tuple(cells), joint.name))
        for level, bound in joint.bounds.items():
            solver_gap = joint.certificates[level].solver_gap
            which = f"{level}, solver gap {percent(solver_gap)}" if solver_gap else level
            size = f"{math.degrees(bound):.3f}"
            errors = ("", size) if joint.plans["optimal"].norm == "max" else (size, "")
            row = (*errors, *[""] * (4 + has_expected))
            rows.append(Row(f"lower bound ({which})", row, joint.name, "bound"))
    titles = (
        *("rms [deg]", "max [deg]", *["on the robot [deg]"] * has_expected, "gap"),
        *("requests differ: rms [deg]", "most [deg]", "at request"),
    )
    return Table("joint, plan", tuple(map(Column, titles)), tuple(rows), label="Plans")


def foot_table(foot: FootComparison) -> Table:
    """Errors of the foot under the plans."""
    rows = []
    for method, plan in foot.plans.items():
        gap = foot.gap(method)
        difference = [NOTHING] * 2
        if method != "foot_optimal":
            difference = [number(math.degrees(value)) for value in foot.differences[method]]
        errors = tuple(f"{100.0 * each[0]:.3f}" for each in (plan.rms, plan.max_error))
        cells = (*errors, NOTHING if gap is None else percent(gap), *difference)
        rows.append(Row(METHODS[method], cells, "foot"))
    if foot.bound is not None:
        bound = [""] * 5
        bound[foot.norm == "max"] = f"{100.0 * foot.bound:.3f}"
        rows.append(Row("lower bound within the limits", tuple(bound), "foot", "bound"))
    titles = ("rms [cm]", "max [cm]", "gap", "requests differ: rms [deg]", "most [deg]")
    return Table("foot, plan", tuple(map(Column, titles)), tuple(rows), label="Foot")


def checks_table(checks: Sequence[Check]) -> Table:
    """One row per claim: the plan that is closest to breaking it, or every one that does."""
    claims: dict[tuple[str, str], list[Check]] = {}
    for each in checks:
        claims.setdefault((each.name, each.tolerance.unit), []).append(each)
    rows = []
    for same in claims.values():
        worst = max(same, key=lambda each: each.value - each.tolerance.value)
        for each in [each for each in same if not each.passed] or [worst]:
            where = ", ".join(part for part in (each.subject, each.plan) if part)
            where = "nowhere, but for rounding" if each.is_rounding else where
            tolerance = f"{each.tolerance.value:.1e} {each.tolerance.unit}"
            holds = "yes" if each.passed else "NO"
            cells = (f"{each.value:.1e}", tolerance, holds, where)
            rows.append(Row(each.name, cells, kind="" if each.passed else "broken"))
    columns = (*map(Column, ("worst", "tolerance", "holds")), Column("where", words=True))
    return Table("check", columns, tuple(rows), label="Checks")


def tolerance_reasons(checks: Sequence[Check]) -> list[tuple[str, str, str]]:
    """Every reason of a tolerance: the unit and the names of its checks, and the reason."""
    names: dict[tuple[str, str], dict[str, None]] = {}
    for each in checks:
        names.setdefault(each.tolerance[1:], {})[each.name] = None
    return [(unit, "; ".join(each), reason) for (unit, reason), each in names.items()]


def plan_notes(joints: Sequence[JointComparison]) -> Iterator[str]:
    """Notes on single plans."""
    names = [joint.name for joint in joints]
    if words := untested_words(names, [joint.plans["optimal"].expected for joint in joints]):
        yield words
    for joint in joints:
        for method, answer in joint.answers.items():
            if answer.elsewhere > 0.0:
                yield (
                    f"{joint.name}, {METHODS[method]}: every request saturates the joint, "
                    "which so keeps whatever angle it starts with; another steady cycle is "
                    f"{math.degrees(answer.elsewhere):.2f} deg away"
                )


# The figures.


def joint_figure(check: CrossCheck, joint: JointComparison, j: int) -> Figure:
    """A joint: its angles, its requests, and how far these differ."""
    timeline = _timeline_of(check)
    plans = [(joint.plans[SHOWN], style.CLOSED_FORM), (joint.plans["optimal"], style.OPTIMAL)]
    look = style.INK._replace(label="difference", width=1.3)
    zero = line((0.0, timeline.step * timeline.last), (0.0, 0.0))
    difference = (zero, timeline.curve(np.degrees(joint.difference(SHOWN)), look, held=True))
    title = "requests, closed form − optimised"
    return figure.joint_figure(
        timeline,
        f"joint_{j}",
        words_of("comparison_joint", name=joint.name),
        angles=[(joint.desired, style.DESIRED), *((plan.predicted, role) for plan, role in plans)],
        requests=[(plan.requests, role) for plan, role in plans],
        limits=joint.limits,
        below=[Panel(Axis("difference", "deg"), difference, title, height=0.8)],
    )


def foot_figure(check: CrossCheck, foot: FootComparison) -> Figure:
    """How far the foot is from its desired position, under the plans."""
    timeline = _timeline_of(check)
    curves = [
        timeline.curve(100.0 * foot.plans[method].distances, role)
        for method, role in FOOT_ROLES.items()
    ]
    return figure.foot_figure(timeline, {"": curves})


def leg_figure(check: CrossCheck, foot: FootComparison, leg: Leg) -> Figure:
    """The leg as desired, and under the plans."""
    desired = leg.joint_positions(np.column_stack([joint.desired for joint in check.joints]))
    others = [
        (role, leg.joint_positions(foot.plans[method].predicted))
        for method, role in FOOT_ROLES.items()
    ]
    return _timeline_of(check).leg("leg", words_of("comparison_leg"), desired, others)


def _timeline_of(check: CrossCheck) -> Timeline:
    return Timeline(check.period, len(check.joints[0].desired), check.cyclic)
