"""Cutting planes from the convex hull of what one request can contribute, (9a) of math.md.

In units of v_max a tick, a request y (with the joint's offset) contributes
u(t) = clip(gamma (y - x(t)), -1, 1) to the speed at tick t, where x(t) is the angle before it and
gamma = v_max / theta_0. A cut ``nu @ u - xi @ x <= limit`` holds for every y, and for every x
within ranges, if its limit is the support function of that set, which is known in closed form.
Which cut to add is found as in disjunctive programming (Balas 1979): the nearest point of the hull
is sought by nonnegative least squares (Lawson and Hanson 1974), and the direction from there to the
point that is to be cut off is the cut's normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from planner.trajectory import Array

UNBOUNDED = (-np.inf, np.inf)
"""The interval of a request that may be anything."""

SUM_WEIGHT = 100.0
"""Weight of the equation that the shares of a mixture sum to one [-]; they are normalised after."""

CUT_ROUNDING = 1e-9
"""Added to a cut's limit: rounding of sums of a few terms of about one."""


TRIED_REQUESTS = 300
"""Requests, evenly spaced, of which the nearest is where a node branches [-]; any is valid."""


@dataclass(frozen=True)
class CutOptions:
    """When a cut is looked for no longer, and when it is added.

    Attributes:
        trials: Most support points tried for one cut [-]; half as many leave 0.2 % of the bound
            unproved in the mean of 13 problems (3.7 % at worst), twice as many gain nothing.
        violation: Least violation for which a cut is added [v_max a tick]; a tenth and five times
            as much prove the same to 0.3 %.
    """

    trials: int = 25
    violation: float = 1e-3


class RequestSet(NamedTuple):
    """Where the joint can be at the ticks at which one request acts, and what it can be.

    Attributes:
        gain: gamma = v_max / theta_0 [1/tick].
        lower: Least angles before these ticks, shape (m,).
        upper: Greatest angles, shape (m,).
        interval: Least and greatest request.
    """

    gain: float
    lower: Array
    upper: Array
    interval: tuple[float, float] = UNBOUNDED


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


def contributions_of(requests: Array, angles: Array, gain: float) -> Array:
    """The u = clip(gamma (y - x), -1, 1) of each request at each angle, shape (requests, m)."""
    return np.clip(gain * (requests[:, np.newaxis] - angles), -1.0, 1.0)


def breakpoints(angles: Array, requests: RequestSet) -> Array:
    """Requests of the set at which some contribution starts or ceases to saturate; its ends."""
    reach = 1.0 / requests.gain
    every = np.concatenate([angles - reach, angles + reach])
    within: Array = np.minimum(np.maximum(every, requests.interval[0]), requests.interval[1])
    return within


def support(nu: Array, xi: Array, requests: RequestSet) -> Support:
    """The support function of the set in the direction (nu, -xi): the right-hand side of (9a).

    For a given request every angle is on its own, and best at an end of its range or where its
    contribution is just saturated. Between neighbouring breakpoints all these candidates are linear
    in the request, so that the best of them is convex in it, and the maximum is at a breakpoint.
    """
    lower, upper, gain = requests.lower, requests.upper, requests.gain
    tried = breakpoints(np.concatenate([lower, upper]), requests)[:, np.newaxis]
    angles = np.empty((4, len(tried), len(lower)))
    angles[0], angles[1] = lower, upper
    angles[2] = np.minimum(np.maximum(tried - 1.0 / gain, lower), upper)
    angles[3] = np.minimum(np.maximum(tried + 1.0 / gain, lower), upper)
    contributions = np.minimum(np.maximum(gain * (tried - angles), -1.0), 1.0)
    values = nu * contributions - xi * angles
    best = int(np.argmax(values.max(axis=0).sum(axis=1)))
    which = values[:, best].argmax(axis=0), best, np.arange(len(lower))
    return Support(float(values[which].sum()), contributions[which], angles[which])


def separate(
    contributions: Array,
    angles: Array,
    requests: RequestSet,
    options: CutOptions = CutOptions(),
) -> HullCut | None:
    """A cut that the contributions violate at these angles, or None if none does by enough.

    The nearest mixture of points of the set is sought, one support point after the other in the
    direction of the residual; that direction is the cut's normal, and its limit the support there.
    """
    gain, middle = requests.gain, (requests.lower + requests.upper) / 2.0
    angles = np.clip(angles, requests.lower, requests.upper)
    count = len(contributions)
    target = np.concatenate([contributions, gain * (angles - middle)])
    curve = contributions_of(np.unique(breakpoints(angles, requests)), angles, gain)
    points = np.hstack([curve, np.broadcast_to(target[count:], curve.shape)])
    best, deepest = None, options.violation
    for _ in range(options.trials):
        system = np.vstack([points.T, np.full(len(points), SUM_WEIGHT)])
        shares, _ = nnls(system, np.append(target, SUM_WEIGHT))
        residual = target - shares @ points / shares.sum()
        size = float(np.linalg.norm(residual))
        if size < options.violation:
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
    contributions: Array, angles: Array, requests: RequestSet
) -> tuple[float, float]:
    """The request whose contributions at these angles are nearest, and their distance."""
    ends = breakpoints(angles, requests)
    tried = np.linspace(ends.min(), ends.max(), TRIED_REQUESTS)
    distances = np.linalg.norm(
        contributions_of(tried, angles, requests.gain) - contributions, axis=1
    )
    nearest = int(np.argmin(distances))
    return float(tried[nearest]), float(distances[nearest])
