"""Foot paths: columns ``x_m, y_m, z_m`` (or ``_cm``, ``_mm``), and perhaps ``t_s``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planner.files.clock import TIME, check_period, read_times
from planner.files.table import Table, read_table, write_table
from planner.files.units import LENGTHS, pick, split_unit, with_unit
from planner.trajectory import Array

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class FootPath:
    """Positions of a foot over time.

    Attributes:
        path: Where it came from; ``-`` is standard input.
        positions: Positions in the leg's base frame [m], shape (n, 3), read-only.
        times: Times of the samples [s], shape (n,); None where the file does not say.
    """

    path: str
    positions: Array  # (n, 3)
    times: Array | None  # (n,)

    def check_period(self, period: float) -> None:
        """Raise InvalidFile if the samples are not ``period`` [s] apart; see :mod:`.clock`."""
        check_period(self.path, self.times, period)


def is_foot_path(table: Table) -> bool:
    """Whether a table names a position along an axis, and so is meant as a foot path."""
    parts = [split_unit(name, LENGTHS) for name in table.names]
    return any(part is not None and part[0] in AXES for part in parts)


def read_foot_path(path: Path | str) -> FootPath:
    """Read a foot path from CSV, or from standard input for ``-``.

    Raises:
        InvalidFile: The file is no foot path; the message says where and why.
    """
    return foot_path(read_table(path))


def foot_path(table: Table) -> FootPath:
    """Understand a table as a foot path; see :func:`read_foot_path`."""
    quantities = with_unit(table, pick(table, AXES, LENGTHS), LENGTHS)
    return FootPath(table.path, quantities.values, read_times(table))


def write_foot_path(path: Path | str, positions: Array, *, period: float | None = None) -> None:
    """Write positions [m], shape (n, 3), as CSV; ``-`` is standard output.

    Args:
        path: The file.
        positions: The positions [m], shape (n, 3).
        period: Time between samples [s], for a column ``t_s``; without it there is none.
    """
    names = [f"{axis}_m" for axis in AXES]
    if period is None:
        write_table(path, names, positions)
    else:
        times = np.arange(len(positions)) * period
        write_table(path, [TIME, *names], np.column_stack([times, positions]))
