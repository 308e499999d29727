"""The paper's experiment for people: its tables, its text and its page.

Its joints are of the paper's model or servos of the virtual robot, as in ``results.json``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from planner.evaluation.reproduction import PAIRS
from planner.report.figure import Figure
from planner.report.page import Page, file_link, parameters_of
from planner.report.paper_figures import FEATURED
from planner.report.paper_results import COMPARISONS, METHODS, Results
from planner.report.table import NOTHING, Column, Row, Table, number, percent, signed
from planner.report.wording import rendered_text

GAPS = {
    "closed form, as in the paper": "closed_form_plain_gap",
    "closed form, knots refined": "closed_form_gap",
    "optimised": "gap",
}
"""Methods whose gaps over the lower bound the results hold, and the key of each."""

NORMS = {"L2": "L₂", "Linf": "L∞"}

TABLE_1 = {
    "v_max_deg_per_tick": "top speed [degrees per tick]",
    "theta_0_deg": "error that calls for it [degrees]",
    "lag_ticks": "lag [ticks]",
    "acceleration_ticks": "acceleration time [ticks]",
    "offset_deg": "static sag [degrees]",
}
"""Rows of Table 1: key in the results, and title."""

ERRORS = {
    "rms_deg": "prediction of the step tests [deg rms]",
    "held_out_rms_deg": "the same, held out [deg rms]",
    "unseen_walk_rms_deg": "prediction of a walk never seen [deg rms]",
}
"""Errors of an identified model: key in the results, and title."""

PLANS = {method: pair for pair, method in PAIRS.items() if pair.startswith("Des")}
"""The row of Table 2 with a method's errors in the joints."""


def experiment_text(results: Results) -> str:
    """All tables as plain text, for the terminal."""
    return rendered_text(f"{_template(results)}.txt", **_values(results))


def experiment_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page, with links to files beside it."""
    alone = [figure for figure in figures if figure.name == "learning"]
    return Page(
        _template(results),
        **_values(results),
        featured=[figure for figure in figures if figure.name in FEATURED],
        learning=alone,
        others=[each for each in figures if each not in alone and each.name not in FEATURED],
        files=[(file_link(file), "") for file in files],
        seconds=[(part.replace("_", " "), f"{s:.2f}") for part, s in results["seconds"].items()],
    ).html()


def _template(results: Results) -> str:
    return "virtual" if "robot" in results else "paper"


def _values(results: Results) -> dict[str, Any]:
    """The tables, and what the sentences say."""
    values = {"results": results, "table_2": table_2(results), "foot_table": foot_table(results)}
    parameters = results["parameters"]
    if "robot" in results:
        dropped = results["robot"]["dropped_cycles"].values()
        return values | {
            "table_1": table_1(results),
            "executed": executed_table(results),
            "dropped": " to ".join(dict.fromkeys(f"{end(dropped)}" for end in (min, max))),
            "loss": signed_percent(results["foot"]["foot_optimal"]["loss"]),
            "constants": constants_table(results["robot"]["constants"]),
        }
    names = parameters_of([parameters["model"]]).items()
    return values | {
        "bounds": bounds_table(results),
        "parameters": [
            *((words, f"{parameters['model'][name]:.6g}") for name, words in names),
            ("samples in a step of the walk", parameters["samples"]),
            ("of these clamped into the leg’s reach", parameters["clamped_samples"]),
            ("lines of each approximation", parameters["segments"]),
            ("rule that inverts a line", parameters["rule"]),
        ],
    }


def table_2(results: Results) -> Table:
    """Table 2: one row per comparison and norm, a cell per joint [degrees]."""
    rows = []
    for comparison, label in COMPARISONS.items():
        entries = [joint[comparison] for joint in results["table2"].values()]
        kind = "beyond" if all(entry["paper"] is None for entry in entries) else ""
        for norm, words in NORMS.items():
            rows.append(Row(words, tuple(_beside(e, norm) for e in entries), label, kind))
    columns = tuple(_column(joint) for joint in results["table2"])
    return Table("degrees", columns, tuple(rows), label="Table 2", apart=True)


def foot_table(results: Results) -> Table:
    """The foot: one row per method, a cell for each norm [cm]."""
    rows = []
    for method, label in METHODS.items():
        entry = results["foot"][method]
        cells = tuple(_beside(entry, norm) for norm in NORMS)
        rows.append(Row(label, cells, kind="beyond" if entry["paper"] is None else ""))
    columns = tuple(map(_column, NORMS.values()))
    return Table("centimetres", columns, tuple(rows), label="Foot distances")


def bounds_table(results: Results) -> Table:
    """The lower bound of every joint, the plans' gaps, and how far requests go beyond limits."""
    bounds, limits = results["bounds"].values(), results["limits"].values()
    ends = (signed(f"{limit['lower']:.0f} to {limit['upper']:.0f}") for limit in limits)
    rows = [
        Row("lower bound [degrees]", tuple(number(bound["rms"], 3) for bound in bounds)),
        *(Row(f"gap, {label}", tuple(percent(bound[key]) for bound in bounds))
          for label, key in GAPS.items()),
        Row("limits of the requests [degrees]", tuple(ends)),
    ]  # fmt: skip
    for method in ("closed_form_plain", "closed_form", "optimal", "foot_optimal"):
        excesses = (limit["excess"][method] for limit in limits)
        cells = tuple(f"{excess:.1f}" if excess else "kept" for excess in excesses)
        rows.append(Row(f"beyond them, {METHODS[method].split(':')[0]} [degrees]", cells))
    return Table("", tuple(map(Column, results["bounds"])), tuple(rows), label="Lower bounds")


