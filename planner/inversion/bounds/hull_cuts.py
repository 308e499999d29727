"""What one request can call for: the convex hull of its calls at all ticks where it acts.

In units of v_max a tick, a request y calls for u(t) = clip(k (y - x(t)), -1, 1) where the joint is
at x(t). A cut ``by_call @ u - by_angle @ x <= limit`` holds for every y, and for every x within
ranges, if its limit is the support function of that set, known in closed form (``docs/math.md``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from planner.trajectory import Array

ANYWHERE = (-np.inf, np.inf)
"""Where a request is that may be anywhere."""

TRIALS = 25
"""Points of the set that are tried for one cut."""

DEEP_ENOUGH = 0.7
"""A cut this deep, relative to the distance of the nearest point found, is taken."""

TOO_SHALLOW = 1e-3
"""A cut not even this deep is not worth a row."""

SUM_WEIGHT = 100.0
"""Weight on mixtures' shares summing to one where the nearest mixture is sought."""

ROUNDING = 1e-9
"""Added to a cut's limit: rounding of sums of a few terms of about one."""


class Place(NamedTuple):
    """Where the joint can be when one request acts, and where that request can be.

    Attributes:
        gain: k = v_max / theta_0 [1/tick].
        least: Least angles, shape (m,).
        most: Greatest angles, shape (m,).
        between: Least and greatest request.
    """

    gain: float
    least: Array
    most: Array
    between: tuple[float, float] = ANYWHERE


class Support(NamedTuple):
    """The most that ``by_call @ u - by_angle @ x`` can be, and where it is."""

    value: float
    calls: Array
    angles: Array


class HullCut(NamedTuple):
    """What holds for every request and all angles: ``by_call @ u - by_angle @ x <= limit``."""

    by_call: Array
    by_angle: Array
    limit: float


def calls_of(requests: Array, angles: Array, gain: float) -> Array:
    """What each of the requests calls for at each of the angles, shape (requests, m)."""
    return np.clip(gain * (requests[:, np.newaxis] - angles), -1.0, 1.0)


def corners(angles: Array, place: Place) -> Array:
    """The requests at which some call starts or ceases to saturate, and the ends of the range."""
    reach = 1.0 / place.gain
    every = np.concatenate([angles - reach, angles + reach])
    within: Array = np.minimum(np.maximum(every, place.between[0]), place.between[1])
    return within


def support(by_call: Array, by_angle: Array, place: Place) -> Support:
    """Maximise ``by_call @ u - by_angle @ x`` over all requests and angles of the place.

    For a given request every angle is on its own, and best at an end of its range or where its call
    is just saturated. Between neighbouring corners all these candidates are linear in the request,
    so that the best of them is convex in it, and the maximum is at a corner.
    """
    least, most, gain = place.least, place.most, place.gain
    requests = corners(np.concatenate([least, most]), place)[:, np.newaxis]
    angles = np.empty((4, len(requests), len(least)))
    angles[0], angles[1] = least, most
    angles[2] = np.minimum(np.maximum(requests - 1.0 / gain, least), most)
    angles[3] = np.minimum(np.maximum(requests + 1.0 / gain, least), most)
    calls = np.minimum(np.maximum(gain * (requests - angles), -1.0), 1.0)
    values = by_call * calls - by_angle * angles
    best = int(np.argmax(values.max(axis=0).sum(axis=1)))
    which = values[:, best].argmax(axis=0), best, np.arange(len(least))
    return Support(float(values[which].sum()), calls[which], angles[which])


def separate(calls: Array, angles: Array, place: Place) -> HullCut | None:
    """A cut that the calls violate at these angles, or None where none is worth a row.

    The nearest mixture of points of the set is sought, one point after the other in the direction
    of what is missing; that direction is the cut, and its limit the support there.
    """
    gain, middle = place.gain, (place.least + place.most) / 2.0
    angles = np.clip(angles, place.least, place.most)
    count = len(calls)
    target = np.concatenate([calls, gain * (angles - middle)])
    curve = calls_of(np.unique(corners(angles, place)), angles, gain)
    points = np.hstack([curve, np.broadcast_to(target[count:], curve.shape)])
    best, deepest = None, TOO_SHALLOW
    for _ in range(TRIALS):
        system = np.vstack([points.T, np.full(len(points), SUM_WEIGHT)])
        shares, _ = nnls(system, np.append(target, SUM_WEIGHT))
        missing = target - shares @ points / shares.sum()
        size = float(np.linalg.norm(missing))
        if size < TOO_SHALLOW:
            break
        by_call, by_angle = missing[:count] / size, -gain * missing[count:] / size
        most = support(by_call, by_angle, place)
        depth = float(by_call @ calls - by_angle @ angles) - most.value
        if depth > deepest:
            best, deepest = HullCut(by_call, by_angle, most.value + ROUNDING), depth
        if depth > DEEP_ENOUGH * size:
            break
        reached = np.concatenate([most.calls, gain * (most.angles - middle)])
        points = np.vstack([points[shares > ROUNDING], reached])
    return best


def nearest_request(calls: Array, angles: Array, place: Place) -> tuple[float, float]:
    """The request whose calls at these angles are the nearest, and their distance."""
    ends = corners(angles, place)
    requests = np.linspace(ends.min(), ends.max(), 300)
    distances = np.linalg.norm(calls_of(requests, angles, place.gain) - calls, axis=1)
    nearest = int(np.argmin(distances))
    return float(requests[nearest]), float(distances[nearest])
