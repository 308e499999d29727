"""Distances between trajectories: the paper's L2, which is a root mean square, and its Linf."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.trajectory import Array, rms


class Distance(NamedTuple):
    """How far two trajectories are apart, in the unit of the trajectories.

    Attributes:
        rms: Root mean square over the samples: the paper's L2.
        max: Largest over the samples: the paper's Linf.
    """

    rms: float
    max: float

    def in_units_of(self, unit: float) -> Distance:
        """The same distance where ``unit`` counts as 1: ``math.radians(1)`` for degrees."""
        return Distance(self.rms / unit, self.max / unit)


def angle_distance(angles: Array, desired: Array) -> Distance:
    """Distance between two angle trajectories of one joint [rad], both (n,) (paper, Section 5)."""
    apart = angles - desired
    return Distance(rms(apart), float(np.max(np.abs(apart))))


def foot_distance(positions: Array, desired: Array) -> Distance:
    """Distance between two foot paths [m], both (n, 3): of the Euclidean distances at each time."""
    distances = np.linalg.norm(positions - desired, axis=1)
    return Distance(rms(distances), float(np.max(distances)))
