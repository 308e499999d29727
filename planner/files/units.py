"""Units in column names: ``knee_deg``, ``x_cm``; SI inside the package."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from planner.exceptions import InvalidFile, nearest
from planner.files.table import Table
from planner.trajectory import Array, not_radians, turns_words

ANGLES: Mapping[str, float] = {"deg": math.pi / 180.0, "rad": 1.0}
"""Angle units, in radians."""

SHARES: Mapping[str, float] = {"percent": math.pi / 180.0, "range": 100.0 * math.pi / 180.0}
"""Shares of a joint's range: a percent is carried as if it were a degree, and so printed as one."""

LENGTHS: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Length units, in metres."""


OTHER_UNITS = frozenset(
    (
        *("degree", "degrees", "radian", "radians", "turn", "turns", "tick", "ticks"),
        *("meter", "meters", "metre", "metres", "inch", "km"),
    )
)
"""Endings of names that are units too, but unsupported ones."""

LARGEST = 1e6
"""An angle or a length beyond this [rad, m] is a mistake: its square would lose all digits."""

LEAST_DEG = 4.0
"""A span below this [degrees] may be radians."""


def split_unit(column: str, units: Mapping[str, float]) -> tuple[str, str] | None:
    """Name and unit of a column such as ``knee_deg``; None where it ends in none of ``units``."""
    name, _, unit = column.rpartition("_")
    return (name, unit) if name and unit in units else None


def with_unit(
    table: Table, columns: Sequence[str], units: Mapping[str, float]
) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Names and units of the columns, and their values in SI, shape (n, k), read-only.

    All have the same unit, but for shares of a joint's range, which stand beside angles.

    Raises:
        InvalidFile: A column has no unit of these, the units differ, or a value is not finite or
            too large to be true.
    """
    names, endings = [], []
    for column in columns:
        parts = split_unit(column, units)
        if parts is None:
            bare = [each for each in columns if split_unit(each, units) is None]
            raise _without_unit(table, bare, units)
        names.append(parts[0])
        endings.append(parts[1])
    if len(set(endings) - set(SHARES)) > 1 or len(set(endings) & set(SHARES)) > 1:
        mixed = ", ".join(columns)
        raise table.fault(f"mixed units ({mixed}); expected one unit in all columns")
    factors = np.array([units[unit] for unit in endings])
    values = table.numbers(columns) * factors
    _check_size(table, columns, values, LARGEST / factors)
    values.setflags(write=False)
    return tuple(names), tuple(endings), values


def pick(table: Table, names: Sequence[str], units: Mapping[str, float]) -> list[str]:
    """Columns of the named quantities, in the order of ``names``.

    Raises:
        InvalidFile: One of them is missing, or there in two units.
    """
    by_name: dict[str, list[str]] = {}
    for column in table.names:
        parts = split_unit(column, units)
        if parts is not None:
            by_name.setdefault(parts[0], []).append(column)
    columns = []
    for name in names:
        if names.count(name) > 1:
            raise InvalidFile(
                table.path, f"'{name}' is named {names.count(name)} times; name it once"
            )
        if name not in by_name:
            endings = " or ".join(f"{name}_{unit}" for unit in units if unit not in SHARES)
            raise table.fault(
                f"no column {endings}{nearest(name, tuple(by_name))}; "
                f"columns: {', '.join(table.names)}"
            )
        if len(by_name[name]) > 1:
            raise table.fault(
                f"'{name}' comes in mixed units ({', '.join(by_name[name])}), expected one column; "
                "remove the others"
            )
        columns.extend(by_name[name])
    return columns


def check_radians(table: Table, column: str, angles: Array, advice: str) -> None:
    """Refuse radians, some of which may be missing (NaN), that look like degrees."""
    finite = np.flatnonzero(np.isfinite(angles))
    if len(finite) and not_radians(angles[finite]):
        k = int(finite[np.argmax(np.abs(angles[finite]))])
        words = f"column '{column}': {turns_words(angles[k])}; if these are degrees, {advice}"
        raise table.fault(words, k)


def _without_unit(table: Table, columns: Sequence[str], units: Mapping[str, float]) -> InvalidFile:
    """The error that columns have no unit of these."""
    name = columns[0]
    stem, _, word = name.rpartition("_")
    if stem and word.lower() in OTHER_UNITS:
        name = stem
    expected = " or ".join(f"{name}_{unit}" for unit in units if unit not in SHARES)
    if len(columns) == 1:
        what, advice = f"column '{columns[0]}' has no unit", "rename it, or remove it"
    else:
        what = f"columns {', '.join(map(repr, columns))} have no unit"
        expected, advice = f"an ending of the unit, such as {expected}", "rename or remove them"
    return table.fault(f"{what}; expected {expected}: {advice}")


def _check_size(table: Table, columns: Sequence[str], values: Array, largest: Array) -> None:
    beyond = np.argwhere(~(np.abs(values) <= LARGEST))
    if beyond.size:
        k, j = beyond[0]
        cell = table.rows[k][table.names.index(columns[j])].strip()
        raise table.fault(
            f"column '{columns[j]}': got {cell}, expected at most {largest[j]:g} either way; "
            "check the unit",
            k,
        )
