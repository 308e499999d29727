"""What a comparison amounts to, in sentences and key figures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.evaluation.checks import AGREES
from planner.evaluation.cross_check import SECOND
from planner.report.comparison_rows import SHOWN, notes
from planner.report.text_table import percent

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from planner.evaluation.cross_check import CrossCheck
    from planner.evaluation.differences import Reason
    from planner.evaluation.foot_comparison import FootComparison

OUTSIDE = 1e-9
"""A request farther than this beyond a limit is outside [rad]: rounding of degrees, no more."""

WHERE: Mapping[Reason, str] = {
    "saturated": "where the joint is at its top speed whatever is requested",
    "limit": "where a request is at a limit",
    "corner": "at corners of the closed form’s lines",
    "after_end": "after the end",
    "free": "elsewhere than at top speed, at limits and at corners",
}
"""Where requests differ for a reason, to end a sentence with."""


class KeyFigure(NamedTuple):
    """A figure to know first.

    Attributes:
        figure: The number.
        unit: Its unit.
        words: What it says.
    """

    figure: str
    unit: str
    words: str


def verdict(check: CrossCheck) -> tuple[str, str]:
    """The answer in a few words, and what it is worth."""
    held = len(check.checks) - len(check.failures)
    if check.passed:
        head = f"The plans agree: all {held} checks hold"
    else:
        head = f"{len(check.failures)} of {len(check.checks)} checks do not hold"
    said = (
        f"The closed form comes within {_span_of_gaps(check, SHOWN)} of what no requests can beat, "
        f"the optimised requests within {_span_of_gaps(check, 'optimal')}"
    )
    if SECOND in check.methods:
        said += f", those of IPOPT through CasADi within {_span_of_gaps(check, SECOND)}"
    said += "."
    reasons = shares(check)
    if reasons:
        most = max(reasons, key=lambda reason: reasons[reason])
        apart = max(math.degrees(joint.differences[SHOWN].largest) for joint in check.joints)
        said += f" The requests of the first two differ by up to {apart:.3g} degrees all the same"
        said += f": {100 * reasons[most]:.0f} % of that, squared, is {WHERE[most]}."
    return head, said


def shares(check: CrossCheck) -> dict[Reason, float]:
    """The reasons' shares in the squared difference of all joints' requests, those that occur."""
    squared = [joint.differences[SHOWN].rms ** 2 for joint in check.joints]
    if not sum(squared) > 0.0:
        return {}
    found: dict[Reason, float] = {}
    for joint, part in zip(check.joints, squared, strict=True):
        for reason, share in joint.differences[SHOWN].shares.items():
            found[reason] = found.get(reason, 0.0) + share * part / sum(squared)
    return found


def key_figures(check: CrossCheck) -> list[KeyFigure]:
    """Agreement, gaps, and the foot."""
    norm = check.norm
    agreement = max(each.value for each in check.checks if each.name == AGREES)
    figures = [
        KeyFigure(
            f"{len(check.checks) - len(check.failures)} of {len(check.checks)}",
            "",
            "checks hold; the predicted angles are at most "
            f"{agreement:.1g} rad from an independent simulation",
        )
    ]
    gaps = [(SHOWN, "closed form, the paper’s rule"), ("optimal", "optimised")]
    gaps += [(SECOND, "optimised by IPOPT through CasADi")] * (SECOND in check.methods)
    for method, words in gaps:
        figures.append(
            KeyFigure(
                _span_of_gaps(check, method), "", f"above what none can beat: {words}, {norm}"
            )
        )
    if check.foot is not None:
        before, after = (
            100.0 * check.foot.plans[method].error(norm) for method in ("optimal", "foot_optimal")
        )
        figures.append(
            KeyFigure(
                f"{before:.2f} → {after:.2f}",
                "cm",
                f"the foot’s {norm} error, joints planned one by one and all at once for it"
                + _foot_gap(check.foot),
            )
        )
    else:
        worst = max(check.joints, key=lambda joint: joint.plans["optimal"].error)
        figures.append(
            KeyFigure(
                f"{math.degrees(worst.plans['optimal'].error):.3g}",
                f"deg {norm}",
                f"the joint that errs most when optimised, {worst.name}; bound "
                f"{math.degrees(worst.bound):.3g} deg",
            )
        )
    return figures


def remarks(check: CrossCheck, *, unreachable: int = 0) -> list[str]:
    """What somebody who relies on these plans should know first."""
    said = [
        f"{each.subject}{f', {each.plan}' if each.plan else ''}: {each.name}: got "
        f"{each.value:.3g} {each.unit}, tolerance {each.tolerance:.2g} {each.unit}."
        for each in check.failures
    ]
    if unreachable:
        said.append(f"{unreachable} of {len(check.joints[0].desired)} samples were out of reach.")
    if beyond := _beyond_limits(check):
        listed = ", ".join(f"{name} by {excess:.3g} degrees" for name, excess in beyond)
        said.append(
            "The closed form knows no limits: it requests more than the limits allow of "
            f"{listed}. A robot that clips its requests would not track as well as told here."
        )
    return said + [f"{note[0].upper()}{note[1:]}." for note in notes(check.joints)]


def _beyond_limits(check: CrossCheck) -> Sequence[tuple[str, float]]:
    """Joints whose closed form leaves the limits that the optimised plan keeps, and how far."""
    found = []
    for joint in check.joints:
        limits, requests = joint.plans["optimal"].limits, joint.plans[SHOWN].requests
        if limits is None:
            continue
        excess = float(np.max(np.maximum(limits[0] - requests, requests - limits[1])))
        if excess > OUTSIDE:
            found.append((joint.name, math.degrees(excess)))
    return found


def _foot_gap(foot: FootComparison) -> str:
    """What is proved about the plan for the foot, to end a sentence with."""
    gap = foot.gap("foot_optimal")
    return "" if gap is None else f": {percent(gap)} above what none can beat"


def _span_of_gaps(check: CrossCheck, method: str) -> str:
    """The joints' gaps, from the smallest to the largest."""
    least, most = (percent(f(joint.gap(method) for joint in check.joints)) for f in (min, max))
    return least if least == most else f"{least.removesuffix(' %')} – {most}"
