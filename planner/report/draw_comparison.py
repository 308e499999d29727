"""A picture of a cross-check: angles, requests, and where and why the requests differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.evaluation.differences import Interval
from planner.report.comparison_rows import REASON_WORDS, SHOWN
from planner.report.comparison_tints import TINTS
from planner.report.style import (
    CLOSED_FORM,
    DESIRED,
    FOOT_OPTIMAL,
    GRID,
    INK,
    MUTED,
    OPTIMAL,
    SURFACE,
    WIDTH,
    Role,
    applied,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.evaluation.cross_check import CrossCheck
    from planner.evaluation.foot_comparison import FootComparison
    from planner.evaluation.joint_comparison import JointComparison
    from planner.trajectory import Array

MOST_COLUMNS = 3
"""Joints side by side; more of them go below."""

COLUMN = 3.6
"""Width of one of several columns [inch]."""

ROWS = (1.45, 1.45, 1.05)
"""Heights of the panels of a joint [inch]: angles, requests, difference."""

FOOT_ROW = 1.5
"""Height of the foot's panel [inch]."""

EXTRA = 1.1
"""Height of the legends and of the time axis [inch]."""


SMALL: Mapping[str, Any] = {"fontweight": "normal", "fontsize": 8.0}
"""How figures beside a title look."""


def draw_comparison(check: CrossCheck) -> Figure:
    """Draw every joint, and below them the foot where there is one, all over the same time."""
    from matplotlib.figure import Figure

    with applied():
        columns = min(len(check.joints), MOST_COLUMNS)
        blocks = math.ceil(len(check.joints) / columns)
        heights = [*ROWS] * blocks + [FOOT_ROW] * (check.foot is not None)
        size = (WIDTH if columns == 1 else columns * COLUMN, sum(heights) + EXTRA)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.add_gridspec(len(heights), columns, height_ratios=heights)
        for number, joint in enumerate(check.joints):
            block, column = divmod(number, columns)
            panels = [
                figure.add_subplot(grid[block * len(ROWS) + row, column])
                for row in range(len(ROWS))
            ]
            _draw_joint(panels, joint, named=column == 0)
            below = number + columns < len(check.joints)
            _set_time(panels, check, named=not below and check.foot is None)
        if check.foot is not None:
            axes = figure.add_subplot(grid[-1, :])
            _draw_foot(axes, check.foot, cyclic=check.cyclic)
            _set_time([axes], check, named=True)
        figure.align_ylabels()
        _draw_legends(figure, check)
    return figure


def draw_joint(check: CrossCheck, joint: JointComparison) -> Figure:
    """Draw one of the joints alone."""
    from matplotlib.figure import Figure

    one = replace(check, joints=(joint,), foot=None)
    with applied():
        figure = Figure(figsize=(WIDTH, sum(ROWS) + EXTRA), layout="constrained")
        panels = list(figure.subplots(len(ROWS), 1, height_ratios=ROWS))
        _draw_joint(panels, joint, named=True)
        panels[0].set_title("")
        _set_time(panels, one, named=True)
        figure.align_ylabels()
        _draw_legends(figure, one)
    return figure


def draw_foot(check: CrossCheck) -> Figure:
    """Draw the foot's distances alone."""
    from matplotlib.figure import Figure

    assert check.foot is not None, "only a leg has a foot"
    with applied():
        figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
        axes = figure.add_subplot()
        _draw_foot(axes, check.foot, cyclic=check.cyclic)
        axes.set_title("")
        _set_time([axes], check, named=True)
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure


def _draw_joint(panels: list[Axes], joint: JointComparison, *, named: bool) -> None:
    angles, requests, apart = panels
    closed_form, optimal = joint.plans[SHOWN], joint.plans["optimal"]
    cyclic = optimal.cyclic
    for plan, role in ((closed_form, CLOSED_FORM), (optimal, OPTIMAL)):
        _draw_line(angles, np.degrees(plan.predicted), role, cyclic=cyclic)
        _draw_line(requests, np.degrees(plan.requests), role, cyclic=cyclic)
    _draw_line(angles, np.degrees(joint.desired), DESIRED, cyclic=cyclic)
    _draw_limits(requests, joint)
    difference = np.degrees(closed_form.requests - optimal.requests)
    for axes in (requests, apart):
        _draw_reasons(axes, joint.differences[SHOWN].intervals, len(difference))
    apart.axhline(0.0, color=MUTED.light, lw=0.7)
    _draw_line(apart, difference, INK._replace(width=1.3), cyclic=cyclic)
    angles.set_title(joint.name)
    angles.set_title(_figures(joint), loc="right", **SMALL)
    apart.set_title("requests, closed form − optimised", loc="right", **SMALL)
    for axes, name in zip(
        panels, ("angle [deg]", "request [deg]", "difference [deg]"), strict=True
    ):
        axes.margins(y=0.09)
        if named:
            axes.set_ylabel(name)


