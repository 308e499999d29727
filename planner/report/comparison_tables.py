"""The tables of a comparison, for the terminal and for the page alike."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from planner.evaluation.checks import Check
from planner.evaluation.cross_check import METHODS, CrossCheck, FootComparison, JointComparison
from planner.model.evidence import untested_words
from planner.report.table import NOTHING, Column, Row, Table, number, percent
from planner.trajectory import index_of_largest

SHOWN = "closed_form_paper"
"""The closed form that is drawn."""


def comparison_text(check: CrossCheck) -> str:
    """The text for a terminal."""
    tables = [plans_table(check.joints)]
    if check.foot is not None:
        tables.append(foot_table(check.foot))
    reasons = [
        f"  {unit}, {names}: {reason}" for unit, names, reason in tolerance_reasons(check.checks)
    ]
    checks = "\n".join([checks_table(check.checks).text(), "tolerances:", *reasons])
    lines = [f"note: {note}" for note in notes(check.joints)]
    return "\n\n".join([*(table.text() for table in tables), checks, *lines])


def verdict_line(check: CrossCheck) -> str:
    """The number of checks that hold, and the first that does not."""
    count = f"{len(check.checks) - len(check.failures)} of {len(check.checks)} checks hold"
    if check.passed:
        return f"passed: {count}"
    return f"failed: {count}; {failure_words(check.failures[0])}"


def failure_words(check: Check) -> str:
    """A check that does not hold."""
    plan = f", {check.plan}" if check.plan else ""
    return (
        f"{check.subject}{plan}: {check.name}: got {check.value:.3g} {check.unit}, "
        f"tolerance {check.tolerance:.2g} {check.unit}"
    )


def plans_table(joints: Sequence[JointComparison]) -> Table:
    """How good each plan is, and the lower bounds on its error."""
    rows = []
    has_expected = any(math.isfinite(joint.plans["optimal"].expected.error) for joint in joints)
    for joint in joints:
        for method, plan in joint.plans.items():
            apart = np.degrees(joint.difference(method))
            most = index_of_largest(np.abs(apart))
            difference = (NOTHING,) * 3
            if method != "optimal":
                rms = math.sqrt(float(np.mean(apart**2)))
                difference = (f"{rms:.2f}", f"{abs(apart[most]):.2f}", f"{most}")
            errors = (f"{math.degrees(plan.rms):.3f}", f"{math.degrees(plan.max_error):.3f}")
            expected = math.degrees(plan.expected.error)
            robot = (number(expected, 3),) * has_expected
            row = (*errors, *robot, percent(joint.gap(method)), *difference)
            rows.append(Row(METHODS[method], row, joint.name))
        column = 0 if joint.plans["optimal"].norm == "rms" else 1
        for level, bound in joint.bounds.items():
            solver_gap = joint.certificates[level].solver_gap
            which = f"{level}, solver gap {percent(solver_gap)}" if solver_gap else level
            cells = _only(f"{math.degrees(bound):.3f}", column, 6 + has_expected)
            rows.append(Row(f"lower bound ({which})", cells, joint.name, "bound"))
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
        cells = _only(f"{100.0 * foot.bound:.3f}", 0 if foot.norm == "rms" else 1, 5)
        rows.append(Row("lower bound within the limits", cells, "foot", "bound"))
    titles = ("rms [cm]", "max [cm]", "gap", "requests differ: rms [deg]", "most [deg]")
    return Table("foot, plan", tuple(map(Column, titles)), tuple(rows), label="Foot")


def checks_table(checks: Sequence[Check]) -> Table:
    """One row per claim: the plan that is closest to breaking it, or every one that does."""
    claims: dict[tuple[str, str], list[Check]] = {}
    for each in checks:
        claims.setdefault((each.name, each.unit), []).append(each)
    rows = []
    for same in claims.values():
        worst = max(same, key=lambda each: each.value - each.tolerance)
        for each in [each for each in same if not each.passed] or [worst]:
            where = ", ".join(part for part in (each.subject, each.plan) if part)
            where = "nowhere, but for rounding" if each.is_rounding else where
            tolerance = f"{each.tolerance:.1e} {each.unit}"
            holds = "yes" if each.passed else "NO"
            cells = (f"{each.value:.1e}", tolerance, holds, where)
            rows.append(Row(each.name, cells, kind="" if each.passed else "broken"))
    columns = (*map(Column, ("worst", "tolerance", "holds")), Column("where", words=True))
    return Table("check", columns, tuple(rows), label="Checks")


def tolerance_reasons(checks: Sequence[Check]) -> list[tuple[str, str, str]]:
    """Every reason of a tolerance: the unit and the names of its checks, and the reason."""
    names: dict[tuple[str, str], dict[str, None]] = {}
    for each in checks:
        names.setdefault((each.unit, each.reason), {})[each.name] = None
    return [(unit, "; ".join(each), reason) for (unit, reason), each in names.items()]


def notes(joints: Sequence[JointComparison]) -> Iterator[str]:
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


def _only(cell: str, column: int, columns: int) -> tuple[str, ...]:
    return tuple(cell if number == column else "" for number in range(columns))
