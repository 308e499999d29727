"""What may be asked of `request-planner fit`, in degrees and seconds."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from planner.files.table import Table
    from planner.trajectory import Array

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option(
        "--max-error",
        type=float,
        metavar="DEG",
        help="Use as few lines as stay this close to the path everywhere.",
    ),
    click.option(
        "--max-rms",
        type=float,
        metavar="DEG",
        help="Use as few lines as stay this close to the path in root mean square.",
    ),
    click.option(
        "--knot-s",
        "knot_s",
        type=float,
        multiple=True,
        metavar="S",
        help="Time of a knot; several times for all knots. Only their angles are then sought.",
    ),
    click.option(
        "--required-s",
        "required_s",
        multiple=True,
        metavar="S[=DEG]",
        help="Time at which there must be a knot, and perhaps its angle; several times for more.",
    ),
    click.option(
        "--shortest-s",
        "shortest_s",
        type=float,
        metavar="S",
        help="Duration of the shortest line.  [default: one sample]",
    ),
    click.option("--start-deg", type=float, metavar="DEG", help="Angle at the start of a path."),
    click.option("--end-deg", type=float, metavar="DEG", help="Angle at the end of a path."),
    click.option(
        "--weights",
        metavar="COLUMN|FILE",
        help="How much each sample's squared error counts: a column of DESIRED, or a CSV of one.",
    ),
    click.option("--on-samples", is_flag=True, help="Put knots on samples only."),
    click.option("--exact", is_flag=True, help="Prove that no other knots on samples are better."),
)


def add_fit_options(command: Command) -> Command:
    """Give a command every option of :func:`asked`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def asked(options: dict[str, Any], period: float) -> dict[str, Any]:
    """The options as keywords of :func:`planner.fit_pwl`.

    Args:
        options: What click read.
        period: Time between samples [s].

    Raises:
        click.UsageError: An error or a duration is not above 0, a required knot is unreadable, or a
            cycle is to have ends.
    """
    for name in ("max_error", "max_rms", "shortest_s"):
        value = options[name]
        if value is not None and not 0.0 < value < math.inf:
            unit = "seconds" if name == "shortest_s" else "degrees"
            raise click.UsageError(
                f"--{name.replace('_', '-')}: got {value:g}, expected more than 0 {unit}."
            )
    ends = options["start_deg"], options["end_deg"]
    for name, angle in zip(("--start-deg", "--end-deg"), ends, strict=True):
        if options["cyclic"] and angle is not None:
            raise click.UsageError(f"{name}: a cycle has no ends; add --no-cyclic.")
    given: dict[str, Any] = {
        "cyclic": options["cyclic"],
        "segments": options["segments"],
        "required": dict(_knot(text, period) for text in options["required_s"]),
        "ends": tuple(None if angle is None else math.radians(angle) for angle in ends),
        "on_samples": options["on_samples"],
        "exact": options["exact"],
    }
    for name in ("max_error", "max_rms"):
        if options[name] is not None:
            given[name] = math.radians(options[name])
    if options["shortest_s"] is not None:
        given["shortest"] = _samples(options["shortest_s"], period)
    if options["knot_s"]:
        given["knots"] = [_samples(time, period) for time in options["knot_s"]]
    return given


def weighed(weights: str | None, table: Table) -> tuple[Array | None, Table]:
    """The weights of the samples, and the table without their column.

    Args:
        weights: The option: a column's name, or else a CSV file with one column besides its clock.
        table: What was read from DESIRED.

    Raises:
        InvalidFile: A weight is no number, or the file has no single column.
    """
    from dataclasses import replace

    from planner.exceptions import InvalidFile
    from planner.files.clock import COUNTERS, TIME
    from planner.files.table import read_table

    if weights is None:
        return None, table
    if weights in table.names:
        place = table.names.index(weights)
        rows = tuple((*row[:place], *row[place + 1 :]) for row in table.rows)
        names = (*table.names[:place], *table.names[place + 1 :])
        return table.numbers([weights])[:, 0], replace(table, names=names, rows=rows)
    if not Path(weights).exists():
        raise click.UsageError(
            f"--weights: got '{weights}', expected a column of {table.path} "
            f"({', '.join(table.names)}) or a CSV file."
        )
    own = read_table(weights)
    columns = [name for name in own.names if name != TIME and name not in COUNTERS]
    if len(columns) != 1:
        raise InvalidFile(weights, f"got columns {', '.join(own.names)}, expected one of weights")
    return own.numbers(columns)[:, 0], table


def _samples(time: float, period: float) -> float:
    """Time in samples; whole where the seconds were a multiple of the period but for rounding."""
    count = time / period
    if not math.isfinite(count):
        return count  # which the fit refuses
    return float(round(count)) if abs(count - round(count)) < 1e-6 else count


def _knot(text: str, period: float) -> tuple[float, float | None]:
    """Place and angle of a required knot, from '0.4' or '0.4=12.5'."""
    time, equals, angle = text.partition("=")
    try:
        place = _samples(float(time), period)
        return place, math.radians(float(angle)) if equals else None
    except (ValueError, OverflowError):
        raise click.UsageError(
            f"--required-s: got '{text}', expected seconds (0.4) or seconds=degrees (0.4=12.5)."
        ) from None
