"""The way from where the joints are to the first request."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.robot.resample import MOST_ROWS
from planner.robot.schedule import as_rows, check_period
from planner.trajectory import Array
from planner.validation import as_number, shown


def ramp(current: npt.ArrayLike, first: npt.ArrayLike, *, speed: float, period: float) -> Array:
    """Evenly spaced requests from the present angles to the first request, both left out.

    The joints set out and arrive together: the one with the longest way turns at most at ``speed``.

    Args:
        current: Where the joints are [rad], shape (k,).
        first: The first request [rad], shape (k,).
        speed: Top speed of the ramp [rad/s].
        period: Time between requests [s].

    Returns:
        Requests [rad], shape (m, k); none where one period suffices.

    Raises:
        InvalidInput: A speed or period that is not positive, a ramp without end, or angles that do
            not fit the requests.
    """
    check_period(period)
    if not as_number(speed) > 0.0:
        raise InvalidInput(f"speed: got {shown(speed)}, expected a positive number of rad/s")
    start = _row(current, name="current")
    goal = _row(first, name="first")
    if start.shape != goal.shape:
        raise InvalidInput(
            f"current: got {len(start)} angles, expected {len(goal)}, one per joint of the requests"
        )
    steps = float(np.max(np.abs(goal - start))) / (speed * period)
    if steps > MOST_ROWS:
        raise InvalidInput(
            f"speed: got {speed:g} rad/s, for a ramp of {steps * period:.3g} s; expected a faster "
            "one"
        )
    shares = np.arange(1, math.ceil(steps))[:, None] / max(math.ceil(steps), 1)
    rows: Array = start + shares * (goal - start)
    return rows


def _row(angles: npt.ArrayLike, *, name: str) -> Array:
    """One angle per joint [rad], shape (k,)."""
    try:
        given = np.asarray(angles)
    except ValueError:  # rows of different lengths
        given = np.empty((0, 0))
    if given.ndim > 1:
        raise InvalidInput(f"{name}: got {shown(angles)}, expected one angle per joint, shape (k,)")
    row: Array = as_rows(np.atleast_2d(given), name=name)[0]
    return row
