"""One Gauss-Newton step of the optimised inversion, at a cost in proportion to the length.

With the angles' linearised response ``B dM = H dR`` (B bidiagonal, H banded) the step solves

    minimise  2 g' dM + dM' C dM + rho |R + dR - R0|^2 + mu |dR|^2

over the free requests, where g and C are gradient and curvature of the cost, sample by sample. Its
dual has one unknown per sample and joint, and the banded positive definite matrix
``B C^-1 B' + H Q^-1 H'`` with ``Q = rho + mu`` (``docs/math.md``, equation 11); a cycle is folded,
first sample beside last, so that its matrix is banded too.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.model.transition import Reach, acting
from planner.trajectory import Array

Mask = npt.NDArray[np.bool_]


class Response(NamedTuple):
    """Angles of all joints and their derivatives, sample by sample.

    ``d angles[k] = by_angle[k] d angles[k-1] + sum_j by_request[k, j] d requests[acting[k, j]]``

    From rest ``by_angle[0]`` is zero: nothing comes before the first sample that could change.
    """

    angles: Array  # (n, joints) [rad]
    by_angle: Array  # (n, joints)
    by_request: Array  # (n, width, joints)


class Quadratic(NamedTuple):
    """A cost to second order: ``value + 2 sum gradient . d + sum d' curvature d``."""

    value: float
    gradient: Array  # (n, joints)
    curvature: Array  # (n, joints, joints), positive definite


class Pull(NamedTuple):
    """``weight |requests - toward|^2``, which decides among requests that track equally well."""

    weight: float
    away: Array  # requests - toward [rad], (n, joints)

    @property
    def value(self) -> float:
        """The cost of being away."""
        return self.weight * float(np.sum(self.away**2))


class Step(NamedTuple):
    """A proposed change, and what the linearisation expects of it."""

    requests: Array  # (n, joints) [rad]
    angles: Array  # (n, joints) [rad]
    expected: float  # cost afterwards


