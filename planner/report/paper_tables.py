"""The tables of the report: our figures beside the paper's, with the difference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from planner.report.text_table import NOTHING, number, percent, text_table

COMPARISONS = {
    "Des,Dir": "desired to direct",
    "Des,Plain": "desired to closed form, as in the paper",
    "Pwl,Plain": "approximation to closed form, as in the paper",
    "Des,MB": "desired to closed form, knots refined",
    "Pwl,MB": "approximation to closed form, knots refined",
    "Des,Opt": "desired to optimised",
    "Des,Foot": "desired to foot-optimised",
}
"""What pairs of trajectories are called in words; Plain and MB are the paper's MB."""

METHODS = {
    "direct": "direct: request the desired angles",
    "shift": "best time shift of them",
    "closed_form_plain": "closed form, as in the paper",
    "closed_form": "closed form, knots refined",
    "optimal": "optimised joint by joint",
    "foot_optimal": "foot-optimised: all joints at once",
}

GAPS = {
    "closed form, as in the paper": "closed_form_plain_gap",
    "closed form, knots refined": "closed_form_gap",
    "optimised": "gap",
}
"""Whose gaps over the lower bound the results hold, and under which key."""

KEPT = ("closed_form_plain", "closed_form", "optimal", "foot_optimal")
"""The methods whose requests are held against the limits of the joints."""

NORMS = {"L2": "L₂", "Linf": "L∞"}


@dataclass(frozen=True)
class Cell:
    """One of our figures, and the paper's where it has one.

    Attributes:
        ours: Ours; a mean where it was measured over several cycles.
        paper: The paper's.
        deviation: Standard deviation of ours over the cycles; None where it is computed.
    """

    ours: float
    paper: float | None
    deviation: float | None = None

    @property
    def spread(self) -> str:
        """The deviation in words, one digit of it at least; empty where there is none."""
        if self.deviation is None:
            return ""
        return f"± {self.deviation:.{2 if self.deviation >= 0.005 else 3}f}"

    @property
    def difference(self) -> str:
        """Relative to the paper's figure, with a sign."""
        if self.paper is None:
            return NOTHING
        percents = round(100.0 * (self.ours / self.paper - 1.0))
        return f"{percents:+d} %".replace("-", "−") if percents else "0 %"


@dataclass(frozen=True)
class Row:
    """A row of a table: what is measured, in which norm, and one cell per column."""

    label: str
    norm: str
    cells: tuple[Cell, ...]
    ours_only: bool


def table2_rows(results: Mapping[str, Any]) -> list[Row]:
    """Table 2: one row per comparison and norm, one cell per joint [degrees]."""
    joints = list(results["table2"].values())
    return [
        _row(label, norm, [joint[comparison] for joint in joints])
        for comparison, label in COMPARISONS.items()
        for norm in NORMS
    ]


def foot_rows(results: Mapping[str, Any]) -> list[Row]:
    """The foot: one row per method, a cell for each norm [cm]."""
    rows = []
    for method, label in METHODS.items():
        entry = results["foot"][method]
        cells = tuple(_cell(entry, norm) for norm in NORMS)
        rows.append(Row(label, "", cells, entry["paper"] is None))
    return rows


def distances_text(results: Mapping[str, Any]) -> str:
    """Table 2 and the foot as plain text."""
    blocks = [
        "Distances between joint trajectories [deg]: ours / the paper's (difference)",
        text_table(
            ["", "", *results["table2"]],
            [
                [row.label if row.norm == NORMS["L2"] else "", row.norm, *map(_text, row.cells)]
                for row in table2_rows(results)
            ],
        ),
        "",
        "Distance of the foot from its desired path [cm]: ours / the paper's (difference)",
        text_table(
            ["", *NORMS.values()],
            [[row.label, *map(_text, row.cells)] for row in foot_rows(results)],
        ),
        foot_bound_text(results),
    ]
    return "\n".join(blocks)


def foot_bound_text(results: Mapping[str, Any]) -> str:
    """What is proved about the foot."""
    bound = results["foot_bound"]
    return (
        f"No requests within the joints' limits bring the model's foot below {bound['L2']:.3f} cm "
        f"rms; the foot-optimised plan promises {percent(bound['gap'])} more."
    )


def paper_text(results: Mapping[str, Any]) -> str:
    """All tables as plain text, for the terminal."""
    joints = list(results["table2"])
    blocks = [
        distances_text(results),
        "",
        "No requests whatever track better than this [deg rms]; gap: how far above a plan is",
        text_table(
            ["", *joints],
            [
                ["lower bound", *(number(bound["rms"]) for bound in results["bounds"].values())],
                *(
                    [
                        f"gap, {label}",
                        *(percent(bound[key]) for bound in results["bounds"].values()),
                    ]
                    for label, key in GAPS.items()
                ),
            ],
        ),
        "",
        "How far requests go beyond the joint's limits [deg]: the closed form knows none",
        text_table(
            ["", *joints],
            [
                [
                    METHODS[method].split(":")[0],
                    *(_beyond(limits["excess"][method]) for limits in results["limits"].values()),
                ]
                for method in KEPT
            ],
        ),
        "",
        "Closed form and optimised requests are planned joint by joint: better in every joint need",
        "not be better in the foot. Refining the knots is ours, not the paper's.",
        f"The ten baseline figures (direct, shift) deviate from the paper's by "
        f"{100.0 * results['baseline_deviation']:.1f} % on average.",
        results["note"],
    ]
    return "\n".join(blocks)


def _beyond(excess: float) -> str:
    return f"{excess:.1f}" if excess else "kept"


def _row(label: str, norm: str, entries: list[Mapping[str, Any]]) -> Row:
    cells = tuple(_cell(entry, norm) for entry in entries)
    return Row(label, NORMS[norm], cells, all(cell.paper is None for cell in cells))


def _cell(entry: Mapping[str, Any], norm: str) -> Cell:
    return Cell(
        entry[norm],
        None if entry["paper"] is None else entry["paper"][norm],
        entry["std"][norm] if "std" in entry else None,
    )


def _text(cell: Cell) -> str:
    ours = f"{cell.ours:.2f} {cell.spread}".strip()
    if cell.paper is None:
        return ours
    return f"{ours} / {cell.paper:.2f} ({cell.difference})"
