"""Requests with the time at which each is due, one after another."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import NamedTuple

import numpy.typing as npt

from planner.robot.schedule import as_rows, check_cycles, check_period
from planner.trajectory import Array


class TimedRequest(NamedTuple):
    """One row of requests.

    Attributes:
        time: When it is due, from the first one on [s].
        requests: What to send to every joint [rad], shape (k,), read-only.
    """

    time: float
    requests: Array


def timed_requests(
    requests: npt.ArrayLike, *, period: float, cycles: int | None = None
) -> Iterator[TimedRequest]:
    """Each row of requests with its time, which is its number times the period and never drifts.

    Args:
        requests: What to send to the joints [rad], shape (n, k), or (n,) for one joint.
        period: Time between requests [s].
        cycles: How often to go through them; for ever by default.

    Returns:
        An iterator of times and rows; the input is checked at once, before the first is taken.

    Raises:
        InvalidInput: A period or a number of cycles that is not positive.
        InvalidTrajectory: Requests that are not a finite array of one of these shapes.
    """
    rows = as_rows(requests, name="requests")
    check_period(period)
    if cycles is not None:
        check_cycles(cycles)
    numbers = count() if cycles is None else range(cycles * len(rows))
    return (TimedRequest(k * period, rows[k % len(rows)]) for k in numbers)
