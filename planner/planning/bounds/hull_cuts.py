"""Cutting planes from the convex hull of the contributions of one request, (9a) of math.md.

In units of v_max a tick, a request y (with the joint's offset) contributes u(t) = f(y - x(t)) to
the speed at tick t, where x(t) is the angle before it: with equal speeds in both directions
clip(gamma (y - x(t)), -1, 1) with gamma = v_max / theta_0. A cut
``nu @ u - xi @ x <= limit`` holds for every y, and for every x within ranges, if its limit is the
support function of that set, which is known in closed form. The cut to add is found as in
disjunctive programming (Balas 1979): the nearest point of the hull is sought by nonnegative least
squares (Lawson and Hanson 1974), and the direction from it to the point to be cut off is the cut's
normal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.trajectory import Array

UNBOUNDED = (-np.inf, np.inf)
"""The interval of an unrestricted request."""

SUM_WEIGHT = 100.0
"""Weight of the equation that the shares of a mixture sum to one [-]; they are normalised after."""

CUT_ROUNDING = 1e-9
"""Added to a cut's limit: rounding of sums of a few terms of about one."""

TRIED_REQUESTS = 300
"""Evenly spaced requests, of which the nearest is the branching value [-]; any value is valid."""


TRIALS = 25
"""Most support points for one cut [-]; half as many lower the bound by 0.2 % in the mean of 13
problems, 3.7 % at worst; twice as many gain nothing."""

VIOLATION = 1e-3
"""Least violation for which a cut is added [v_max a tick]."""


class RequestSet(NamedTuple):
    """Range of one request, and ranges of the angles at the ticks at which it acts.

    Attributes:
        gain: gamma = v_max / theta_0 [1/tick].
        lower: Least angles before these ticks, shape (m,).
        upper: Greatest angles, shape (m,).
        interval: Least and greatest request.
        excess: Excess of the top speed upwards, which is missing downwards.
    """

    gain: float
    lower: Array
    upper: Array
    interval: tuple[float, float] = UNBOUNDED
    excess: float = 0.0

    @property
    def corners(self) -> list[float]:
        """Errors at which the slope of f changes, from the greatest on."""
        return [(self.excess + 1.0) / self.gain, (self.excess - 1.0) / self.gain]

    def contributions(self, errors: Array) -> Array:
        """The contribution f / v of every error [-], like the errors."""
        return np.asarray(np.clip(self.gain * errors, self.excess - 1.0, self.excess + 1.0))


class Support(NamedTuple):
    """The maximum of ``nu @ u - xi @ x`` over a request set, and where it is attained."""

    value: float
    contributions: Array
    angles: Array


class HullCut(NamedTuple):
    """An inequality that every request meets at all angles: ``nu @ u - xi @ x <= limit``."""

    nu: Array
    xi: Array
    limit: float


def breakpoints(angles: Array, requests: RequestSet) -> Array:
    """Requests of the set at which some contribution starts or ceases to saturate; its ends."""
    every = np.concatenate([angles + corner for corner in reversed(requests.corners)])
    within: Array = np.minimum(np.maximum(every, requests.interval[0]), requests.interval[1])
    return within


def support(nu: Array, xi: Array, requests: RequestSet) -> Support:
    """The support function of the set in the direction (nu, -xi): the right-hand side of (9a).

    For a given request every angle is on its own, and best at an end of its range or where the
    slope of its contribution changes. Between neighbouring breakpoints all these candidates are
    linear in the request, so that the best of them is convex in it, and the maximum is at a
    breakpoint.
    """
    lower, upper, corners = requests.lower, requests.upper, requests.corners
    candidates = breakpoints(np.concatenate([lower, upper]), requests)[:, np.newaxis]
    angles = np.empty((2 + len(corners), len(candidates), len(lower)))
    angles[0], angles[1] = lower, upper
    for place, corner in zip(angles[2:], corners, strict=True):
        place[:] = np.minimum(np.maximum(candidates - corner, lower), upper)
    contributions = requests.contributions(candidates - angles)
    values = nu * contributions - xi * angles
    best = int(np.argmax(values.max(axis=0).sum(axis=1)))
    which = values[:, best].argmax(axis=0), best, np.arange(len(lower))
    return Support(float(values[which].sum()), contributions[which], angles[which])


def separate(
    contributions: Array,
    angles: Array,
    requests: RequestSet,
) -> HullCut | None:
    """A cut that the contributions violate at these angles, or None if none is violated enough.

    The nearest mixture of points of the set is sought, one support point after the other in the
    direction of the residual; that direction is the cut's normal, and its limit the support there.
    """
    gain, middle = requests.gain, (requests.lower + requests.upper) / 2.0
    from scipy.optimize import nnls  # slow to import

    angles = np.clip(angles, requests.lower, requests.upper)
    count = len(contributions)
    target = np.concatenate([contributions, gain * (angles - middle)])
    candidates = np.unique(breakpoints(angles, requests))[:, np.newaxis]
    curve = requests.contributions(candidates - angles)
    points = np.hstack([curve, np.broadcast_to(target[count:], curve.shape)])
    best, deepest = None, VIOLATION
    for _ in range(TRIALS):
        system = np.vstack([points.T, np.full(len(points), SUM_WEIGHT)])
        shares, _ = nnls(system, np.append(target, SUM_WEIGHT))
        residual = target - shares @ points / shares.sum()
        size = float(np.linalg.norm(residual))
        if size < VIOLATION:
            break
        nu, xi = residual[:count] / size, -gain * residual[count:] / size
        most = support(nu, xi, requests)
        depth = float(nu @ contributions - xi @ angles) - most.value
        if depth > deepest:
            best, deepest = HullCut(nu, xi, most.value + CUT_ROUNDING), depth
        point = np.concatenate([most.contributions, gain * (most.angles - middle)])
        points = np.vstack([points[shares > CUT_ROUNDING], point])
    return best


def nearest_request(
    contributions: Array, angles: Array, requests: RequestSet, *, margin: float
) -> tuple[float, float]:
    """The request whose contributions at these angles are nearest, and their distance.

    The request is moved so that at least ``margin`` of the interval is on either side of it.
    """
    ends = breakpoints(angles, requests)
    candidates = np.linspace(ends.min(), ends.max(), TRIED_REQUESTS)
    errors = candidates[:, np.newaxis] - angles
    distances = np.linalg.norm(requests.contributions(errors) - contributions, axis=1)
    nearest = int(np.argmin(distances))
    kept = margin * (candidates[-1] - candidates[0])
    request = np.clip(candidates[nearest], candidates[0] + kept, candidates[-1] - kept)
    return float(request), float(distances[nearest])
