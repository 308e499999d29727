"""The path without small reversals, for joints with dry friction.

To turn back, requests jump from one edge of the dead band to the other. Along a path with noise
they would do so at almost every sample, for errors that are small beside the dead band.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.trajectory import Array

LEAST_REVERSAL = 0.2
"""Depth of a reversal up to which a smoothed plan may leave it out [of the dead band]. Over 36
sines, holds and squares of a servo with 2 degrees of dry friction, half of them with noise of 0.06
degrees, half and twice change nothing; without, requests change direction 15 % more often, at holds
75 %."""


def without_small_reversals(angles: Array, least: float, *, cyclic: bool) -> Array:
    """The path made monotone between its deep turning points, by least squares.

    A path of which no reversal is shallower than ``least`` is returned as it is.

    Args:
        angles: The path [rad], shape (n,).
        least: Depth up to which a reversal is left out [rad].
        cyclic: Whether the path repeats for ever.

    Returns:
        The path to follow [rad], shape (n,).
    """
    from scipy.optimize import isotonic_regression  # slow to import

    first = int(np.argmax(angles)) if cyclic else 0
    turned = np.roll(angles, -first)
    if cyclic:
        turned = np.append(turned, turned[0])
    points = turning_points(turned, least)
    if not points:
        return np.roll(_without_turn(turned, cyclic=cyclic)[: len(angles)], first)
    ends = [*(point.sample for point in points), len(turned)]
    # Before the first turning point the path goes towards it, after each away from it.
    pieces = [(0, ends[0], points[0].high)]
    pieces += [(p.sample, end, not p.high) for p, end in zip(points, ends[1:], strict=True)]
    monotone = [
        isotonic_regression(turned[begin:end], increasing=rising).x
        for begin, end, rising in pieces
        if end > begin
    ]
    return np.roll(np.concatenate(monotone)[: len(angles)], first)


class TurningPoint(NamedTuple):
    """Where a path turns: the sample, and whether it is a maximum."""

    sample: int
    high: bool


def turning_points(angles: Array, least: float) -> list[TurningPoint]:
    """Where a path turns by more than ``least``: its extrema between which it goes so far."""
    points: list[TurningPoint] = []
    low = high = direction = 0
    for k, angle in enumerate(angles.tolist()):
        if angle > angles[high]:
            high = k
        if angle < angles[low]:
            low = k
        if direction >= 0 and angles[high] - angle > least:
            points.append(TurningPoint(high, True))
            direction, low = -1, k
        elif direction <= 0 and angle - angles[low] > least:
            points.append(TurningPoint(low, False))
            direction, high = 1, k
    return points


def _without_turn(angles: Array, *, cyclic: bool) -> Array:
    """The nearest path that does not turn: monotone, and for a cycle constant."""
    from scipy.optimize import isotonic_regression  # slow to import

    if cyclic:
        return np.full(len(angles), float(np.mean(angles[:-1])))
    both = [isotonic_regression(angles, increasing=way).x for way in (True, False)]
    nearest: Array = min(both, key=lambda path: float(np.sum((path - angles) ** 2)))
    return nearest
