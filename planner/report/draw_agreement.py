"""A picture of Table 2 as a whole: every figure of ours against the paper's, still and live."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.evaluation.paper import TABLE_2, published
from planner.report.curves import Curve
from planner.report.live_plane import Axis, plane_plot
from planner.report.live_words import label
from planner.report.paper_tables import COMPARISONS
from planner.report.style import CLOSED_FORM, GRID, INK, WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import Reproduction


DRAWN = ("Des,Dir", "Des,Plain", "Pwl,Plain")
"""The comparisons of Table 2, each under the paper's own method."""

NORMS = {"L₂": "o", "L∞": "D"}
"""The distances, and their markers."""


class Pair(NamedTuple):
    """A figure of Table 2.

    Attributes:
        comparison: What of the table it is about.
        joint: Whose it is.
        norm: Which distance.
        row: Where it stands.
        ours: Our figure [deg].
        theirs: The paper's [deg].
    """

    comparison: str
    joint: str
    norm: str
    row: float
    ours: float
    theirs: float


def pairs(reproduction: Reproduction) -> list[Pair]:
    """All pairs, comparison by comparison and joint by joint, two to a row."""
    found, row = [], 0.0
    for comparison in DRAWN:
        row += 1.2
        for joint in TABLE_2:
            row += 1.0
            ours, theirs = reproduction.table2[joint][comparison], published(joint, comparison)
            assert theirs is not None, "these are the comparisons of Table 2"
            for norm, our, their in (
                ("L₂", ours.rms, theirs.L2.mean),
                ("L∞", ours.max, theirs.Linf.mean),
            ):
                found.append(Pair(comparison, joint, norm, row, our, their))
    return found


def agreement_plot(reproduction: Reproduction) -> dict[str, Any]:
    """Dumb-bells to point at."""
    every = pairs(reproduction)
    rows = np.array([pair.row for pair in every])
    ours, theirs = (np.array([getattr(pair, who) for pair in every]) for who in ("ours", "theirs"))
    told = tuple(f"{pair.joint}, {pair.norm}" for pair in every)
    gaps = np.full(len(every), np.nan)
    joined = np.column_stack([ours, theirs, gaps]).ravel()
    across = np.column_stack([rows, rows, gaps]).ravel()
    tops = {pair.comparison: pair.row for pair in reversed(every)}
    most = 1.06 * float(max(ours.max(), theirs.max()))
    return plane_plot(
        [
            Curve(GRID._replace(label="difference", width=2.6), joined, across),
            Curve(INK, theirs, rows, "the paper's robot", dots=True, notes=told),
            Curve(CLOSED_FORM, ours, rows, "the paper's model, here", dots=True, filled=1.0,
                  notes=told),
        ],
        Axis("distance [deg]: in each row L₂ and, farther right, L∞", "deg", (0.0, most)),
        Axis("", range=(float(rows.max()) + 0.8, 0.4),
             names={pair.row: pair.joint for pair in every}),
        height=420,
        words=[
            label(COMPARISONS[name], 0.0, top - 0.9, bold=True, xanchor="left")
            for name, top in tops.items()
        ],
    )  # fmt: skip


def draw_agreement(reproduction: Reproduction) -> Figure:
    """Dumb-bells: the paper's figure at one end, ours at the other, a row per figure of Table 2."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    axes = figure.add_subplot()
    every = pairs(reproduction)
    for name, top in {pair.comparison: pair.row for pair in reversed(every)}.items():
        axes.text(0.0, top - 0.9, COMPARISONS[name], fontweight="bold", fontsize=8.5, va="center",
                  color=INK.light)  # fmt: skip
    for pair in every:
        marker, row = NORMS[pair.norm], pair.row
        axes.plot([pair.ours, pair.theirs], [row, row], color=GRID.light, lw=3, zorder=1)
        axes.plot(pair.theirs, row, marker, ms=6, mfc="none", mec=INK.light, mew=1.2, zorder=3)
        axes.plot(pair.ours, row, marker, ms=4.5, color=CLOSED_FORM.light, zorder=2)
    rows = {pair.row: pair.joint for pair in every}
    axes.set_yticks(list(rows), list(rows.values()))
    axes.set_ylim(max(rows) + 0.8, 0.5)
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(left=0.0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("distance [deg]: circles L₂, diamonds L∞")
    axes.plot([], [], "o", ms=6, mfc="none", mec=INK.light, mew=1.2, label="the paper's robot")
    axes.plot([], [], "o", ms=4.5, color=CLOSED_FORM.light, label="the paper's model, here")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
    return figure
