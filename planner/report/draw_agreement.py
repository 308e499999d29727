"""A picture of Table 2 as a whole: every figure of ours against the paper's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from planner.evaluation.paper import TABLE_2
from planner.report.paper_tables import COMPARISONS
from planner.report.style import CLOSED_FORM, GRID, INK, WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import Reproduction


def draw_agreement(reproduction: Reproduction) -> Figure:
    """Dumb-bells: the paper's figure at one end, ours at the other, a row per figure of Table 2."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    axes = figure.add_subplot()
    ticks, names = [], []
    row = 0.0
    for comparison, label in COMPARISONS.items():
        if comparison not in TABLE_2["rotator"]:
            continue
        row += 0.9
        axes.text(0.0, row, label, fontweight="bold", fontsize=8.5, va="center", color=INK.light)
        for joint, comparisons in TABLE_2.items():
            row += 1.0
            ours = reproduction.table2[joint][comparison]
            theirs = comparisons[comparison]
            for our, their in ((ours.rms, theirs.L2.mean), (ours.max, theirs.Linf.mean)):
                axes.plot([our, their], [row, row], color=GRID.light, lw=3, zorder=1)
                axes.plot(their, row, "o", ms=6, mfc="none", mec=INK.light, mew=1.2, zorder=3)
                axes.plot(our, row, "o", ms=4.5, color=CLOSED_FORM.light, zorder=2)
            ticks.append(row)
            names.append(joint)
    axes.set_yticks(ticks, names)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(row + 0.8, 0.1)
    axes.set_xlim(left=0.0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("distance [deg]: L₂ left, L∞ right in each row")
    axes.plot([], [], "o", ms=6, mfc="none", mec=INK.light, mew=1.2, label="the paper's robot")
    axes.plot([], [], "o", ms=4.5, color=CLOSED_FORM.light, label="the paper's model, here")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
    return figure
