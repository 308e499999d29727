"""Pictures of joint angles over one step of the walk: the paper's Figures 2, 6 and 7."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from planner.evaluation.outcome import approximation
from planner.report.style import (
    APPROXIMATION,
    CLOSED_FORM,
    DESIRED,
    DIRECT,
    FOOT_OPTIMAL,
    OPTIMAL,
    REQUESTED,
    SURFACE,
    WIDTH,
    Role,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import JointOutcome, PlannedWalk, Reproduction
    from planner.trajectory import Array

ROW = 1.55
"""Height of one joint's row [inch]."""


def draw_direct_joints(reproduction: Reproduction) -> Figure:
    """Figure 2, for every joint: requests equal to the desired angles, and the angles."""

    def draw(axes: Axes, joint: JointOutcome) -> None:
        draw_cycle(axes, joint.desired, DESIRED, "requested = desired")
        draw_cycle(axes, joint.direct, DIRECT, "actual")

    return joint_rows(reproduction, draw, columns=2)


def draw_approximation(reproduction: Reproduction) -> Figure:
    """Figure 6, for every joint: the piecewise linear approximation with its knots."""

    def draw(axes: Axes, joint: JointOutcome) -> None:
        draw_cycle(axes, joint.desired, DESIRED)
        curve = joint.closed_form_plain.approximation
        assert curve is not None, "a closed form has an approximation"
        fine = np.linspace(0.0, curve.samples, 20 * curve.samples + 1)
        axes.plot(fine, np.degrees(curve(fine)), **APPROXIMATION.line)
        axes.plot(
            np.mod(curve.knots, curve.samples),
            np.degrees(curve.values),
            "o",
            color=SURFACE.light,
            mec=APPROXIMATION.light,
            mew=1.3,
            ms=4.5,
            label="knots",
            zorder=5,
            clip_on=False,
        )

    return joint_rows(reproduction, draw, columns=3)


def draw_trajectories(reproduction: Reproduction) -> Figure:
    """Figure 7, for every joint: desired, approximation, requests and the resulting angles."""

    def draw(axes: Axes, joint: JointOutcome) -> None:
        draw_cycle(axes, joint.closed_form_plain.requests, REQUESTED)
        draw_cycle(axes, joint.desired, DESIRED)
        draw_cycle(axes, approximation(joint.closed_form_plain), APPROXIMATION)
        draw_cycle(axes, joint.closed_form_plain.predicted, CLOSED_FORM, "actual")

    return joint_rows(reproduction, draw, columns=4)


def draw_optimised(reproduction: Reproduction) -> Figure:
    """Beyond the paper: the optimised requests and what they do, for every joint."""

    def draw(axes: Axes, joint: JointOutcome) -> None:
        draw_cycle(axes, joint.optimal.requests, REQUESTED)
        draw_cycle(axes, joint.desired, DESIRED)
        draw_cycle(axes, joint.optimal.predicted, OPTIMAL, "actual")

    return joint_rows(reproduction, draw, columns=3)


def draw_foot_optimised(reproduction: Reproduction) -> Figure:
    """Beyond the paper: the requests of the plan for the foot and what they do, for every joint."""
    requests = dict(
        zip(reproduction.walk.joint_names, reproduction.foot_plan.requests.T, strict=True)
    )

    def draw(axes: Axes, joint: JointOutcome) -> None:
        draw_cycle(axes, requests[joint.name], REQUESTED)
        draw_cycle(axes, joint.desired, DESIRED)
        draw_cycle(axes, joint.foot_optimal, FOOT_OPTIMAL, "actual")

    return joint_rows(reproduction, draw, columns=3)


def joint_rows(
    planned: PlannedWalk, draw: Callable[[Axes, JointOutcome], None], *, columns: int
) -> Figure:
    """A row per joint over one step of the walk.

    Args:
        planned: The walk.
        draw: Draws one joint into its axes.
        columns: Columns of the legend.
    """
    from matplotlib.figure import Figure

    count = len(planned.joints)
    figure = Figure(figsize=(WIDTH, ROW * count + 0.45), layout="constrained")
    rows = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axes, joint in zip(rows, planned.joints, strict=True):
        draw(axes, joint)
        axes.set_title(joint.name)
        axes.set_ylabel("angle [deg]")
        axes.margins(y=0.08)
    figure.align_ylabels(rows)
    samples = len(planned.joints[0].desired)
    rows[-1].set_xlim(0, samples)
    rows[-1].set_xticks(range(0, samples + 1, samples // 8))
    milliseconds = 1000.0 * planned.models[0].period
    rows[-1].set_xlabel(f"time [samples of {milliseconds:g} ms]; the walk repeats")
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)
    return figure


def draw_cycle(axes: Axes, angles: Array, role: Role, label: str | None = None) -> None:
    """One cycle of angles [rad], up to where it begins again."""
    cycle = np.degrees(np.append(angles, angles[0]))
    line = role.line if label is None else {**role.line, "label": label}
    axes.plot(np.arange(len(cycle)), cycle, **line)
