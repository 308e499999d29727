"""The pages of the paper's experiment, on its own model and on the virtual robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from planner.report.figure import Figure
from planner.report.page import Page, file_link, parameters_of
from planner.report.paper_figures import FEATURED
from planner.report.paper_results import (
    Results,
    bounds_table,
    dropped_words,
    executed_table,
    foot_table,
    signed_percent,
    table_1,
    table_2,
)
from planner.report.table import Column, Row, Table, signed


def paper_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page of the experiment on the paper's model."""
    parameters = results["parameters"]
    rows = [
        *((words, f"{parameters['model'][name]:.6g}")
          for name, words in parameters_of([parameters["model"]]).items()),
        ("samples in a step of the walk", parameters["samples"]),
        ("of these clamped into the leg’s reach", parameters["clamped_samples"]),
        ("lines of each approximation", parameters["segments"]),
        ("rule that inverts a line", parameters["rule"]),
    ]  # fmt: skip
    values = _values(results, figures, files)
    return Page("paper", **values, bounds=bounds_table(results), parameters=rows).html()


def virtual_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page of the experiment on the virtual robot."""
    (learning,) = (figure for figure in figures if figure.name == "learning")
    return Page(
        "virtual",
        **_values(results, [each for each in figures if each is not learning], files),
        loss=signed_percent(results["foot"]["foot_optimal"]["loss"]),
        table_1=table_1(results),
        dropped=dropped_words(results),
        executed=executed_table(results),
        learning=learning,
        constants=constants_table(results["robot"]["constants"]),
    ).html()


def _values(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> dict[str, Any]:
    """What both pages show."""
    return {
        "results": results,
        "featured": [figure for figure in figures if figure.name in FEATURED],
        "others": [figure for figure in figures if figure.name not in FEATURED],
        "files": [(file_link(file), "") for file in files],
        "table_2": table_2(results),
        "foot_table": foot_table(results),
        "seconds": [(part.replace("_", " "), f"{s:.2f}") for part, s in results["seconds"].items()],
    }


def constants_table(constants: Results) -> Table:
    """The constants of the robot, with their sources."""
    rows = []
    for name, constant in constants.items():
        unit = constant["unit"].replace("^2", "²") if constant["unit"] != "1" else ""
        value = signed(f"{constant['value']:.4g} {unit}".strip())
        rows.append(Row(name.replace("_", " "), (value, constant["source"])))
    columns = (Column("value"), Column("source", words=True))
    return Table("constant", columns, tuple(rows), label="Constants")
