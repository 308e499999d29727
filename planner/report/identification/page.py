"""The pages about identified joints and about a calibration: verdict first, sources last."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

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
from planner.report.page import Card, Page, Section, footer, heading, parameters_of
from planner.report.table import NOTHING, Column, Row, Table, number, percent
from planner.robot.candidates import WORDS, Compared

LAGS = ", with lag and acceleration time of any length"
"""What the model has beside the paper's, for the footer."""


def identification_page(identifications: Mapping[str, Identification]) -> Page:
    """The whole page: of a joint, or of several one after the other, below a table of all."""
    if len(identifications) == 1:
        ((name, only),) = identifications.items()
        return Page(
            heading=f"{heading(name or 'a joint')}, {'' if only.accepted else 'not '}identified",
            command="identify",
            about=f"{len(only.fits)} log{'s' * (len(only.fits) > 1)}",
            verdict=_verdict(only),
            note=profile(only),
            good=only.accepted,
            remarks=only.warnings,
            cards=cards(only),
            figure=cloud_figure(only),
            sections=_sections(only, ""),
            footer=footer("identify", LAGS),
        )
    words = of_several(list(identifications.values()))
    details, anchors = list[Section](), dict[str, str]()
    for k, (name, each) in enumerate(identifications.items(), 1):
        prefix = f"joint{k}_"
        anchors[name] = re.sub(r"\W+", "-", f"{prefix}{name or 'joint'}")
        head = Section(
            "",
            "identification.head",
            name=heading(name or "unnamed"),
            anchor=anchors[name],
            warnings=each.warnings,
            verdict=_verdict(each),
            profile=profile(each),
            good=each.accepted,
            cloud=cloud_figure(each, prefix),
            cards=cards(each),
        )
        details += [head, *_sections(each, prefix)]
    overview = Section(
        "",
        "identification.overview",
        anchors=anchors,
        table=_units_above(joints_table(identifications)),
        rare=explained(identifications),
    )
    return Page(
        heading=f"{len(identifications)} joints, identified",
        command="identify",
        verdict=(
            words[0].upper() + words[1:],
            "what is known of each, and what it adds, follows joint by joint",
            ": ",
        ),
        good=all(each.accepted for each in identifications.values()),
        sections=[overview, *details],
        footer=footer("identify", LAGS),
    )


def _sections(identification: Identification, prefix: str) -> list[Section]:
    """A joint's parameters, the improvement by the model, the logs, and the sources."""
    logs = [
        (fit.log.name, _angle(identification, fit.rms),
         log_figure(identification, fit, f"{prefix}log{k}_"))
        for k, fit in enumerate(identification.fits, 1)
    ]  # fmt: skip
    return [
        Section(
            "What is known, and how well",
            "identification.estimates",
            table=parameters_table(identification, page=True),
            share=saturated(identification),
            open=_leaves_top_speed_open(identification),
            intervals=intervals_figure(identification, prefix),
        ),
        Section(
            "What the model adds",
            "identification.adds",
            table=errors_table(identification),
            signal=_angle(identification, identification.signal),
        ),
        Section("Log by log", "identification.logs", logs=logs),
        Section(
            "Where it comes from",
            "identification.origin",
            table=logs_table(identification),
            names=parameters_of([identification.model.parameters()]),
            model=identification.model,
        ),
    ]


def cards(identification: Identification) -> list[Card]:
    """The key figures."""
    error, where = telling_error(identification)
    size, _, unit = _angle(identification, error).partition(" ")
    short = {row.name: row.bounds if row.rough else row.value for row in parameters(identification)}
    share = f"; reached in {percent(saturated(identification), 1)} of the measured intervals"
    reached = "" if _leaves_top_speed_open(identification) else share
    below = f"error that calls for top speed; speed per error below it: {short['gain']}"
    return [
        Card(size, unit,
             f"rms error {where}; noise: {_angle(identification, identification.noise)}"),
        Card(short["v_max"], "", f"top speed{reached}"),
        Card(short["lag"], "", f"lag; acceleration time: {short['acceleration_time']}"),
        Card(short["theta_0"], "", below),
    ]  # fmt: skip


def _verdict(identification: Identification) -> str:
    """The verdict, its details, and the parameters that the logs determine."""
    words = verdict(identification).replace(" %", "\N{NO-BREAK SPACE}%")
    head, tail = words.split(":", 1)
    start = Markup("<strong>{}</strong>:").format(head[0].upper() + head[1:])
    return start + f"{tail}. {determined_words(identification)}"


def _angle(identification: Identification, radians: float | None) -> str:
    """An angle in the unit of the page."""
    units = units_of(identification)
    return NOTHING if radians is None else f"{units.factor * radians:.3g} {units.angle}"


def _leaves_top_speed_open(identification: Identification) -> bool:
    """Whether the joint may be faster than anything in the logs."""
    return math.isinf(identification.intervals["v_max"].upper)


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
    lines = [recommendation(joint, each) for joint, each in joints]
    figures = []
    for k, (joint, each) in enumerate(joints, 1):
        figure = cloud_figure(each.identification, f"joint{k}_")
        figures.append(replace(figure, title=f"{joint}: {figure.title}"))
    step = next_step({joint: each.identification for joint, each in joints}, output)
    parts = re.split("(request-planner [^;]+)", step[:1].upper() + step[1:])
    parts[1::2] = map(Markup("<code>{}</code>").format, parts[1::2])
    return Page(
        heading=heading(joints[0][0] if len(joints) == 1 else f"{len(joints)} joints")
        + ", calibrated",
        command="calibrate",
        verdict=lines[0]
        if len(lines) == 1
        else f"Under the recommended requests the errors are {spread(errors, '.2f')} deg rms, "
        f"{spread(gains, '.2g')} times less than those of the best shift.",
        sections=(
            Section(
                "Recommendation",
                "identification.recommendation",
                lines=lines,
                step=Markup().join(parts),
            ),
            Section(
                "Every way",
                table=candidates_table(comparisons),
                note="The expected error is that of the plan and of its model together; a dash "
                "where none was known.",
            ),
            Section("The joints", pictures=figures),
        ),
        footer="Errors are measured: every way was played on the servos.",
        good=all(each.identification.accepted for _, each in joints),
        cards=(
            Card(spread(gains, ".2g"), "×", "closer than the best shift"),
            Card(str(len(joints)), "", f"joint{'s' * (len(joints) > 1)}"),
        ),
    )