def _figures(joint: JointComparison) -> str:
    """The errors in a line, and what none can go below."""
    norm = joint.plans["optimal"].norm
    closed_form, optimal = (
        math.degrees(joint.plans[method].error) for method in (SHOWN, "optimal")
    )
    return f"{norm} {closed_form:.2f}° → {optimal:.2f}°, bound {math.degrees(joint.bound):.2f}°"


def _draw_line(axes: Axes, values: Array, role: Role, *, cyclic: bool) -> None:
    """A curve over the samples; a cycle up to where it begins again."""
    drawn = np.append(values, values[0]) if cyclic else values
    axes.plot(np.arange(len(drawn)), drawn, **role.line)


def _draw_limits(axes: Axes, joint: JointComparison) -> None:
    """The limits on the requests, where they are near the requests that keep them."""
    optimal = joint.plans["optimal"]
    if optimal.limits is None:
        return
    low, high = float(np.min(optimal.requests)), float(np.max(optimal.requests))
    margin = 0.1 * (high - low)
    for limit in optimal.limits:
        if low - margin <= limit <= high + margin:
            axes.axhline(math.degrees(limit), color=MUTED.light, lw=1.0, ls=(0, (1, 1.5)))


def _draw_reasons(axes: Axes, intervals: tuple[Interval, ...], samples: int) -> None:
    """Colour the background by the reason why the requests differ."""
    for reason, tint in TINTS.items():
        same = [each for each in intervals if each.reason == reason]
        # An interval may go on at the beginning of the cycle.
        spans = [
            (each.start - 0.5 - before, each.samples) for each in same for before in (0, samples)
        ]
        axes.broken_barh(
            spans,
            (0.0, 1.0),
            transform=axes.get_xaxis_transform(),
            facecolor=tint.colour,
            edgecolor=SURFACE.light,
            hatch=tint.hatch or None,
            linewidth=0.0,
            zorder=0,
        )


def _draw_foot(axes: Axes, foot: FootComparison, *, cyclic: bool) -> None:
    for method, role in (
        (SHOWN, CLOSED_FORM),
        ("optimal", OPTIMAL),
        ("foot_optimal", FOOT_OPTIMAL),
    ):
        _draw_line(axes, 100.0 * foot.plans[method].outcome.distances, role, cyclic=cyclic)
    axes.set_title("foot")
    rms = " → ".join(
        f"{100.0 * foot.plans[method].outcome.distance.rms:.2f}"
        for method in (SHOWN, "optimal", "foot_optimal")
    )
    axes.set_title(f"rms {rms} cm", loc="right", **SMALL)
    axes.set_ylabel("distance [cm]")
    axes.set_ylim(bottom=0.0)


def _set_time(panels: list[Axes], check: CrossCheck, *, named: bool) -> None:
    samples = len(check.joints[0].desired)
    for axes in panels:
        axes.set_xlim(0, samples if check.cyclic else samples - 1)
        if axes is not panels[-1]:
            axes.tick_params(labelbottom=False)
    if named:
        repeats = "; it repeats" if check.cyclic else ""
        panels[-1].set_xlabel(f"time [samples of {1000.0 * check.period:g} ms]{repeats}")


def _draw_legends(figure: Figure, check: CrossCheck) -> None:
    """The curves above, the reasons below."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    roles = [DESIRED, CLOSED_FORM, OPTIMAL] + [FOOT_OPTIMAL] * (check.foot is not None)
    lines = [Line2D([], [], **role.line) for role in roles]
    if any(joint.plans["optimal"].limits is not None for joint in check.joints):
        lines.append(Line2D([], [], color=MUTED.light, lw=1.0, ls=(0, (1, 1.5)), label="limit"))
    figure.legend(handles=lines, loc="outside upper left", ncols=len(lines))
    found = {reason for joint in check.joints for reason in joint.differences[SHOWN].shares}
    patches = [
        Patch(
            facecolor=tint.colour,
            edgecolor=SURFACE.light if tint.hatch else GRID.light,
            hatch=tint.hatch or None,
            label=REASON_WORDS[reason],
        )
        for reason, tint in TINTS.items()
        if reason in found
    ]
    figure.legend(
        handles=patches,
        loc="outside lower left",
        ncols=len(TINTS) if len(check.joints) >= MOST_COLUMNS else 3,
        title="why the requests differ, judged where they act",
        alignment="left",
        title_fontsize=8.5,
    )
