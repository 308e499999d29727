"""A comparison of closed form and optimised requests: its tables, its text and its page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from kinematics.leg import Leg
from planner.arrays import error_norm, index_of_largest
from planner.evaluation.checks import CLAIMS, Check, beyond_limits
from planner.evaluation.cross_check import METHODS, SECOND, CrossCheck, JointComparison
from planner.model.evidence import untested_words
from planner.report import figure
from planner.report.figure import Axis, Figure, Panel, Timeline, line
from planner.report.page import Page, models_table
from planner.report.wording import CARRIED, Unit, labelled, largest_of, percent, words_of

SHOWN = "closed_form_paper"
"""The closed form that is drawn."""

FOOT_ROLES = {
    SHOWN: figure.CLOSED_FORM,
    "optimal": figure.OPTIMAL,
    "foot_optimal": figure.FOOT_OPTIMAL,
}
"""The plans whose feet are drawn."""


def comparison_page(
    check: CrossCheck,
    units: Mapping[str, str] = {},
    *,
    title: str = "",
    leg: Leg | None = None,
    unreachable: int = 0,
    notes: Sequence[str] = (),
) -> Page:
    """The whole page: verdict and key figures first, sources last; with a leg, it moves.

    The ``units`` are those of joints that are not in degrees, by their names in :data:`.CARRIED`.
    """
    joints, foot, said = check.joints, check.foot, spoken_of(check, units)
    of = {joint.name: units.get(joint.name, "deg") for joint in joints}
    names = [joint.name for joint in joints]
    excesses = {
        joint.name: math.degrees(beyond_limits(joint.plans[SHOWN].requests, joint.limits))
        for joint in joints
        if joint.limits is not None
    }
    shown = [each for each in (SHOWN, "optimal", SECOND) if each in check.methods]
    far = [joint for joint in joints if any(math.isinf(joint.gap(each)) for each in shown)]
    gaps: dict[str, dict[str, Any]] = {}  # from smallest to largest, or errors over a bound near 0
    for method in shown:
        errors = ((of[joint.name], math.degrees(joint.plans[method].error)) for joint in far)
        ends = [percent(end(joint.gap(method) for joint in joints)) for end in (min, max)]
        gap = ends[0] if ends[0] == ends[1] else f"{ends[0].removesuffix(' %')} – {ends[1]}"
        gaps[method] = {"errors": largest_of(errors), "gap": gap}
    agree = [each for each in check.checks if each.name == CLAIMS["agrees"].name]
    feet = foot and [foot.plans[method].distances for method in ("optimal", "foot_optimal")]
    moving, pictures = figures_of(check, leg, said["shown"])
    apart = [math.degrees(np.max(np.abs(joint.difference(SHOWN)))) for joint in joints]
    return Page(
        "comparison",
        **said,
        title=title or ", ".join(names),
        leg=leg,
        good=check.passed,
        zero=bool(far),
        gaps=gaps,
        apart=largest_of(zip(of.values(), apart, strict=True)) if max(apart) > 0.0 else {},
        failures=[*map(failure_words, check.failures)],
        unreachable=unreachable,
        # more than rounding of degrees
        beyond={name: excess for name, excess in excesses.items() if excess > 1e-7},
        more=notes,
        moving=moving,
        agreement=largest_of((each.claim.unit, each.value) for each in agree),
        foot=feet and [100.0 * error_norm(each, check.norm) for each in feet],
        foot_gap=foot and foot.gap("foot_optimal"),
        worst=max(joints, key=lambda joint: joint.plans["optimal"].error),
        pictures=pictures,
        models=models_table({joint.name: joint.model for joint in joints}, said["shown"]),
    )


def in_units(check: CrossCheck, units: Mapping[str, str]) -> CrossCheck:
    """The comparison with the checks of joints in percent, which count as degrees, in percent."""

    def own(each: Check) -> Check:
        if each.claim.unit != "rad" or units.get(each.subject) != "percent":
            return each
        value, allowed = np.degrees([each.value, each.claim.tolerance]).tolist()
        claim = each.claim._replace(tolerance=allowed, unit=CARRIED["percent"].words)
        return replace(each, value=value, claim=claim)

    def of(part: Any) -> Any:
        return part and replace(part, checks=tuple(map(own, part.checks)))

    return replace(check, joints=tuple(map(of, check.joints)), foot=of(check.foot))


# Tables and sentences.


def verdict_line(check: CrossCheck) -> str:
    """The number of checks that hold, and the first that does not."""
    count = f"{len(check.checks) - len(check.failures)} of {len(check.checks)} checks hold"
    if not check.failures:
        return f"passed: {count}"
    return f"failed: {count}; {failure_words(check.failures[0])}"


def failure_words(check: Check) -> str:
    """A check that does not hold."""
    plan, claim = f", {check.plan}" if check.plan else "", check.claim
    return (
        f"{check.subject}{plan}: {claim.name}: got {check.value:.3g} {claim.unit}, "
        f"tolerance {claim.tolerance:.2g} {claim.unit}"
    )


def spoken_of(check: CrossCheck, units: Mapping[str, str] = {}) -> dict[str, Any]:
    """What the tables show: of each claim the plan closest to breaking it, or all that do."""
    expected = [joint.plans["optimal"].expected.error for joint in check.joints]
    claims: dict[tuple[str, str], list[Check]] = {}
    for each in check.checks:
        claims.setdefault((each.name, each.claim.unit), []).append(each)
    shown = {joint.name: CARRIED[units.get(joint.name, "deg")] for joint in check.joints}
    unit, labels = labelled(shown)
    closest = list[Check]()
    for same in claims.values():
        worst = max(same, key=lambda each: each.value - each.claim.tolerance)
        closest += [each for each in same if not each.passed] or [worst]
    return {
        "check": check,
        "shown": shown,
        "unit": unit,
        "labels": labels,
        "methods": METHODS,
        "has_expected": bool(np.isfinite(expected).any()),
        "farthest": lambda joint, method: index_of_largest(np.abs(joint.difference(method))),
        "closest": closest,
        "untested": untested_words(
            [joint.name for joint in check.joints],
            [joint.plans["optimal"].expected for joint in check.joints],
        ),
    }


# The figures.


def figures_of(
    check: CrossCheck, leg: Leg | None, shown: Mapping[str, Unit]
) -> tuple[Figure | None, list[Figure]]:
    """The leg that moves as desired and under the plans, and figures of the joints and the foot."""
    joints, foot = check.joints, check.foot
    timeline = Timeline(check.period, len(joints[0].desired), check.cyclic)
    pictures = [joint_figure(timeline, each, j, shown[each.name]) for j, each in enumerate(joints)]
    if foot is None:
        return None, pictures
    plans = [(role, foot.plans[method]) for method, role in FOOT_ROLES.items()]
    pictures.append(figure.foot_figure(timeline, {"": plans}))
    if leg is None:
        return None, pictures
    desired = leg.joint_positions(np.column_stack([joint.desired for joint in joints]))
    others = [(role, leg.joint_positions(plan.predicted)) for role, plan in plans]
    return timeline.leg("leg", words_of("comparison_leg"), desired, others), pictures


def joint_figure(timeline: Timeline, joint: JointComparison, j: int, unit: Unit) -> Figure:
    """A joint: its angles, its requests, and how far these differ."""
    plans = [(joint.plans[SHOWN], figure.CLOSED_FORM), (joint.plans["optimal"], figure.OPTIMAL)]
    look = figure.INK._replace(label="difference", width=1.3)
    zero = line((0.0, timeline.step * timeline.last), (0.0, 0.0))
    difference = timeline.curve(np.degrees(joint.difference(SHOWN)), look, held=True)
    title = "requests, closed form − optimised"
    return figure.joint_figure(
        timeline,
        f"joint_{j}",
        words_of("comparison_joint", name=joint.name),
        angles=[(joint.desired, figure.DESIRED), *((plan.predicted, role) for plan, role in plans)],
        requests=[(plan.requests, role) for plan, role in plans],
        unit=unit,
        limits=joint.limits,
        below=[Panel(Axis("difference", unit.sign), (zero, difference), title, height=0.8)],
    )