def table_1(results: Results) -> Table:
    """Table 1: the identified parameters of every joint, and how well they predict."""
    joints = results["identified"].values()
    rows = []
    for key, label in TABLE_1.items():
        entries = [joint["table1"][key] for joint in joints]
        cells = [
            signed(f"{e['value']:.2f}\n{number(e['lower'])} to {number(e['upper'])}")
            for e in entries
        ]
        rows.append(Row(label, (*cells, number(entries[0]["paper"], 1))))
    for key, label in ERRORS.items():
        cells = [number(joint[key]) for joint in joints]
        rows.append(Row(label, (*cells, NOTHING), kind="beyond"))
    columns = tuple(map(Column, (*results["identified"], "paper")))
    return Table("joint", columns, tuple(rows), label="Table 1")


def executed_table(results: Results) -> Table:
    """Predicted and executed accuracy (L2) by method: the joints' [degrees], the foot's [cm]."""
    rows = []
    for method, label in METHODS.items():
        pair = PLANS.get(method)
        joints = [
            (NOTHING,) * 3 if pair is None else _executed(joint[pair])
            for joint in results["table2"].values()
        ]
        cells = (*joints, _executed(results["foot"][method]))
        rows.append(Row(label.split(":")[0], cells))
    columns = tuple(
        Column(name, ("planned", "executed", "loss"), joined="{0} > {1} ({2})")
        for name in (*results["table2"], "foot")
    )
    return Table("L₂", columns, tuple(rows), label="Planned and executed")


def signed_percent(share: float) -> str:
    """A share as a percentage with a sign."""
    tenths = round(1000.0 * share)
    return signed(f"{tenths / 10.0:+.1f} %") if tenths else "0.0 %"


def difference(ours: float, paper: float) -> str:
    """Our figure relative to the paper's, with a sign."""
    percents = round(100.0 * (ours / paper - 1.0))
    return signed(f"{percents:+d} %") if percents else "0 %"


def _column(title: str) -> Column:
    return Column(title, ("ours", "paper", "diff."), joined="{0} / {1} ({2})")


def _beside(entry: Results, norm: str) -> tuple[str, ...]:
    """One of our figures, the paper's, and the difference."""
    ours = f"{entry[norm]:.2f}"
    if "std" in entry:
        deviation = entry["std"][norm]
        ours += f"\n± {deviation:.{2 if deviation >= 0.005 else 3}f}"
    if entry["paper"] is None:
        return ours, NOTHING, NOTHING
    paper = entry["paper"][norm]
    return ours, f"{paper:.2f}", difference(entry[norm], paper)


def _executed(entry: Results) -> tuple[str, ...]:
    return (f"{entry['predicted']['L2']:.2f}", f"{entry['L2']:.2f}", signed_percent(entry["loss"]))


def constants_table(constants: Results) -> Table:
    """The constants of the robot, with their sources."""
    rows = []
    for name, constant in constants.items():
        unit = constant["unit"].replace("^2", "²") if constant["unit"] != "1" else ""
        value = signed(f"{constant['value']:.4g} {unit}".strip())
        rows.append(Row(name.replace("_", " "), (value, constant["source"])))
    columns = (Column("value"), Column("source", words=True))
    return Table("constant", columns, tuple(rows), label="Constants")
