"""The tables that only the virtual robot has: its joints' Table 1, and what became of the plans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from planner.report.paper_tables import METHODS, distances_text
from planner.report.text_table import NOTHING, number, text_table

TABLE_1 = {
    "v_max_deg_per_tick": ("top speed", "degrees per tick"),
    "theta_0_deg": ("error that calls for it", "degrees"),
    "lag_ticks": ("lag", "ticks"),
    "acceleration_ticks": ("acceleration time", "ticks"),
    "offset_deg": ("static sag", "degrees"),
}
"""Rows of Table 1: key in the results, what it is, and its unit."""

PLANS = {
    "direct": "Des,Dir",
    "closed_form_plain": "Des,Plain",
    "closed_form": "Des,MB",
    "optimal": "Des,Opt",
    "foot_optimal": "Des,Foot",
}
"""The row of Table 2 that says how well a method tracks in the joints."""

ERRORS = {
    "rms_deg": "prediction of the step tests [deg rms]",
    "held_out_rms_deg": "the same, held out [deg rms]",
    "unseen_walk_rms_deg": "prediction of a walk never seen [deg rms]",
}
"""How well an identified model predicts: key in the results, and what it is."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of one joint with its 95 % interval; an end is None where nothing bounds it."""

    value: float
    lower: float | None
    upper: float | None

    @property
    def interval(self) -> str:
        """The interval in words."""
        return f"{number(self.lower)} to {number(self.upper)}".replace("-", "−")


@dataclass(frozen=True)
class ParameterRow:
    """A row of Table 1: what it is, its unit, one parameter per joint, and the paper's value."""

    label: str
    unit: str
    cells: tuple[Parameter, ...]
    paper: float | None


@dataclass(frozen=True)
class Promise:
    """What a plan predicted, what the robot made of it, and the loss as a share."""

    predicted: float
    executed: float
    loss: float

    @property
    def percent(self) -> str:
        """The loss with a sign."""
        return signed_percent(self.loss)


@dataclass(frozen=True)
class PromiseRow:
    """A method with its promises: of each joint [degrees], if it makes any, and the foot [cm]."""

    label: str
    cells: tuple[Promise | None, ...]


def table1_rows(results: Mapping[str, Any]) -> list[ParameterRow]:
    """Table 1, one cell per joint."""
    rows = []
    for key, (label, unit) in TABLE_1.items():
        entries = [joint["table1"][key] for joint in results["identified"].values()]
        cells = tuple(Parameter(each["value"], each["lower"], each["upper"]) for each in entries)
        rows.append(ParameterRow(label, unit, cells, entries[0]["paper"]))
    return rows


def promise_rows(results: Mapping[str, Any]) -> list[PromiseRow]:
    """Predicted and executed accuracy (L2) by method: the joints', then the foot's."""
    rows = []
    for method, label in METHODS.items():
        pair = PLANS.get(method)
        joints = [
            None if pair is None else _promise(joint[pair]) for joint in results["table2"].values()
        ]
        rows.append(PromiseRow(label.split(":")[0], (*joints, _promise(results["foot"][method]))))
    return rows


def signed_percent(share: float) -> str:
    """A share as a percentage with a sign."""
    tenths = round(1000.0 * share)
    return f"{tenths / 10.0:+.1f} %".replace("-", "−") if tenths else "0.0 %"


def dropped_words(results: Mapping[str, Any]) -> str:
    """How many cycles were left out, over all methods."""
    dropped = results["robot"]["dropped_cycles"].values()
    low, high = min(dropped), max(dropped)
    return f"{low}" if low == high else f"{low} to {high}"


def virtual_text(results: Mapping[str, Any]) -> str:
    """All tables as plain text, for the terminal."""
    joints = list(results["table2"])
    blocks = [
        "What the step tests say about the joints: estimate (95 % interval)",
        text_table(
            ["", *joints, "paper"],
            [
                [
                    f"{row.label} [{row.unit}]",
                    *(
                        f"{cell.value:.2f}".replace("-", "−") + f" ({cell.interval})"
                        for cell in row.cells
                    ),
                    number(row.paper, 1),
                ]
                for row in table1_rows(results)
            ]
            + [
                [label, *(number(each[key]) for each in results["identified"].values()), NOTHING]
                for key, label in ERRORS.items()
            ],
        ),
        "",
        distances_text(results),
        "",
        "L2 as predicted by the plan > as executed (loss); joints [deg], foot [cm]",
        text_table(
            ["", *joints, "foot"],
            [
                [row.label, *(_promise_text(cell) for cell in row.cells)]
                for row in promise_rows(results)
            ],
        ),
        "",
        f"Means ± standard deviations over {results['robot']['cycles']} cycles by the true angles, "
        f"after {dropped_words(results)} until the walk was steady.",
        results["note"],
    ]
    return "\n".join(blocks)


def _promise(entry: Mapping[str, Any]) -> Promise:
    return Promise(entry["predicted"]["L2"], entry["L2"], entry["loss"])


def _promise_text(cell: Promise | None) -> str:
    if cell is None:
        return NOTHING
    return f"{cell.predicted:.2f} > {cell.executed:.2f} ({cell.percent})"
