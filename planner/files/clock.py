"""Times of the rows of a table: which column holds them, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from decimal import Decimal, localcontext

import numpy as np

from planner.files.logs.units import ANGLE_NAMES, SECONDS, TIME_NAMES, split_name
from planner.files.table import Table
from planner.trajectory import Array

TIME = "t_s"
"""The column of times [s]; it takes precedence over other columns."""

WORDS = frozenset(("t", "time", "times", "timestamp", "stamp", "clock", "seconds"))
"""Words for times in the name of a column."""

EPOCH = 1e6
"""Times beyond this [s], eleven days, count from the epoch and are shifted to start at 0."""

MISSING = ("", "nan", "nat")
"""Placeholder of a missing date."""

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")


def time_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """The columns that may hold times."""
    return tuple(name for name in columns if _is_time(name))


def _is_time(column: str) -> bool:
    stem, unit = split_name(column, TIME_NAMES)
    if unit is None and split_name(column, ANGLE_NAMES)[1] is not None:
        return False  # `t_deg` is a joint
    return bool({word.lower() for word in _WORD.findall(stem)} & WORDS)


def time_column(table: Table, *, advice: str = "") -> str | None:
    """The column of times: ``t_s``, or the only one that may hold them; None where none may.

    Args:
        table: The table.
        advice: How else a user may choose the column, for the message.

    Raises:
        InvalidFile: Several columns may hold times.
    """
    columns = time_columns(table.names)
    if TIME in columns or not columns:
        return TIME if columns else None
    if len(columns) > 1:
        raise table.fault(
            f"{len(columns)} columns may be the time ({', '.join(columns)}); columns: "
            f"{', '.join(table.names)}; {advice}rename it {TIME}"
        )
    return columns[0]


def read_clock(
    table: Table, column: str, unit: str | None = None, *, missing: bool = False, advice: str = ""
) -> tuple[Array, str]:
    """Times [s], shape (n,), and where they come from, in words.

    Args:
        table: The table.
        column: The column that holds them.
        unit: Its unit, one of :data:`.SECONDS`; by default from its name.
        missing: Whether cells may be empty, or NaN: they are NaN then.
        advice: How else a user may give the unit, for the message.

    Raises:
        InvalidFile: The unit is unknown, or a cell is not a number.
    """
    dates = _dates(table, column, missing=missing)
    if dates is not None:
        return dates, f"time from the dates in column '{column}', shifted to start at 0"
    unit = unit or split_name(column, TIME_NAMES)[1] or TIME_NAMES.get(column.lower())
    if unit is None:
        raise table.fault(f"column '{column}' has no unit; {advice}rename it {column}_s")
    seconds = SECONDS[unit]
    numbers = table.numbers([column], missing=missing)[:, 0]
    note = f"time from column '{column}'"
    if not column.endswith(f"_{unit}"):
        note += f" [{unit}]"
    finite = np.flatnonzero(np.isfinite(numbers))
    if not len(finite) or abs(numbers[finite[0]]) * seconds <= EPOCH:
        return numbers * seconds, note
    place = table.place(column)
    with localcontext() as context:
        context.prec = 60
        exact = [Decimal(table.rows[k][place].strip()) for k in finite]
        since = numbers.copy()
        since[finite] = [float(time - exact[0]) for time in exact]
    return since * seconds, f"{note}, shifted to start at 0"


def _dates(table: Table, column: str, *, missing: bool) -> Array | None:
    """Times [s] since the first of a column of dates and times (ISO 8601), shape (n,), else None.

    Raises:
        InvalidFile: The first cell is a date and another is not.
    """
    place = table.place(column)
    cells = [row[place].strip() for row in table.rows]
    first = _date(next((cell for cell in cells if cell.lower() not in MISSING), ""))
    if first is None:
        return None
    times = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if missing and cell.lower() in MISSING:
            continue
        date = _date(cell)
        if date is None or (date.tzinfo is None) != (first.tzinfo is None):
            raise table.fault(
                f"column '{column}': got '{cell[:40]}', expected a date and time as in the rows "
                f"before, such as {first.isoformat()}",
                k,
            )
        times[k] = (date - first).total_seconds()
    return times


def _date(cell: str) -> datetime | None:
    """The date and time that a cell holds; None for numbers and other text."""
    try:
        return datetime.fromisoformat(cell) if "-" in cell and ":" in cell else None
    except ValueError:
        return None
