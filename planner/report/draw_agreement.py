"""A picture of Table 2 as a whole: every figure of ours against the paper's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from planner.evaluation.paper import TABLE_2, published
from planner.report.paper_tables import COMPARISONS
from planner.report.style import CLOSED_FORM, GRID, INK, WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import Reproduction


DRAWN = ("Des,Dir", "Des,Plain", "Pwl,Plain")
"""The comparisons of Table 2, each under the paper's own method."""


def draw_agreement(reproduction: Reproduction) -> Figure:
    """Dumb-bells: the paper's figure at one end, ours at the other, a row per figure of Table 2."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    axes = figure.add_subplot()
    ticks, names = [], []
    row = 0.0
    for comparison in DRAWN:
        row += 1.3
        label = COMPARISONS[comparison]
        axes.text(0.0, row, label, fontweight="bold", fontsize=8.5, va="center", color=INK.light)
        row -= 0.1
        for joint in TABLE_2:
            row += 1.0
            ours, theirs = reproduction.table2[joint][comparison], published(joint, comparison)
            assert theirs is not None, "these are the comparisons of Table 2"
            for our, their, marker in (
                (ours.rms, theirs.L2.mean, "o"),
                (ours.max, theirs.Linf.mean, "D"),
            ):
                axes.plot([our, their], [row, row], color=GRID.light, lw=3, zorder=1)
                axes.plot(their, row, marker, ms=6, mfc="none", mec=INK.light, mew=1.2, zorder=3)
                axes.plot(our, row, marker, ms=4.5, color=CLOSED_FORM.light, zorder=2)
            ticks.append(row)
            names.append(joint)
    axes.set_yticks(ticks, names)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(row + 0.8, 0.5)
    axes.set_xlim(left=0.0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("distance [deg]: circles L₂, diamonds L∞")
    axes.plot([], [], "o", ms=6, mfc="none", mec=INK.light, mew=1.2, label="the paper's robot")
    axes.plot([], [], "o", ms=4.5, color=CLOSED_FORM.light, label="the paper's model, here")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
    return figure
