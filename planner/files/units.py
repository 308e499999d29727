"""Units in column names: ``knee_deg``, ``x_cm``; SI everywhere behind this door."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from planner.exceptions import InvalidFile
from planner.files.table import Table, nearest
from planner.trajectory import Array

ANGLES: Mapping[str, float] = {"deg": math.pi / 180.0, "rad": 1.0}
"""Angle units and what one of them is in radians."""

LENGTHS: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Length units and what one of them is in metres."""


LARGEST = 1e6
"""An angle or a length beyond this [rad, m] is a mistake: its square would lose all digits."""


class Quantities(NamedTuple):
    """Columns that share a unit.

    Attributes:
        names: What is measured, without the unit.
        columns: The columns' names, with it.
        values: The measured values in SI, shape (n, k), read-only.
    """

    names: tuple[str, ...]
    columns: tuple[str, ...]
    values: Array


def split_unit(column: str, units: Mapping[str, float]) -> tuple[str, str] | None:
    """Name and unit of a column such as ``knee_deg``; None where it ends in none of ``units``."""
    name, _, unit = column.rpartition("_")
    return (name, unit) if name and unit in units else None


def with_unit(table: Table, columns: Sequence[str], units: Mapping[str, float]) -> Quantities:
    """Take the columns apart into names and the one unit that they share, and read them.

    Raises:
        InvalidFile: A column has no unit of these, the units differ, or a value is not finite or
            too large to be true.
    """
    names, found = [], []
    for column in columns:
        parts = split_unit(column, units)
        if parts is None:
            endings = [f"{column.rpartition('_')[0] or column}_{unit}" for unit in units]
            raise InvalidFile(
                table.path,
                f"column '{column}' has no unit; expected {' or '.join(endings)}: "
                "rename it, or remove it",
                line=1,
            )
        names.append(parts[0])
        found.append(parts[1])
    if len(set(found)) > 1:
        mixed = ", ".join(columns)
        raise InvalidFile(
            table.path, f"mixed units ({mixed}); expected one unit in all columns", line=1
        )
    values = table.numbers(columns) * units[found[0]]
    _check_size(table, columns, values, LARGEST / units[found[0]])
    values.setflags(write=False)
    return Quantities(tuple(names), tuple(columns), values)


def pick(table: Table, wanted: Sequence[str], units: Mapping[str, float]) -> list[str]:
    """Columns of the named quantities, in the order of ``wanted``.

    Raises:
        InvalidFile: One of them is missing, or there in two units.
    """
    known: dict[str, list[str]] = {}
    for column in table.names:
        parts = split_unit(column, units)
        if parts is not None:
            known.setdefault(parts[0], []).append(column)
    columns = []
    for name in wanted:
        if name not in known:
            endings = " or ".join(f"{name}_{unit}" for unit in units)
            raise InvalidFile(
                table.path,
                f"no column {endings}{nearest(name, tuple(known))}; "
                f"columns: {', '.join(table.names)}",
                line=1,
            )
        if len(known[name]) > 1:
            raise InvalidFile(
                table.path,
                f"'{name}' comes in mixed units ({', '.join(known[name])}), expected one column; "
                "remove the others",
                line=1,
            )
        columns.extend(known[name])
    return columns


def _check_size(table: Table, columns: Sequence[str], values: Array, largest: float) -> None:
    beyond = np.argwhere(~(np.abs(values) <= LARGEST))
    if beyond.size:
        k, j = beyond[0]
        cell = table.rows[k][table.names.index(columns[j])].strip()
        raise InvalidFile(
            table.path,
            f"column '{columns[j]}': got {cell}, expected at most {largest:g} either way; "
            "check the unit",
            line=table.lines[k],
        )
