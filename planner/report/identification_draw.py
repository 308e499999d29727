"""Pictures of what was identified: intervals, errors beside simpler models, and f from data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from planner.report.identification_cloud import cloud_view
from planner.report.identification_parameters import estimate, parameters, unit_of, units_of
from planner.report.identification_words import errors
from planner.report.style import CLOSED_FORM, DIRECT, GRID, INK, MUTED, OPTIMAL, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.identification.result import Identification

STRIP = 0.52
"""Height of one parameter's strip [inch]."""

MOST_POINTS = 500
"""Points of each kind that are drawn, evenly chosen; each is a hundred bytes of SVG."""

SHORT = {
    "v_max": "$v_\\mathrm{max}$",
    "theta_0": "θ₀",
    "gain": "$v_\\mathrm{max}$ / θ₀",
    "lag": "lag",
    "acceleration_time": "acceleration\ntime",
    "offset": "static sag",
}


def draw_intervals(identification: Identification) -> Figure:
    """Every estimate and its 95 % interval, on a scale from nothing to twice the estimate."""
    from matplotlib.figure import Figure

    rows = parameters(identification)
    figure = Figure(figsize=(WIDTH, STRIP * len(rows) + 0.2), layout="constrained")
    for axes, row in zip(figure.subplots(len(rows), 1), rows, strict=True):
        value, interval = estimate(identification, row.name)
        factor, unit = unit_of(identification, row.name)
        least, most = _span(identification, row.name, value)
        ends = np.clip(interval, least, most)
        colour = CLOSED_FORM.light if row.known else DIRECT.light
        axes.plot([least * factor, most * factor], [0, 0], color=GRID.light, lw=7.0)
        axes.plot(ends * factor, [0, 0], color=colour, lw=7.0, solid_capstyle="butt")
        for end, true, side in zip(ends, interval, "<>", strict=True):
            if abs(true - end) > 1e-12:  # goes on beyond the strip
                axes.plot(end * factor, 0, side, color=colour, ms=7, clip_on=False)
        axes.plot(value * factor, 0, "|", ms=13, color=INK.light, mew=1.8, zorder=5)
        axes.set_xlim(least * factor, most * factor)
        axes.set_xticks(np.array([least, 0.5 * (least + most), most]) * factor)
        axes.xaxis.set_major_formatter(lambda tick, _: f"{tick:.3g}".replace("-", "−"))
        axes.set_yticks([0], [f"{SHORT[row.name]} [{unit}]"])
        axes.set_ylim(-1, 1)
        axes.grid(visible=False)
        axes.tick_params(length=0)
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure


def draw_alternatives(identification: Identification) -> Figure:
    """How far off each description is, on all rows and on those held out."""
    from matplotlib.figure import Figure

    units = units_of(identification)
    entries = errors(identification)
    figure = Figure(figsize=(WIDTH, 0.42 * len(entries) + 0.75), layout="constrained")
    axes = figure.add_subplot()
    for k, error in enumerate(entries):
        colour = CLOSED_FORM.light if error.ours else MUTED.light
        rms = units.factor * error.rms
        told = rms if error.held_out is None else units.factor * error.held_out
        axes.barh(k, rms, height=0.5, color=colour, alpha=0.85)
        if error.held_out is not None:
            axes.plot([told, told], [k - 0.36, k + 0.36], color=OPTIMAL.light, lw=2.6)
        axes.annotate(
            f"{told:.3g}",
            (max(rms, told), k),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            color=INK.light,
        )
    if identification.held_out_rms is not None:
        axes.plot([], [], color=OPTIMAL.light, lw=2.6, label="rows held out")
    axes.barh([math.nan], [math.nan], color=MUTED.light, alpha=0.85, label="all rows")
    axes.set_yticks(range(len(entries)), [error.words for error in entries])
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.margins(x=0.12)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(f"rms error [{units.angle}]")
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def draw_speed_cloud(identification: Identification) -> Figure:
    """The paper's Figure 5 from data: speed against error, with the identified f over it."""
    from matplotlib.figure import Figure

    model, units = identification.model, units_of(identification)
    cloud, reach, highest = cloud_view(identification)
    figure = Figure(figsize=(WIDTH, 3.3), layout="constrained")
    axes = figure.add_subplot()
    axes.axhline(0.0, color=MUTED.light, lw=0.8)
    axes.axvline(0.0, color=MUTED.light, lw=0.8)
    drawn = np.abs(cloud.errors) <= reach
    for chosen, role, size, label in (
        (drawn & cloud.apart, MUTED, 2.0, "window across a corner of f"),
        (drawn & ~cloud.apart, INK, 2.2, "measured"),
    ):
        points = np.flatnonzero(chosen)
        points = points[:: max(1, math.ceil(len(points) / MOST_POINTS))]
        axes.plot(
            units.factor * cloud.errors[points],
            units.factor * cloud.speeds[points],
            "o",
            ms=size,
            mew=0,
            color=role.light,
            alpha=0.55 if role is INK else 0.3,
            label=label,
        )
    errors = np.array([-reach, -min(model.theta_0, reach), min(model.theta_0, reach), reach])
    speeds = model.speed(errors)
    axes.plot(
        units.factor * errors,
        units.factor * speeds,
        **{**CLOSED_FORM.line, "linewidth": 2.4, "label": "f, identified"},
    )
    _mark_corner(axes, identification, units.factor, reach)
    axes.set_xlim(-units.factor * reach, units.factor * reach)
    axes.set_ylim(-units.factor * highest, units.factor * highest)
    axes.set_xlabel(f"request minus angle, mean over the window [{units.angle}]")
    axes.set_ylabel(f"speed [{units.speed}]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside upper left", ncols=3, markerscale=2.2)
    return figure


def _mark_corner(axes: Axes, identification: Identification, factor: float, reach: float) -> None:
    """Where the joint comes to its top speed; a dotted line where that is known."""
    model = identification.model
    if not identification.saturates or model.theta_0 > reach:
        return
    corner, top = factor * model.theta_0, factor * model.v_max
    axes.plot([corner, corner], [0.0, top], color=MUTED.light, lw=0.9, ls=":")
    axes.annotate("θ₀", (corner, 0.0), xytext=(0, -4), textcoords="offset points",
                  ha="center", va="top", color=INK.light)  # fmt: skip
    axes.annotate(SHORT["v_max"], (-factor * reach, top), xytext=(4, 0),
                  textcoords="offset points", va="center", color=INK.light)  # fmt: skip
    axes.plot([-0.8 * factor * reach, corner], [top, top], color=MUTED.light, lw=0.9, ls=":")


def _span(identification: Identification, name: str, value: float) -> tuple[float, float]:
    """The ends of a parameter's strip: those of the lag in milliseconds that matter."""
    model = identification.model
    if name == "offset":
        most = max(0.25 * model.theta_0, 1.5 * abs(value))
        return -most, most
    if name == "lag":
        return 0.0, max(2.0 * value, model.period)
    return 0.0, 2.0 * value
