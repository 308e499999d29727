"""Pairs of figures: Table 2 beside the paper's, and plans beside their execution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.evaluation.reproduction import TABLE_2, published
from planner.report.figure import Axis, Curve, Figure, Panel, Words, joined
from planner.report.paper.tables import COMPARISONS
from planner.report.style import CLOSED_FORM, GRID, INK

if TYPE_CHECKING:
    from planner.evaluation.reproduction import Reproduction

COMPARED = ("Des,Dir", "Des,Plain", "Pwl,Plain")
"""The comparisons of Table 2, each under the paper's own method."""


class Pair(NamedTuple):
    """A figure of Table 2.

    Attributes:
        comparison: Its comparison in the table.
        joint: Its joint.
        norm: Norm of the distance.
        row: Its place.
        ours: Our figure [deg].
        paper: The paper's [deg].
    """

    comparison: str
    joint: str
    norm: str
    row: float
    ours: float
    paper: float


def agreement_pairs(reproduction: Reproduction) -> list[Pair]:
    """All pairs, comparison by comparison and joint by joint, two to a row."""
    pairs, row = [], 0.0
    for comparison in COMPARED:
        row += 1.2
        for joint in TABLE_2:
            row += 1.0
            ours, paper = reproduction.table2[joint][comparison], published(joint, comparison)
            assert paper is not None, "these are the comparisons of Table 2"
            pairs.append(Pair(comparison, joint, "L₂", row, ours.rms, paper.L2.mean))
            pairs.append(Pair(comparison, joint, "L∞", row, ours.max, paper.Linf.mean))
    return pairs


def agreement_figure(reproduction: Reproduction) -> Figure:
    """Dumb-bells: the paper's figure at one end, ours at the other."""
    pairs = agreement_pairs(reproduction)
    tops = {
        COMPARISONS[pair.comparison].removesuffix(", as in the paper"): pair.row
        for pair in reversed(pairs)
    }
    return dumb_bells(
        "table2_agreement",
        (
            "Table 2 at a glance",
            "Each row is a joint: the paper's robot and the paper's model. The closed form is that "
            "of the paper, with knots chosen automatically.",
        ),
        Axis("L₂ and, farther right, L∞", "deg"),
        rows={pair.row: pair.joint for pair in pairs},
        places=[pair.row for pair in pairs],
        ends=(
            Curve(INK, np.array([pair.paper for pair in pairs]), np.empty(0), "the paper's robot"),
            Curve(CLOSED_FORM, np.array([pair.ours for pair in pairs]), np.empty(0),
                  "the paper's model, here"),
        ),
        notes=tuple(f"{pair.joint}, {pair.norm}" for pair in pairs),
        words=[
            Words(name, 0.0, top - 0.9, across="left", bold=True) for name, top in tops.items()
        ],
    )  # fmt: skip


def dumb_bells(
    name: str,
    about: tuple[str, str],
    axis: Axis,
    *,
    rows: Mapping[float, str],
    places: Sequence[float],
    ends: tuple[Curve, Curve],
    notes: tuple[str, ...],
    words: Sequence[Words] = (),
    more: Sequence[Curve] = (),
    link: str = "difference",
) -> Figure:
    """Pairs of values in rows, joined by lines.

    Args:
        name: The figure's name.
        about: Title and caption.
        axis: The axis of the values.
        rows: Name of each row, by its place.
        places: The row of each pair.
        ends: The first and the second value of every pair; their heights are the places.
        notes: Label of each pair.
        words: Words between the rows.
        more: Marks beside the pairs.
        link: Meaning of the lines.
    """
    first, second = ends
    heights = np.asarray(places, float)
    bars = Curve(
        GRID._replace(width=2.6),
        joined(np.stack([first.x, second.x], axis=1)),
        joined(np.stack([heights, heights], axis=1)),
        link,
    )
    marked = [
        Curve(first.role, first.x, heights, first.label, marks="rings", notes=notes),
        Curve(second.role, second.x, heights, second.label, marks="dots", notes=notes),
    ]
    most = 1.06 * max(float(each.x.max()) for each in (first, second, *more))
    low, high = min(rows) - (1.6 if words else 0.6), max(rows) + 0.6
    return Figure(
        name,
        *about,
        Axis(axis.title, axis.unit, (0.0, most)),
        (
            Panel(
                Axis("", range=(high, low), names=rows),
                (bars, *marked, *more),
                words=tuple(words),
                height=0.2 * (high - low) + 0.4,
            ),
        ),
    )
