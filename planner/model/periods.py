"""Every request period of a trajectory at once, on the model with rounded corners.

Where the angle before each period is given, the periods do not wait for one another: all samples
are evaluated together, and nothing is run. The optimised inversion, which has the angles among its
unknowns, needs no more than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planner.model.joint import JointModel
from planner.model.transition import Reach, reach, weights_by_tick
from planner.trajectory import Array

LEAST_RADIUS = 1e-12
"""Least radius of the corners [theta_0]: a square of it is still a number beside one."""


class Response(NamedTuple):
    """Where each period leads, and to second order how that changes.

    ``d reached[k] = by_angle[k] d before[k] + sum_j by_request[j, k] d requests[acting[j, k]]``
    and half of ``bending[j, k]`` times the square of ``d requests[acting[j, k]] - d before[k]``;
    where requests are held for several ticks, the bending is an estimate.
    """

    reached: Array  # (n, joints) [rad]
    by_angle: Array  # (n, joints)
    by_request: Array  # (width, n, joints)
    bending: Array  # (width, n, joints) [1/rad]


class Periods:
    """The request periods of joints that are sent their requests together."""

    def __init__(self, models: Sequence[JointModel], samples: int) -> None:
        """Work out which request counts how much at each tick of a period."""
        self.reach = reach_of(models)
        ticks = max(model.hold for model in models)
        weights = np.zeros((ticks, self.reach.width, len(models)))
        for joint, model in enumerate(models):
            own = reach(model)
            first = own.youngest - self.reach.youngest
            weights[: model.hold, first : first + own.width, joint] = weights_by_tick(model)
        theta_0 = np.array([model.theta_0 for model in models])
        speeds = np.array([model.v_max_per_tick for model in models])
        shape = (self.reach.width, samples, len(models))
        # Spelled out for every sample, so that no array below is stretched to fit another.
        self._gains = _repeated(weights[:, :, np.newaxis] * speeds / (2.0 * theta_0), shape)
        self._corners = _repeated(np.stack([theta_0, -theta_0])[:, np.newaxis, np.newaxis], shape)
        self._theta_0 = _repeated(theta_0[np.newaxis, np.newaxis, np.newaxis], shape)[0]
        self._offsets = np.array([model.offset for model in models])

    def __call__(self, before: Array, windows: Array, smoothing: float) -> Response:
        """The response to requests.

        Args:
            before: Angle before each sample [rad], shape (n, joints).
            windows: Requests that act before each sample, youngest first [rad], (width, n, joints).
            smoothing: Radius of the saturation's corners [theta_0].
        """
        rounded = (max(smoothing, LEAST_RADIUS) * self._theta_0) ** 2
        reached = before
        for number, gains in enumerate(self._gains):
            beyond = self._corners + (windows - (reached - self._offsets))  # of either corner
            squares = beyond * beyond
            squares += rounded
            lengths = np.sqrt(squares)
            beyond /= lengths
            squares *= lengths
            np.divide(rounded, squares, out=squares)
            slopes = (beyond[0] - beyond[1]) * gains
            bends = (squares[0] - squares[1]) * gains
            moved = ((lengths[0] - lengths[1]) * gains).sum(axis=0)
            kept = 1.0 - slopes.sum(axis=0)
            reached = reached + moved
            if number == 0:
                by_angle, by_request, bending = kept, slopes, bends
            else:
                by_angle = by_angle * kept
                by_request = by_request * kept + slopes
                bending = bending * kept + bends
        return Response(reached, by_angle, by_request, bending)


def _repeated(array: Array, shape: tuple[int, ...]) -> Array:
    """The array, repeated to this shape along all axes but its first."""
    return np.ascontiguousarray(np.broadcast_to(array, (len(array), *shape)))


def reach_of(models: Sequence[JointModel]) -> Reach:
    """The requests that act on any of the joints between two samples."""
    reaches = [reach(model) for model in models]
    return Reach(min(r.youngest for r in reaches), max(r.oldest for r in reaches))


@lru_cache(maxsize=32)
def periods(models: tuple[JointModel, ...], samples: int) -> Periods:
    """The periods of these joints and this many samples: worked out once, then kept."""
    return Periods(models, samples)
