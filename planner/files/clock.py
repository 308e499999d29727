"""The optional time column of a path: increasing, even, and in step with the joint."""

from __future__ import annotations

import numpy as np

from planner.exceptions import InvalidFile
from planner.files.table import Table
from planner.trajectory import Array

TIME = "t_s"
"""The column that holds the time [s]."""

COUNTERS = ("index", "sample")
"""Columns that only number the rows, and are not read."""

UNEVEN = 0.01
"""A time step may differ from the period by this part of it, for clocks written in few decimals."""


def read_times(table: Table) -> Array | None:
    """Times of the samples [s], shape (n,); None where the file has no column ``t_s``.

    Raises:
        InvalidFile: Times that do not increase, or are unevenly spaced.
    """
    if TIME not in table.names:
        return None
    times = table.numbers([TIME])[:, 0]
    steps = np.diff(times)
    if (steps <= 0.0).any():
        k = int(np.argmax(steps <= 0.0)) + 1
        raise InvalidFile(
            table.path,
            f"{TIME} is {times[k]:g} after {times[k - 1]:g}, expected times that increase; "
            "sort the rows and remove doubles",
            line=table.lines[k],
        )
    period = float(np.median(steps))
    uneven = np.abs(steps - period) > UNEVEN * period
    if uneven.any():
        k = int(np.argmax(uneven)) + 1
        raise InvalidFile(
            table.path,
            f"{TIME} advances by {steps[k - 1]:g} s where most steps are {period:g} s, expected "
            "even steps; resample the path at one rate",
            line=table.lines[k],
        )
    return times


def check_period(path: str, times: Array | None, period: float) -> None:
    """Make sure that a path's samples are as far apart as the joint's requests.

    Args:
        path: The file, for the error.
        times: Times of its samples [s], or None where it does not say.
        period: Time between requests [s].

    Raises:
        InvalidFile: The path has another rate than the joint.
    """
    if times is None:
        return
    step = float(times[-1] - times[0]) / (len(times) - 1)
    if abs(step - period) > UNEVEN * period:
        raise InvalidFile(
            path,
            f"one sample every {step:.6g} s, expected one every {period:.6g} s, the time between "
            f"requests; resample the path, drop column {TIME}, or set tick and hold in the model",
        )
