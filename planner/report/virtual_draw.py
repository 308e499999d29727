"""Pictures of what the virtual robot did, every cycle of it drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.curves import draw_curve
from planner.report.draw_foot import ROLES, draw_leg, draw_path, legend, side_view
from planner.report.style import (
    CLOSED_FORM,
    DESIRED,
    DIRECT,
    FOOT_OPTIMAL,
    INK,
    MUTED,
    PLAIN,
    SURFACE,
    WIDTH,
)
from planner.report.virtual_joints import THIN, distance_panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.evaluation.virtual_outcome import VirtualOutcome

PATHS = {"direct": DIRECT, "closed_form_plain": PLAIN, "foot_optimal": FOOT_OPTIMAL}
"""The methods whose foot paths are drawn, each over all its cycles."""

MEASURED: dict[str, Any] = {
    "color": INK.light,
    "lw": 0.0,
    "marker": "o",
    "ms": 2.4,
    "mfc": "none",
    "mew": 0.7,
}
"""How what a sensor recorded is drawn."""

SMALL: dict[str, Any] = {"fontweight": "normal", "fontsize": 8.5}
"""How figures above a panel look."""


def draw_paths(outcome: VirtualOutcome) -> Figure:
    """Figure 8 on the virtual robot: the path of the foot in every cycle."""
    figure, axes = side_view(height=4.1)
    draw_leg(axes, outcome.planned)
    draw_path(axes, outcome.planned.walk.desired_foot, DESIRED, zorder=6)
    for method, role in PATHS.items():
        paths = outcome.foot_paths[method]
        for path in paths[1:]:
            draw_path(axes, path, role._replace(width=THIN, label="_cycle"), zorder=4)
        draw_path(axes, paths[0], role._replace(width=THIN), zorder=4)
    legend(axes, 2)
    return figure


def draw_steps(outcome: VirtualOutcome) -> Figure:
    """Figures 3 and 4: what the sensors recorded of the step tests, the model, and what is left."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(WIDTH, 4.9), layout="constrained")
    rows = figure.subplots(
        len(outcome.identifications),
        2,
        sharex=True,
        sharey="col",
        squeeze=False,
        width_ratios=(3, 2),
    )
    samples = np.arange(len(outcome.planned.walk.desired))
    for (angles, left), found, joint in zip(
        rows, outcome.identifications, outcome.planned.joints, strict=True
    ):
        for fit in found.fits:
            last = slice(-len(samples), None)
            middle = np.mean(fit.log.requests[last])
            measured = np.degrees(fit.log.angles[last] - middle)
            predicted = np.degrees(fit.predicted[last] - middle)
            angles.plot(samples, predicted, **CLOSED_FORM._replace(width=1.4).line)
            angles.plot(samples[::2], measured[::2], **MEASURED)
            left.plot(samples, measured - predicted, color=INK.light, lw=THIN)
        angles.set_title(joint.name)
        angles.set_ylabel("angle [deg]")
        left.set_title(f"residual, {np.degrees(found.rms):.2f}° rms", **SMALL)
    figure.align_ylabels(rows[:, 0])
    period = 1000.0 * outcome.constants.request_period
    for axes in rows[-1]:
        axes.set_xlim(0, len(samples))
        axes.set_xticks(range(0, len(samples) + 1, len(samples) // 4))
        axes.set_xlabel(f"time [samples of {period:g} ms]")
    handles = [
        Line2D([], [], **MEASURED, label="measured by the sensor"),
        Line2D([], [], **{**CLOSED_FORM.line, "label": "identified model"}),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=2)
    return figure


def draw_distances(outcome: VirtualOutcome) -> Figure:
    """How far the foot is from where it should be, at each time of every cycle."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    axes = figure.add_subplot()
    for curve in distance_panel(outcome).curves:
        draw_curve(axes, curve)
    axes.set_xlim(0, len(outcome.planned.walk.desired))
    axes.set_ylim(bottom=0.0)
    axes.set_xticks(
        range(0, len(outcome.planned.walk.desired) + 1, len(outcome.planned.walk.desired) // 8)
    )
    axes.set_xlabel(f"time [samples of {1000.0 * outcome.constants.request_period:g} ms]")
    axes.set_ylabel("distance [cm]")
    legend(axes, 2)
    return figure


def draw_promises(outcome: VirtualOutcome) -> Figure:
    """The foot's accuracy by method: as planned, as executed, and on the paper's robot."""
    from matplotlib.figure import Figure

    from planner.evaluation.paper import published_foot
    from planner.report.paper_tables import METHODS

    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    axes = figure.add_subplot()
    executed, planned = outcome.foot_table, outcome.planned.foot_table
    for row, method in enumerate(METHODS):
        role = ROLES.get(method, CLOSED_FORM)
        over, predicted = executed[method], planned[method]
        theirs = published_foot(method)
        if theirs is not None:
            axes.plot(theirs.L2.mean, row, "x", ms=7, color=MUTED.light, mew=1.4, zorder=3)
        axes.plot([predicted.rms, over.mean.rms], [row, row], color=role.light, lw=1.4, zorder=2)
        axes.plot(
            predicted.rms, row, "o", ms=7, mfc=SURFACE.light, mec=role.light, mew=1.4, zorder=3
        )
        axes.plot(over.mean.rms, row, "o", ms=4.5, color=role.light, zorder=4)
    axes.set_yticks(range(len(METHODS)), [label.split(":")[0] for label in METHODS.values()])
    axes.set_ylim(len(METHODS) - 0.5, -0.5)
    axes.set_xlim(left=0.0)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("foot error, L₂ [cm]")
    ink = INK.light
    axes.plot([], [], "o", color=ink, ms=7, mfc=SURFACE.light, mew=1.4, label="planned")
    axes.plot([], [], "o", color=ink, ms=4.5, label="executed")
    axes.plot([], [], "x", color=MUTED.light, lw=0.0, ms=7, mew=1.4, label="the paper's robot")
    legend(axes, 3)
    return figure
