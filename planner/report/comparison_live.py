"""What is live on the page of a comparison: the moving leg, and every joint over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.comparison_rows import REASON_WORDS, SHOWN
from planner.report.comparison_tints import TINTS
from planner.report.curves import Curve, Panel, Span
from planner.report.live_leg import Motion, moving_leg
from planner.report.live_plot import time_plot
from planner.report.style import CLOSED_FORM, DESIRED, FOOT_OPTIMAL, INK, LIMIT, OPTIMAL, Role

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.evaluation.cross_check import CrossCheck
    from planner.evaluation.joint_comparison import JointComparison
    from planner.trajectory import Array

FOOT_ROLES = {SHOWN: CLOSED_FORM, "optimal": OPTIMAL, "foot_optimal": FOOT_OPTIMAL}
"""The plans whose feet are drawn."""

NEAR = 0.1
"""A limit is drawn within this share of the requests' range beyond them."""


def live_leg(check: CrossCheck, leg: Leg) -> dict[str, Any]:
    """The leg as it should move, and as it does under the plans."""
    assert check.foot is not None, "only a leg has a foot"
    desired = leg.joint_positions(np.column_stack([joint.desired for joint in check.joints]))
    motions = [Motion(DESIRED, desired)]
    for method, role in FOOT_ROLES.items():
        plan = check.foot.plans[method]
        points = leg.joint_positions(plan.predicted)
        motions.append(Motion(role, points, plan.outcome.distances))
    return moving_leg(motions, period=check.period, cyclic=check.cyclic)


def live_foot(check: CrossCheck) -> dict[str, Any]:
    """How far the foot is from where it should be, under the plans."""
    assert check.foot is not None, "only a leg has a foot"
    curves = tuple(
        _curve(100.0 * check.foot.plans[method].outcome.distances, role, cyclic=check.cyclic)
        for method, role in FOOT_ROLES.items()
    )
    return _plot(check, [Panel("", "distance", "cm", curves, height=1.8, floor=True)])


def live_joint(check: CrossCheck, joint: JointComparison) -> dict[str, Any]:
    """A joint: its angles, its requests, and how far these differ, over shades that say why."""
    closed_form, optimal = joint.plans[SHOWN], joint.plans["optimal"]
    cyclic = check.cyclic
    angles, requests = (
        tuple(_curve(np.degrees(values), role, cyclic=cyclic) for values, role in pairs)
        for pairs in (
            (
                (closed_form.predicted, CLOSED_FORM),
                (optimal.predicted, OPTIMAL),
                (joint.desired, DESIRED),
            ),
            ((closed_form.requests, CLOSED_FORM), (optimal.requests, OPTIMAL)),
        )
    )
    apart = _curve(
        np.degrees(closed_form.requests - optimal.requests),
        INK._replace(label="difference", width=1.3),
        cyclic=cyclic,
    )
    spans, reasons = _spans(joint), _reasons(joint)
    told = apart._replace(notes=(*reasons, reasons[0]) if cyclic else reasons)
    return _plot(
        check,
        [
            Panel("what it does", "angle", "deg", angles),
            Panel("what is requested", "request", "deg", (*_limits(joint), *requests), spans=spans),
            Panel("closed form − optimised", "difference", "deg", (told,), height=0.8, spans=spans),
        ],
    )


def _reasons(joint: JointComparison) -> tuple[str, ...]:
    """Why each request differs."""
    samples = len(joint.desired)
    found = [""] * samples
    for each in joint.differences[SHOWN].intervals:
        for k in range(each.start, each.start + each.samples):
            found[k % samples] = REASON_WORDS[each.reason]
    return tuple(found)


def _spans(joint: JointComparison) -> tuple[Span, ...]:
    """The shades over samples; one that goes on at the beginning of the cycle is cut in two."""
    samples = len(joint.desired)
    last = samples if joint.plans["optimal"].cyclic else samples - 1
    spans = []
    for each in joint.differences[SHOWN].intervals:
        tint = TINTS[each.reason]
        for before in (0, samples):
            start = max(each.start - 0.5 - before, 0.0)
            end = min(each.start - 0.5 - before + each.samples, float(last))
            if tint.opacity and start < end:
                spans.append(Span(start, end, tint.role, tint.opacity))
    return tuple(spans)


def _limits(joint: JointComparison) -> list[Curve]:
    """The limits of the requests, where they are near those that keep them."""
    optimal = joint.plans["optimal"]
    if optimal.limits is None:
        return []
    low, high = float(np.min(optimal.requests)), float(np.max(optimal.requests))
    room = NEAR * (high - low)
    ends = np.array([0.0, len(optimal.requests) - (0.0 if optimal.cyclic else 1.0)])
    return [
        Curve(LIMIT, ends, np.full(2, math.degrees(limit)))
        for limit in optimal.limits
        if low - room <= limit <= high + room
    ]


def _curve(values: Array, role: Role, *, cyclic: bool) -> Curve:
    """A curve over samples; a cycle up to where it begins again."""
    drawn = np.append(values, values[0]) if cyclic else values
    return Curve(role, np.arange(float(len(drawn))), drawn)


def _plot(check: CrossCheck, panels: list[Panel]) -> dict[str, Any]:
    """The panels in milliseconds, all plots of the page at the same moment."""
    return time_plot(panels, unit="ms", scale=1000.0 * check.period, decimals=1, clock=1000.0)
