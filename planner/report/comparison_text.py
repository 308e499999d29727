"""A cross-check as text: how good each plan is, where requests differ and why, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

from planner.evaluation.checks import Check
from planner.evaluation.cross_check import CrossCheck
from planner.report.comparison_rows import (
    Table,
    differences_table,
    foot_table,
    notes,
    plans_table,
    tolerance_reasons,
    worst_checks,
)
from planner.report.text_table import text_table


def comparison_text(check: CrossCheck) -> str:
    """Everything that a terminal should show."""
    parts = [_text(plans_table(check.joints))]
    if check.foot is not None:
        parts.append(_text(foot_table(check.foot)))
    parts += [_text(differences_table(check.joints)), _verdict(check.checks)]
    parts += [f"note: {note}" for note in notes(check.joints)]
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


def _text(table: Table) -> str:
    rows = [[f"{row.subject}, {row.about}", *row.cells] for row in table.rows]
    return text_table([table.about, *table.header], rows)


def _verdict(checks: Sequence[Check]) -> str:
    """One row per claim: the plan that is closest to breaking it, or every one that does."""
    rows = [
        [
            each.name,
            f"{each.value:.1e}",
            f"{each.tolerance:.1e} {each.unit}",
            "yes" if each.passed else "NO",
            ", ".join(part for part in (each.subject, each.plan) if part),
        ]
        for each in worst_checks(checks)
    ]
    reasons = [f"  {each.unit}, {each.name}: {each.reason}" for each in tolerance_reasons(checks)]
    table = text_table(["check", "worst", "tolerance", "holds", "where"], rows)
    return "\n".join([table, "tolerances:", *reasons])
