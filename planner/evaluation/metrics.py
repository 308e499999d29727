"""Distances between trajectories: the paper's L2, which is a root mean square, and its Linf."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidTrajectory
from planner.trajectory import Array, rms, steps


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


class RequestMotion(NamedTuple):
    """How a joint's requests move, beside the desired angles.

    Attributes:
        largest_step: Largest change from one request to the next [rad].
        reversals_per_s: How often the requests change direction [1/s].
        path_length: Sum of the changes of the requests [rad].
        desired_length: Sum of the changes of the desired angles [rad].
        beyond: How far the requests go beyond the range of the desired angles [rad].
    """

    largest_step: float
    reversals_per_s: float
    path_length: float
    desired_length: float
    beyond: float


LEAST_MOTION = 1e-9
"""Change of a request that is no motion [rad]: rounding."""


def request_motion(
    requests: npt.ArrayLike, desired: npt.ArrayLike, *, period: float, cyclic: bool
) -> RequestMotion:
    """How one joint's requests move: steps, reversals, length and range.

    A cycle counts the change from the last request to the first. Requests that stay where they are
    do not change direction.

    Args:
        requests: Requests [rad], shape (n,).
        desired: Desired angles [rad], shape (n,).
        period: Time from one request to the next [s].
        cyclic: Whether they repeat for ever.

    Raises:
        InvalidTrajectory: The shapes differ or are not (n,), or a value is not finite.

    Example:
        >>> there_and_back = request_motion([0.0, 0.3, 0.1], [0, 0.2, 0], period=0.1, cyclic=True)
        >>> f"{there_and_back.largest_step:.1f} rad, {there_and_back.reversals_per_s:.2f} per s"
        '0.3 rad, 6.67 per s'
    """
    _difference(requests, desired, dimensions=1)
    sent, path = (np.asarray(given, dtype=np.float64) for given in (requests, desired))
    changes, others = (steps(each, cyclic=cyclic) for each in (sent, path))
    directions = np.sign(changes[np.abs(changes) > LEAST_MOTION])
    if cyclic:
        directions = np.append(directions, directions[:1])
    beyond = max(path.min() - sent.min(), sent.max() - path.max(), 0.0)
    return RequestMotion(
        largest_step=float(np.max(np.abs(changes), initial=0.0)),
        reversals_per_s=np.count_nonzero(np.diff(directions)) / (len(sent) * period),
        path_length=float(np.sum(np.abs(changes))),
        desired_length=float(np.sum(np.abs(others))),
        beyond=float(beyond),
    )


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
