"""Joint angles over one step of the walk: the paper's Figures 2, 6 and 7, still and live."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.evaluation.outcome import approximation
from planner.report.curves import Curve, Panel, cycle, draw_curve
from planner.report.live_plot import time_plot
from planner.report.style import (
    APPROXIMATION,
    CLOSED_FORM,
    DESIRED,
    DIRECT,
    FOOT_OPTIMAL,
    OPTIMAL,
    PLAIN,
    REQUESTED,
    WIDTH,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import JointOutcome, PlannedWalk

ROW = 1.55
"""Height of one joint's row [inch]."""

FINE = 20
"""Points of a piecewise linear curve per sample: its knots lie between samples."""

JointCurves = Callable[["JointOutcome"], Sequence[Curve]]
"""What is drawn of a joint [deg], over samples."""


def method_curves(joint: JointOutcome) -> list[Curve]:
    """What the joint does under the methods that the foot is drawn under."""
    return [
        cycle(joint.desired, DESIRED),
        cycle(joint.direct, DIRECT),
        cycle(joint.closed_form_plain.predicted, PLAIN),
        cycle(joint.optimal.predicted, OPTIMAL, hidden=True),
        cycle(joint.foot_optimal, FOOT_OPTIMAL),
        cycle(joint.foot_requests, REQUESTED, "requests, foot-optimised", hidden=True),
    ]


def direct_curves(joint: JointOutcome) -> list[Curve]:
    """Figure 2: requests equal to the desired angles, and the angles."""
    return [
        cycle(joint.desired, DESIRED, "requested = desired"),
        cycle(joint.direct, DIRECT, "actual"),
    ]


def approximation_curves(joint: JointOutcome) -> list[Curve]:
    """Figure 6: the piecewise linear approximation with its knots."""
    curve = joint.closed_form_plain.approximation
    assert curve is not None, "a closed form has an approximation"
    fine = np.linspace(0.0, curve.samples, FINE * curve.samples + 1)
    order = np.argsort(np.mod(curve.knots, curve.samples))
    knots = np.mod(curve.knots, curve.samples)[order]
    return [
        cycle(joint.desired, DESIRED),
        Curve(APPROXIMATION, fine, np.degrees(curve(fine))),
        Curve(APPROXIMATION, knots, np.degrees(curve.values)[order], "knots", dots=True),
    ]


def trajectory_curves(joint: JointOutcome) -> list[Curve]:
    """Figure 7: desired, approximation, requests and the resulting angles."""
    plan = joint.closed_form_plain
    return [
        cycle(plan.requests, REQUESTED),
        cycle(joint.desired, DESIRED),
        cycle(approximation(plan), APPROXIMATION),
        cycle(plan.predicted, CLOSED_FORM, "actual"),
    ]


def optimised_curves(joint: JointOutcome) -> list[Curve]:
    """Beyond the paper: the optimised requests and what they do."""
    return [
        cycle(joint.optimal.requests, REQUESTED),
        cycle(joint.desired, DESIRED),
        cycle(joint.optimal.predicted, OPTIMAL, "actual"),
    ]


def foot_optimised_curves(joint: JointOutcome) -> list[Curve]:
    """Beyond the paper: the requests of the plan for the foot and what they do."""
    return [
        cycle(joint.foot_requests, REQUESTED),
        cycle(joint.desired, DESIRED),
        cycle(joint.foot_optimal, FOOT_OPTIMAL, "actual"),
    ]


def joint_rows(planned: PlannedWalk, curves: JointCurves, *, columns: int) -> Figure:
    """A row per joint over one step of the walk.

    Args:
        planned: The walk.
        curves: What is drawn of a joint; what a live plot hides at first is left out.
        columns: Columns of the legend.
    """
    from matplotlib.figure import Figure

    count = len(planned.joints)
    figure = Figure(figsize=(WIDTH, ROW * count + 0.45), layout="constrained")
    rows = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axes, joint in zip(rows, planned.joints, strict=True):
        for curve in curves(joint):
            if not curve.hidden:
                draw_curve(axes, curve)
        axes.set_title(joint.name)
        axes.set_ylabel("angle [deg]")
        axes.margins(y=0.08)
    figure.align_ylabels(rows)
    samples = len(planned.joints[0].desired)
    rows[-1].set_xlim(0, samples)
    rows[-1].set_xticks(range(0, samples + 1, samples // 8))
    rows[-1].set_xlabel(f"time [samples of {_milliseconds(planned):g} ms]; the walk repeats")
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)
    return figure


def joint_plot(
    planned: PlannedWalk, curves: JointCurves, *more: Panel, clock: bool = False
) -> dict[str, Any]:
    """The same as a live plot, in milliseconds.

    Args:
        planned: The walk.
        curves: What is drawn of a joint.
        more: Panels to stand below, over samples.
        clock: Whether it follows the moving leg of its page.
    """
    panels = [Panel(joint.name, "angle", "deg", tuple(curves(joint))) for joint in planned.joints]
    return time_plot(
        [*panels, *more],
        unit="ms",
        scale=_milliseconds(planned),
        clock=1000.0 if clock else None,
    )


def _milliseconds(planned: PlannedWalk) -> float:
    """Time between samples [ms]."""
    return 1000.0 * planned.models[0].period
