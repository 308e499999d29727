"""The pages about identified joints and about a calibration: verdict first, sources last."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.identification.result import Identification
from planner.report.identification.figures import (
    cloud_figure,
    cloud_of,
    intervals_figure,
    log_figure,
)
from planner.report.identification.text import next_step
from planner.report.identification.words import (
    determined_words,
    errors_table,
    explained,
    joints_table,
    of_several,
    parameters,
    parameters_table,
    profile,
    telling_error,
    units_of,
    verdict,
)
from planner.report.page import Page, parameters_of
from planner.report.table import Column, Row, Table, number
from planner.robot.candidates import WORDS, Compared


def identification_page(identifications: Mapping[str, Identification]) -> Page:
    """The whole page: of a joint, or of several one after the other, below a table of all."""
    several = len(identifications) > 1
    joints = [
        _joint_values(name, each, f"joint{k}_" if several else "")
        for k, (name, each) in enumerate(identifications.items(), 1)
    ]
    return Page(
        "identification",
        joints=joints,
        good=all(each.accepted for each in identifications.values()),
        summary=of_several(list(identifications.values())),
        table=_units_above(joints_table(identifications)),
        rare=explained(identifications),
    )


def _joint_values(name: str, found: Identification, prefix: str) -> dict[str, Any]:
    """What the page shows of a joint: figures, tables, and numbers in the units of the page."""
    units, (error, where) = units_of(found), telling_error(found)

    def angle(radians: float) -> str:
        return f"{units.factor * radians:.3g} {units.angle}"

    return {
        "name": name,
        "of": found,
        "anchor": re.sub(r"\W+", "-", f"{prefix}{name or 'joint'}"),
        "verdict": verdict(found),
        "determined": determined_words(found),
        "profile": profile(found),
        "error": angle(error).split(" ", 1),
        "where": where,
        "noise": angle(found.noise),
        "signal": angle(found.signal),
        "short": {row.name: row.bounds if row.rough else row.value for row in parameters(found)},
        # whether the joint may be faster than anything in the logs
        "open": math.isinf(found.intervals["v_max"].upper),
        "saturated": saturated(found),
        "speeds": cloud_figure(found, prefix),
        "parameters": parameters_table(found, page=True),
        "intervals": intervals_figure(found, prefix),
        "errors": errors_table(found),
        "logs": [
            (fit.log.name, angle(fit.rms), log_figure(found, fit, f"{prefix}log{k}_"))
            for k, fit in enumerate(found.fits, 1)
        ],
        "rows": logs_table(found),
        "names": parameters_of([found.model.parameters()]),
    }


def saturated(identification: Identification) -> float:
    """Share of the measured intervals that were wholly at the top speed."""
    points, *_ = cloud_of(identification)
    return int(np.sum(points.saturated)) / max(1, len(points.errors))


def _units_above(table: Table) -> Table:
    """The table with a unit beside the title of a column whose cells all have it, if any."""
    columns, cells = [], []
    by_column = zip(*(row.cells for row in table.rows), strict=True)
    for column, own in zip(table.columns, by_column, strict=True):
        numbers = [str(cell).removeprefix("≥ ").removeprefix("≤ ").partition(" ") for cell in own]
        units = {unit for number, _, unit in numbers if unit and re.match(r"−?\d", number)}
        unit = units.pop() if len(units) == 1 else ""
        columns.append(Column(f"{column.title} [{unit}]" if unit else column.title))
        cells.append([str(cell).removesuffix(f" {unit}") if unit else cell for cell in own])
    rows = zip(table.rows, zip(*cells, strict=True), strict=True)
    return replace(
        table,
        columns=tuple(columns),
        rows=tuple(replace(row, cells=of_row) for row, of_row in rows),
    )


def logs_table(identification: Identification) -> Table:
    """Every log: its rows, its length, which rows were not fitted and why, and how it was read."""
    rows = tuple(
        Row(
            fit.log.name,
            (
                f"{fit.used.sum()} of {len(fit.used)}",
                f"{fit.log.times[-1] - fit.log.times[0]:.1f}",
                f"{1.0 / fit.log.period:.1f} Hz",
                ", ".join(f"{count} {reason}" for reason, count in fit.left_out.items()) or "none",
                "; ".join(fit.log.notes),
            ),
        )
        for fit in identification.fits
    )
    columns = (
        *map(Column, ("rows used", "seconds", "rate")),
        Column("rows left out, and why", words=True),
        Column("how it was read", words=True),
    )
    return Table("log", columns, rows, label="Logs")


def candidates_table(comparisons: Mapping[str, Compared]) -> Table:
    """Every joint and every method, with its errors measured on the test motion."""
    rows = []
    for joint, compared in comparisons.items():
        for method in compared.candidates:
            mark = "\nrecommended" if method is compared.recommended else ""
            sizes = (method.error, method.max_error, method.expected, method.largest_step)
            error, *rest = (number(math.degrees(each)) for each in sizes)
            rows.append(Row(WORDS[method.way], (error + mark, *rest), subject=joint))
    columns = tuple(
        Column(title) for title in ("error, rms", "largest", "expected", "largest step")
    )
    return Table("on the test motion [deg]", columns, tuple(rows), apart=True)


def recommendation(joint: str, each: Compared) -> str:
    """The recommendation for a joint, in a line."""
    best, shift = each.recommended, each.named("shift")
    error, other = math.degrees(best.error), math.degrees(shift.error)
    words = f"{joint}: {WORDS[best.way]}, {number(error)} deg rms"
    if best.way == "shift":
        return f"{words}; plan with --method shift"
    if best.way == "direct":
        return f"{words}; send the path as it is"
    method = "; plan with --method closed-form" if best.way == "closed_form" else ""
    return f"{words} (best shift: {number(other)} deg){method}"


def calibration_text(comparisons: Mapping[str, Compared], output: str) -> str:
    """The last screen: the recommendation, the errors of every method, and the next step."""
    lines = [f"recommended, and written to {output}:"]
    lines += [f"  {recommendation(joint, each)}" for joint, each in comparisons.items()]
    step = next_step({joint: each.identification for joint, each in comparisons.items()}, output)
    return "\n".join([*lines, candidates_table(comparisons).text(), step])


def calibration_page(comparisons: Mapping[str, Compared], output: str) -> Page:
    """The same as a page, with every joint's model beside its measurements."""

    def spread(values: Sequence[float], digits: str) -> str:
        return "–".join(dict.fromkeys(f"{end:{digits}}" for end in (min(values), max(values))))

    joints = list(comparisons.items())
    gains = [each.named("shift").error / each.recommended.error for _, each in joints]
    errors = [math.degrees(each.recommended.error) for _, each in joints]
    figures = []
    for k, (joint, each) in enumerate(joints, 1):
        figure = cloud_figure(each.identification, f"joint{k}_")
        figures.append(replace(figure, title=f"{joint}: {figure.title}"))
    step = next_step({joint: each.identification for joint, each in joints}, output)
    return Page(
        "calibration",
        joint=joints[0][0],
        lines=[recommendation(joint, each) for joint, each in joints],
        good=all(each.identification.accepted for _, each in joints),
        errors=spread(errors, ".2f"),
        gains=spread(gains, ".2g"),
        step=re.split("(request-planner [^;]+)", step[:1].upper() + step[1:]),
        table=candidates_table(comparisons),
        pictures=figures,
    )
