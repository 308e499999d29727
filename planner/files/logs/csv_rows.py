"""What a CSV log says of its rows: when they were taken, and whether the torque was on."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np

from planner.exceptions import InvalidFile
from planner.files.clock import TIME
from planner.files.logs.columns import time_columns, torque_columns
from planner.files.logs.options import LogOptions
from planner.files.logs.rows import EPOCH, Switch
from planner.files.logs.units import SECONDS, TIME_NAMES, split_name
from planner.files.table import Table, nearest
from planner.trajectory import Array

SWITCH = {"0": False, "1": True, "0.0": False, "1.0": True, "false": False, "true": True}
"""What a column of the torque may hold."""


def check_column(table: Table, column: str) -> None:
    """Raise InvalidFile unless the table has a column of this name."""
    if column not in table.names:
        raise InvalidFile(
            table.path,
            f"no column '{column}'{nearest(column, table.names)}; "
            f"columns: {', '.join(table.names)}",
            line=1,
        )


def read_clock(table: Table, options: LogOptions) -> tuple[Array, str]:
    """Times [s], shape (n,), and where they come from, in words.

    Raises:
        InvalidFile: No column is clearly the time, its unit is not said, or a cell is no number.
    """
    column, unit = _time_column(table, options)
    seconds = SECONDS[unit]
    numbers = table.numbers([column])[:, 0]
    note = f"time from column '{column}'"
    if not column.endswith(f"_{unit}"):
        note += f" [{unit}]"
    if abs(numbers[0]) * seconds <= EPOCH:
        return numbers * seconds, note
    place = table.names.index(column)
    with localcontext() as context:
        context.prec = 60
        first = Decimal(table.rows[0][place].strip())
        since = [float(Decimal(row[place].strip()) - first) for row in table.rows]
    return np.array(since) * seconds, f"{note}, shifted to start at 0"


def _time_column(table: Table, options: LogOptions) -> tuple[str, str]:
    units = ", ".join(SECONDS)
    name, unit = options.time, None
    if name is not None and name not in table.names:
        stem, _, word = name.rpartition(":")
        if stem in table.names and word in TIME_NAMES:
            name, unit = stem, TIME_NAMES[word]
        elif stem in table.names:
            raise InvalidFile(
                table.path, f"time in '{word}' is unknown; expected one of {units}", line=1
            )
        check_column(table, name)
    if name is None:
        name = _guessed_time(table)
    unit = unit or split_name(name, TIME_NAMES)[1]
    if unit is None:
        raise InvalidFile(
            table.path,
            f"column '{name}' has no unit; give --time {name}:s (or one of {units}), or rename it "
            f"{name}_s",
            line=1,
        )
    return name, unit


def _guessed_time(table: Table) -> str:
    if TIME in table.names:
        return TIME
    found = time_columns(table.names)
    if len(found) != 1:
        what = (
            f"{len(found)} columns may be the time ({', '.join(found)})"
            if found
            else "no column is the time"
        )
        raise InvalidFile(
            table.path,
            f"{what}; columns: {', '.join(table.names)}; name it with --time, or rename it {TIME}",
            line=1,
        )
    return found[0]


def read_torque(table: Table, options: LogOptions) -> tuple[str, Switch | None]:
    """Where the torque's switch comes from, in words, and the switch, shape (n,), if there is one.

    Raises:
        InvalidFile: Several columns may be the switch, or a cell is none.
    """
    if options.torque is not None:
        check_column(table, options.torque)
    found = (options.torque,) if options.torque is not None else torque_columns(table.names)
    if not found:
        return "", None
    if len(found) > 1:
        raise InvalidFile(
            table.path,
            f"{len(found)} columns may say whether the torque is on ({', '.join(found)}); name one "
            "with --torque",
            line=1,
        )
    place = table.names.index(found[0])
    switch = np.empty(len(table.rows), dtype=bool)
    for k, (row, line) in enumerate(zip(table.rows, table.lines, strict=True)):
        cell = row[place].strip().lower()
        if cell not in SWITCH:
            raise InvalidFile(
                table.path,
                f"column '{found[0]}': got '{cell[:20]!s}', expected 0, 1, true or false",
                line=line,
            )
        switch[k] = SWITCH[cell]
    return f", torque from '{found[0]}'", switch
