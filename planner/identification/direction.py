"""Whether a joint moves with its requests, or against them: the sign of a column may be wrong."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.identification.grid import Grid
from planner.identification.starts import delayed_errors
from planner.trajectory import Array

AS_GOOD = 1.05
"""Both signs explain the angles if what they leave unexplained is within this factor."""

LEAST_LIKENESS = 0.7
"""Correlation below which a delay explains nothing."""

DELAYS = 200
"""Delays that are compared, and more around the best."""


class Opposite(NamedTuple):
    """What speaks for the opposite sign: the angles are as much like requests of that sign, sooner.

    Attributes:
        delay: How long after requests of the opposite sign the angles come [s].
        likeness: Their correlation then, 0 to 1.
        same_delay: The same by the requests as they are [s].
        same_likeness: And the correlation with these.
    """

    delay: float
    likeness: float
    same_delay: float
    same_likeness: float

    @property
    def repeats(self) -> bool:
        """Whether the motion repeats itself, so that only the delay tells the signs apart."""
        return _unlike(self.same_likeness) <= AS_GOOD * _unlike(self.likeness)

    @property
    def words(self) -> str:
        """Why the sign of a column may be wrong."""
        otherwise = ", or record motion that does not repeat itself" if self.repeats else ""
        return (
            f"the joint seems to move against its requests: its angles correlate by "
            f"{self.likeness:.2f} with requests of the opposite sign {1e3 * self.delay:.0f} ms "
            f"before, and by {self.same_likeness:.2f} with the requests themselves "
            f"{1e3 * self.same_delay:.0f} ms before; invert the sign of one column{otherwise}"
        )


def opposite(grid: Grid) -> Opposite | None:
    """What speaks for a joint that moves against its requests; None where nothing does.

    Half a cycle of motion that repeats itself looks like the other sign. There the shorter delay
    is taken for the true one: what a joint is late by is less than half a cycle.
    """
    delays = np.linspace(0.0, grid.reach, DELAYS)
    coarse = _likeness(grid, delays)
    best = []
    for sign in (1.0, -1.0):
        near = delays[np.argmax(sign * coarse)] + delays[1] * np.linspace(-1.0, 1.0, 17)
        near = np.maximum(near, 0.0)
        fine = sign * _likeness(grid, near)
        best.append((float(near[np.argmax(fine)]), float(np.max(fine))))
    (same_delay, same), (delay, other) = best
    as_good = _unlike(other) <= AS_GOOD * _unlike(same)
    if other < LEAST_LIKENESS or not as_good or delay >= same_delay:
        return None
    return Opposite(delay, other, same_delay, same)


def _unlike(likeness: float) -> float:
    """Share of the motion that a correlation leaves unexplained, as a standard deviation."""
    return float(np.sqrt(max(1.0 - likeness * abs(likeness), 0.0)))


def _likeness(grid: Grid, delays: Array) -> Array:
    """Correlation of the angles with the requests of some time before, by that time [s]."""
    angles = grid.angles - np.mean(grid.angles)
    found = np.zeros(len(delays))
    for k, delay in enumerate(delays):
        requests = delayed_errors(grid, float(delay)) + grid.angles
        requests -= np.mean(requests)
        size = float(np.linalg.norm(requests) * np.linalg.norm(angles))
        found[k] = float(requests @ angles) / size if size > 0.0 else 0.0
    return found
