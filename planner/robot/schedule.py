"""Requests of some joints at even times, repeated, or at the rate of another controller."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from planner.arrays import Array
from planner.exceptions import InvalidInput

NANOSECONDS = 10**9  # nanoseconds in a second, the resolution of ROS times
MOST_ROWS = 1_000_000  # longest schedule [rows]: more than two hours at a request every 8 ms
ON_TIME = 1e-6
"""A row this part of a period before a request already sends it; clocks are written rounded."""


class Schedule(NamedTuple):
    """Requests, one row every period, each held until the next."""

    names: tuple[str, ...]  # the joints
    requests: Array  # requests for them [rad], shape (n, k)
    period: float  # time between rows [s]

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


Between = Literal["hold", "linear"]
"""Between two requests: hold the last one, or follow a straight line."""


def repeated(schedule: Schedule, cycles: int) -> Schedule:
    """The schedule, ``cycles`` times in a row; InvalidInput beyond :data:`MOST_ROWS` rows."""
    many = f"{cycles}" if cycles < 10**18 else "so many"
    _check_length(len(schedule.requests) * cycles, f"{many} cycles", "fewer cycles")
    return schedule._replace(requests=np.tile(schedule.requests, (cycles, 1)))


def resampled(
    schedule: Schedule, rate: float, *, between: Between = "hold"
) -> tuple[Schedule, int]:
    """The schedule as a controller with another rate sends it, and how many requests it leaves out.

    Rows are at 0, 1/rate, 2/rate ... as long as the schedule lasts, the rate in Hz. By default each
    repeats the last request; at a rate at which some requests would never be sent the joint would
    not move as planned, so that is refused. "linear" follows the straight line from each request to
    the next instead, at any rate, which is as if every request came half a period early.
    """
    if not 0.0 < rate < math.inf:
        raise InvalidInput(f"rate: got {rate:g} Hz, expected a positive number")
    if between not in get_args(Between):
        raise InvalidInput(f"between: got {between!r}, expected 'hold' or 'linear'")
    _check_length(
        schedule.duration * rate, f"{schedule.duration:g} s at {rate:g} Hz", "a lower rate"
    )
    count = len(schedule.requests)
    # where the rows fall among the requests, in periods from the first one
    places = np.arange(max(math.ceil(schedule.duration * rate - ON_TIME), 1)) / (
        rate * schedule.period
    )
    held = np.minimum(np.floor(places + ON_TIME).astype(np.intp), count - 1)
    skipped = count - len(np.unique(held))
    rows = schedule.requests[held]
    if between == "linear":
        index = np.arange(count)
        rows = np.column_stack([np.interp(places, index, column) for column in schedule.requests.T])
    elif skipped:
        raise InvalidInput(
            f"rate: at {rate:g} Hz {skipped} of {count} requests would never "
            f"be sent, as they are {schedule.period:g} s apart, and the joints would not move "
            f"as planned; plan at this rate (plan --rate-hz {rate:g}), or send what is on the "
            "straight lines between requests (--between linear)"
        )
    return Schedule(schedule.names, rows, 1.0 / rate), skipped


def _check_length(rows: float, length: str, advice: str) -> None:
    if rows > MOST_ROWS:
        many = f"{rows:.0f}" if rows < 1e18 else "too many"
        raise InvalidInput(
            f"{length} make {many} rows, expected at most {MOST_ROWS}; ask for {advice}"
        )