class Stencil:
    """Where requests act on the samples of a trajectory, for joints of one reach."""

    def __init__(self, reach: Reach, samples: int, joints: int, *, cyclic: bool) -> None:
        """Work out the indices once."""
        self.samples = samples
        self.cyclic = cyclic
        self.joints = joints
        width = reach.width
        self.acting = acting(reach, samples, cyclic=cyclic)  # request of H[k, j]
        ages = reach.youngest + np.arange(width)
        answering = self._wrap(np.arange(samples)[:, np.newaxis] + ages)  # sample of H'[k, j]
        entries = answering * width + np.arange(width)
        self._entries = np.where(answering < 0, samples * width, entries)
        self._fold(width)

    def _wrap(self, index: npt.NDArray[np.int_]) -> npt.NDArray[np.int_]:
        if self.cyclic:
            return index % self.samples
        return np.where((index < 0) | (index >= self.samples), -1, index)

    def _fold(self, width: int) -> None:
        """Find the place in the folded lower band of every pair of samples that share a request."""
        n, joints = self.samples, self.joints
        order = np.arange(n)
        if self.cyclic:  # 0, n-1, 1, n-2, ...
            self.position = np.where(order < (n + 1) // 2, 2 * order, 2 * (n - order) - 1)
        else:
            self.position = order
        joint = np.arange(joints)
        blocks = []
        band = 0
        for distance in range(max(width, 2)):
            other = self._wrap(order + distance)
            here = np.flatnonzero(other >= 0)
            there = other[here]
            row = self.position[here, np.newaxis, np.newaxis] * joints + joint[:, np.newaxis]
            column = self.position[there, np.newaxis, np.newaxis] * joints + joint
            below = np.abs(row - column)
            # Both (here, there) and (there, here) stand for the pair; at distance 0, and where a
            # short cycle folds a pair onto one sample, they are entries of one diagonal block.
            same = (here == there)[:, np.newaxis, np.newaxis]
            factor = np.where(same & (row == column) & (distance > 0), 2.0, 1.0)
            if distance == 0:
                factor = np.where(row >= column, factor, 0.0)
            blocks.append((here, there, below, np.minimum(row, column), factor))
            band = max(band, int(below.max(initial=0)))
        self.bandwidth = band
        size = n * joints
        self._blocks = [
            (here, there, (below * size + least).ravel(), factor.ravel())
            for here, there, below, least, factor in blocks
        ]

    def windows(self, requests: Array) -> Array:
        """The requests that act before each sample, youngest first: (n, width, joints)."""
        windows: Array = requests[np.maximum(self.acting, 0)]
        return windows

    def forward(self, by_request: Array, change: Array) -> Array:
        """H dR: (n, joints)."""
        answer: Array = np.einsum("kji,kji->ki", by_request, self._at_requests(change))
        return answer

    def backward(self, by_request: Array, multipliers: Array) -> Array:
        """H' y: (n, joints)."""
        products = (by_request * multipliers[:, np.newaxis]).reshape(-1, self.joints)
        answer: Array = np.vstack([products, np.zeros(self.joints)])[self._entries].sum(axis=1)
        return answer

    def _at_requests(self, values: Array) -> Array:
        picked: Array = np.vstack([values, np.zeros(self.joints)])[self.acting]
        return picked

    def matrix(self, response: Response, inverse: Array, inverse_pull: Array) -> Array:
        """``B C^-1 B' + H Q^-1 H'``, folded, as a lower band: (bandwidth + 1, n * joints)."""
        n, width, joints = response.by_request.shape
        band = np.zeros((self.bandwidth + 1) * n * joints)
        kept = response.by_angle
        scaled = response.by_request * self._at_requests(inverse_pull)
        diagonal = np.arange(joints)
        for distance, (here, there, place, factor) in enumerate(self._blocks):
            shared = max(width - distance, 0)
            block = np.zeros((len(here), joints, joints))
            block[:, diagonal, diagonal] = np.einsum(
                "kji,kji->ki", scaled[here, :shared], response.by_request[there, distance:]
            )
            if distance == 0:
                previous = np.roll(inverse, 1, axis=0)
                block += inverse + kept[:, :, np.newaxis] * previous * kept[:, np.newaxis]
            elif distance == 1:
                block -= inverse[here] * kept[there][:, np.newaxis]
            band += np.bincount(place, weights=factor * block.ravel(), minlength=len(band))
        return band.reshape(self.bandwidth + 1, n * joints)


@lru_cache(maxsize=32)
def stencil(reach: Reach, samples: int, joints: int, *, cyclic: bool) -> Stencil:
    """The stencil for this reach and size: worked out at the first call, then kept."""
    return Stencil(reach, samples, joints, cyclic=cyclic)


def gauss_newton_step(
    stencil: Stencil,
    response: Response,
    cost: Quadratic,
    *,
    pull: Pull,
    damping: float,
    free: Mask,
) -> Step:
    """The step of the module's problem.

    Args:
        stencil: Where requests act.
        response: Angles and derivatives at the current requests.
        cost: The cost of the angles.
        pull: The cost of the requests.
        damping: mu > 0.
        free: Requests that may change, shape (n, joints).

    Returns:
        The change of requests and of angles, and the cost that the linearisation expects.

    Raises:
        numpy.linalg.LinAlgError: The matrix is not positive definite to working precision.
    """
    from scipy.linalg import solveh_banded

    inverse_pull = np.where(free, 1.0 / (pull.weight + damping), 0.0)
    inverse: Array = np.linalg.inv(cost.curvature).astype(np.float64, copy=False)
    matrix = stencil.matrix(response, inverse, inverse_pull)
    steepest = np.einsum("kij,kj->ki", inverse, cost.gradient)
    wanted = -(steepest - response.by_angle * np.roll(steepest, 1, axis=0))
    wanted += stencil.forward(response.by_request, inverse_pull * pull.weight * pull.away)
    folded = np.empty_like(wanted)
    folded[stencil.position] = wanted
    solved = solveh_banded(matrix, folded.ravel(), lower=True, overwrite_b=True)
    multipliers = solved.reshape(wanted.shape)[stencil.position]
    requests = inverse_pull * (
        stencil.backward(response.by_request, multipliers) - pull.weight * pull.away
    )
    # (B' y)[k] = y[k] - by_angle[k+1] y[k+1]
    forces = multipliers - np.roll(response.by_angle * multipliers, -1, axis=0)
    angles = -steepest - np.einsum("kij,kj->ki", inverse, forces)
    moved = pull._replace(away=pull.away + requests)
    expected = cost.value + 2.0 * float(np.sum(cost.gradient * angles)) + moved.value
    expected += float(np.einsum("ki,kij,kj->", angles, cost.curvature, angles))
    return Step(requests, angles, expected)
