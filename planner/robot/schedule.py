"""Requests of some joints at even times, for exporters and players."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.trajectory import Array, as_rows
from planner.validation import as_positive, as_whole, shown

NANOSECONDS = 10**9
"""Nanoseconds in a second, the resolution of ROS times."""


@dataclass(frozen=True, eq=False)
class Schedule:
    """Requests, one row every period, each held until the next.

    Attributes:
        names: The joints.
        requests: Requests for them [rad], shape (n, k), read-only.
        period: Time between rows [s].

    Raises:
        InvalidInput: A period that is no positive time, or names that do not fit.
        InvalidTrajectory: Requests that are not a finite array of shape (n, k).
    """

    names: tuple[str, ...]
    requests: Array
    period: float

    def __post_init__(self) -> None:
        check_period(self.period)
        rows = as_rows(self.requests, name="requests")
        object.__setattr__(self, "requests", rows)
        if len(self.names) != rows.shape[1] or len(set(self.names)) != len(self.names):
            raise InvalidInput(
                f"joint names: got {', '.join(self.names) or 'none'}, expected {rows.shape[1]} "
                "different names, one per column of the requests"
            )

    @property
    def times(self) -> Array:
        """When each row is due [s], shape (n,); the first at 0."""
        return np.asarray(np.arange(len(self.requests)) * self.period, dtype=np.float64)

    @property
    def nanoseconds(self) -> npt.NDArray[np.int64]:
        """When each row is due [ns], rounded, shape (n,)."""
        return np.rint(self.times * NANOSECONDS).astype(np.int64)

    @property
    def duration(self) -> float:
        """Until the last row has been held for its period [s]."""
        return len(self.requests) * self.period

    def renamed(self, names: Sequence[str]) -> Schedule:
        """The same requests for joints that go by other names, in the same order."""
        return Schedule(tuple(names), self.requests, self.period)


def check_period(period: float) -> None:
    """Make sure that a time between requests [s] is one.

    Raises:
        InvalidInput: It is not positive and finite.
    """
    as_positive("period", period, "a positive number of seconds")


def check_cycles(cycles: int) -> None:
    """Make sure that a number of repetitions is one.

    Raises:
        InvalidInput: It is not a positive whole number.
    """
    if (as_whole(cycles) or 0) < 1:
        raise InvalidInput(f"cycles: got {shown(cycles)}, expected a whole number from 1 up")
