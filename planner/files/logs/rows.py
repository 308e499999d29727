"""From columns of numbers to a log, with what every format has to check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidFile, InvalidInput
from planner.files.logs.units import Scale
from planner.files.units import LARGEST
from planner.identification.log import FEWEST_ROWS, Log
from planner.trajectory import Array

Switch = npt.NDArray[np.bool_]
"""Whether the torque was on, shape (n,)."""

EPOCH = 1e6
"""Times beyond this [s], eleven days, count from the epoch and are shifted to start at 0."""

SLOWEST, FASTEST = 2.0, 2e-5
"""A log with rows further apart than this [s], or closer, has probably another unit of time."""

MOST_RAD, LEAST_DEG = 50.0, 4.0
"""Angles beyond this [rad] may be degrees; a span below this [degrees] may be radians."""

MOST_SHARE = 2.0
"""A share of the range beyond this either way is none."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where rows come from, for messages.

    Attributes:
        path: The file.
        part: What of it, such as "episode 3"; "" for all.
        line: Line of the file on which a row stands, counted from 1; None where it has no lines.
        row: What a row is called.
    """

    path: Path | str
    part: str = ""
    line: Callable[[int], int] | None = None
    row: str = "row"

    @property
    def name(self) -> str:
        """The source in words."""
        return f"{self.path}, {self.part}" if self.part else f"{self.path}"

    def fault(self, problem: str, k: int) -> InvalidFile:
        """The error that row ``k``, counted from 0, has a problem."""
        if self.line is not None:
            return InvalidFile(self.path, problem, line=self.line(k))
        place = f"{self.part}, {self.row} {k + 1}" if self.part else f"{self.row} {k + 1}"
        return InvalidFile(self.path, f"{place}: {problem}")


@dataclass(frozen=True, kw_only=True)
class Columns:
    """What a log holds, as it was written.

    Attributes:
        times: Times of the rows [s], shape (n,).
        requests: Requested angles, shape (n,), in the unit of ``request_scale``.
        angles: Actual angles, shape (n,), in the unit of ``angle_scale``.
        request_scale: What a request's number means.
        angle_scale: What an angle's number means.
        torque_on: Whether the torque was on, shape (n,); None where the log does not say.
    """

    times: Array  # (n,) [s]
    requests: Array  # (n,)
    angles: Array  # (n,)
    request_scale: Scale
    angle_scale: Scale
    torque_on: Switch | None = None


def make_log(source: Source, columns: Columns, *, joint: str, notes: tuple[str, ...] = ()) -> Log:
    """Check the columns and make a log of them.

    Raises:
        InvalidFile: A value is missing or cannot be true, times do not increase, or there are too
            few rows; the message says where.
    """
    if columns.request_scale.unit != columns.angle_scale.unit:
        raise InvalidFile(
            source.name,
            f"requests in {columns.request_scale.name} but angles in {columns.angle_scale.name}; "
            "expected angles for both, or shares of the range for both",
        )
    _check_times(source, columns.times)
    requests = _checked(source, "requested angle", columns.requests, columns.request_scale)
    angles = _checked(source, "actual angle", columns.angles, columns.angle_scale)
    switch = columns.torque_on
    try:
        return Log(
            times=columns.times,
            requests=requests,
            angles=angles,
            torque_on=np.ones(len(requests), bool) if switch is None else switch,
            name=source.name,
            joint=joint,
            unit=columns.angle_scale.unit,
            notes=(*notes, *_doubts(columns)),
        )
    except InvalidInput as error:
        raise InvalidFile(source.path, str(error)) from error


def _check_times(source: Source, times: Array) -> None:
    if len(times) < FEWEST_ROWS:
        raise InvalidFile(
            source.name, f"rows of samples: got {len(times)}, expected at least {FEWEST_ROWS}"
        )
    if not np.isfinite(times).all():
        k = int(np.argmin(np.isfinite(times)))
        raise source.fault(f"time: got {times[k]}, expected a finite number; remove the row", k)
    steps = np.diff(times)
    if (steps <= 0.0).any():
        k = int(np.argmax(steps <= 0.0)) + 1
        raise source.fault(
            f"time is {times[k]:.9g} s after {times[k - 1]:.9g} s, expected times that increase; "
            "sort the rows and remove doubles",
            k,
        )


def _checked(source: Source, what: str, numbers: Array, scale: Scale) -> Array:
    if not np.isfinite(numbers).all():
        k = int(np.argmin(np.isfinite(numbers)))
        raise source.fault(
            f"{what}: got {numbers[k]}, expected a finite number; remove or interpolate the sample",
            k,
        )
    values: Array = scale.factor * numbers + scale.shift
    largest = MOST_SHARE if scale.unit == "1" else LARGEST
    beyond = np.abs(values) > largest
    if beyond.any():
        k = int(np.argmax(beyond))
        expected = "a share of the range" if scale.unit == "1" else "an angle"
        raise source.fault(
            f"{what}: got {numbers[k]:g}, expected {expected} in {scale.name}; check the unit", k
        )
    return values


def _doubts(columns: Columns) -> tuple[str, ...]:
    """What looks like a wrong unit, in words."""
    doubts = []
    step = float(np.median(np.diff(columns.times)))
    if not FASTEST <= step <= SLOWEST:
        doubts.append(f"one row every {step:.3g} s: is the unit of time right?")
    for what, numbers, scale in (
        ("requested", columns.requests, columns.request_scale),
        ("actual", columns.angles, columns.angle_scale),
    ):
        if scale.name == "rad" and float(np.abs(numbers).max()) > MOST_RAD:
            doubts.append(
                f"{what} angles reach {float(np.abs(numbers).max()):.3g} rad: are they degrees?"
            )
        elif scale.name == "deg" and 0.0 < float(np.ptp(numbers)) < LEAST_DEG:
            doubts.append(
                f"{what} angles span only {float(np.ptp(numbers)):.2g} degrees: are they radians?"
            )
    return tuple(doubts)
