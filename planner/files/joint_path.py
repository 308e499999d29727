"""Joint paths: one ``<joint>_deg`` or ``<joint>_rad`` column per joint, and perhaps ``t_s``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planner.exceptions import InvalidFile
from planner.files.clock import COUNTERS, TIME, check_period, read_times
from planner.files.table import Table, read_table, write_table
from planner.files.units import ANGLES, pick, with_unit
from planner.trajectory import Array


@dataclass(frozen=True)
class JointPath:
    """Angles or requests of some joints over time.

    Attributes:
        path: Where it came from; ``-`` is standard input.
        names: The joints.
        angles: Their angles [rad], shape (n, k), read-only.
        times: Times of the samples [s], shape (n,); None where the file does not say.
    """

    path: str
    names: tuple[str, ...]
    angles: Array  # (n, k)
    times: Array | None  # (n,)

    def check_period(self, period: float) -> None:
        """Raise InvalidFile if the samples are not ``period`` [s] apart; see :mod:`.clock`."""
        check_period(self.path, self.times, period)


def read_joint_path(path: Path | str, *, joints: Sequence[str] = ()) -> JointPath:
    """Read a joint path from CSV, or from standard input for ``-``.

    Args:
        path: The file.
        joints: Joints to read, in this order; the file's other columns are then left alone. By
            default every column is a joint, but for ``t_s``, ``index`` and ``sample``.

    Raises:
        InvalidFile: The file is no joint path; the message says where and why.
    """
    return joint_path(read_table(path), joints=joints)


def joint_path(table: Table, *, joints: Sequence[str] = ()) -> JointPath:
    """Understand a table as a joint path; see :func:`read_joint_path`."""
    if joints:
        columns = pick(table, joints, ANGLES)
    else:
        columns = [name for name in table.names if name != TIME and name not in COUNTERS]
    if not columns:
        raise InvalidFile(
            table.path,
            f"only {', '.join(table.names)}; expected columns <joint>_deg or <joint>_rad",
            line=1,
        )
    quantities = with_unit(table, columns, ANGLES)
    return JointPath(table.path, quantities.names, quantities.values, read_times(table))


def write_joint_path(
    path: Path | str, names: Sequence[str], angles: Array, *, period: float
) -> None:
    """Write angles or requests as CSV: ``t_s`` and one ``<joint>_deg`` column per joint.

    Args:
        path: The file, or ``-`` for standard output.
        names: The joints.
        angles: Their angles [rad], shape (n, k).
        period: Time between samples [s].
    """
    times = np.arange(len(angles)) * period
    write_table(
        path,
        [TIME, *(f"{name}_deg" for name in names)],
        np.column_stack([times, np.degrees(angles)]),
    )
