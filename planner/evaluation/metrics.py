"""Distances between trajectories: the paper's L2, which is a root mean square, and its Linf."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidTrajectory
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


def angle_distance(angles: npt.ArrayLike, desired: npt.ArrayLike) -> Distance:
    """Distance between two angle trajectories (paper, Section 5).

    Args:
        angles: Angles of one joint [rad], shape (n,).
        desired: Angles to compare them with [rad], shape (n,).

    Raises:
        InvalidTrajectory: The shapes differ or are not (n,), or a value is not finite.
    """
    return _over_samples(np.abs(_difference(angles, desired, dimensions=1)))


def foot_distance(positions: npt.ArrayLike, desired: npt.ArrayLike) -> Distance:
    """Distance between two foot paths: of the Euclidean distances at each time (paper, Section 5).

    Arguments and errors are those of :func:`foot_distances`.
    """
    return _over_samples(foot_distances(positions, desired))


def foot_distances(positions: npt.ArrayLike, desired: npt.ArrayLike) -> Array:
    """Euclidean distance between two foot paths at each time [m], shape (n,).

    Args:
        positions: Positions of the foot [m], shape (n, 3).
        desired: Positions to compare them with [m], shape (n, 3).

    Raises:
        InvalidTrajectory: The shapes differ or are not (n, 3), or a value is not finite.
    """
    distances: Array = np.linalg.norm(_difference(positions, desired, dimensions=2), axis=1)
    distances.setflags(write=False)
    return distances


def _over_samples(distances: Array) -> Distance:
    return Distance(rms(distances), float(np.max(distances)))


def _difference(one: npt.ArrayLike, other: npt.ArrayLike, *, dimensions: int) -> Array:
    first, second = (np.asarray(given, dtype=np.float64) for given in (one, other))
    expected = "(n,)" if dimensions == 1 else "(n, 3)"
    if (
        first.shape != second.shape
        or first.ndim != dimensions
        or first.size == 0
        or (dimensions == 2 and first.shape[1] != 3)
    ):
        raise InvalidTrajectory(
            f"distance: got shapes {first.shape} and {second.shape}, expected {expected} twice; "
            "compare trajectories with equally many samples"
        )
    difference = first - second
    if not np.isfinite(difference).all():
        raise InvalidTrajectory(
            "distance: a sample is not finite; remove or interpolate it in both trajectories"
        )
    return difference
