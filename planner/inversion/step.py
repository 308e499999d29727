"""One Gauss-Newton step of the optimised inversion, at a cost in proportion to the length.

With the angles' linearised response ``B dM = H dR`` (B bidiagonal, H banded) the step solves

    minimise  |W^(1/2) (r + dM)|^2 + (R + dR - R0)' P (R + dR - R0) + mu |dR|^2

over the free requests. Its dual has one unknown per sample and the banded positive definite matrix
``B W^-1 B' + H Q^-1 H'`` with ``Q = P + mu`` (``docs/math.md``, equation 11); a cycle is folded,
first sample beside last, so that its matrix is banded too.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.model.transition import Linearised, Reach, acting
from planner.trajectory import Array


class Step(NamedTuple):
    """A proposed change, and what the linearisation expects of it."""

    requests: Array  # (n,) [rad]
    angles: Array  # (n,) [rad]


class Stencil:
    """Where the requests act on the samples of a trajectory of one length, for one joint."""

    def __init__(self, reach: Reach, samples: int, *, cyclic: bool) -> None:
        """Work out the indices once."""
        self.samples = samples
        self.cyclic = cyclic
        count = reach.width
        self.acting = acting(reach, samples, cyclic=cyclic)  # request of H[k, j]
        ages = reach.youngest + np.arange(count)
        answering = self._wrap(np.arange(samples)[:, np.newaxis] + ages)  # sample of H'[k, j]
        self._entries = np.where(
            answering < 0, samples * count, answering * count + np.arange(count)
        )
        self._fold(count)

    def _wrap(self, index: npt.NDArray[np.int_]) -> npt.NDArray[np.int_]:
        if self.cyclic:
            return index % self.samples
        return np.where((index < 0) | (index >= self.samples), -1, index)

    def _fold(self, count: int) -> None:
        """Find the place in the folded lower band of every pair of samples that share a request."""
        n = self.samples
        order = np.arange(n)
        if self.cyclic:  # 0, n-1, 1, n-2, ...
            self.position = np.where(order < (n + 1) // 2, 2 * order, 2 * (n - order) - 1)
        else:
            self.position = order
        band = 0
        self._places = []
        for distance in range(max(count, 2)):
            other = self._wrap(order + distance)
            valid = np.flatnonzero(other >= 0)
            here, there = self.position[valid], self.position[other[valid]]
            row, column = np.abs(here - there), np.minimum(here, there)
            twice = np.where((here == there) & (distance > 0), 2.0, 1.0)
            band = max(band, int(row.max(initial=0)))
            self._places.append((valid, other[valid], row * n + column, twice))
        self.bandwidth = band

    def windows(self, requests: Array) -> Array:
        """The requests that act before each sample, youngest first, (n, count)."""
        windows: Array = requests[np.maximum(self.acting, 0)]
        return windows

    def forward(self, by_request: Array, change: Array) -> Array:
        """H dR."""
        answer: Array = np.einsum("kj,kj->k", by_request, self._at_requests(change))
        return answer

    def backward(self, by_request: Array, multipliers: Array) -> Array:
        """H' y."""
        products = np.append(by_request * multipliers[:, np.newaxis], 0.0)
        answer: Array = products[self._entries].sum(axis=1)
        return answer

    def _at_requests(self, values: Array) -> Array:
        picked: Array = np.append(values, 0.0)[self.acting]
        return picked

    def matrix(self, run: Linearised, inverse_weights: Array, inverse_pull: Array) -> Array:
        """``B W^-1 B' + H Q^-1 H'``, folded, as a lower band, (bandwidth + 1, n)."""
        n, count = run.by_request.shape
        band = np.zeros((self.bandwidth + 1) * n)
        scaled = run.by_request * self._at_requests(inverse_pull)
        for distance, (here, there, place, twice) in enumerate(self._places):
            shared = max(count - distance, 0)
            entries = np.einsum("kj,kj->k", scaled[here, :shared], run.by_request[there, distance:])
            if distance == 0:
                previous = np.roll(inverse_weights, 1)
                entries += inverse_weights + run.by_angle**2 * previous
            elif distance == 1:
                entries -= run.by_angle[there] * inverse_weights[here]
            np.add.at(band, place, twice * entries)
        return band.reshape(self.bandwidth + 1, n)


@lru_cache(maxsize=32)
def stencil(reach: Reach, samples: int, *, cyclic: bool) -> Stencil:
    """The stencil for this reach and length: worked out at the first call, then kept."""
    return Stencil(reach, samples, cyclic=cyclic)


def gauss_newton_step(
    stencil: Stencil,
    run: Linearised,
    residuals: Array,
    *,
    weights: Array,
    pull: Array,
    toward: Array,
    damping: float,
    free: npt.NDArray[np.bool_],
) -> Step:
    """The step of the module's problem.

    Args:
        stencil: Where requests act.
        run: Angles and derivatives at the current requests.
        residuals: r, angles minus desired [rad], shape (n,).
        weights: Diagonal of W > 0, shape (n,).
        pull: Diagonal of P >= 0, shape (n,).
        toward: R0 - R [rad], shape (n,).
        damping: mu > 0.
        free: Requests that may change, shape (n,).

    Returns:
        The change of requests and of angles.

    Raises:
        numpy.linalg.LinAlgError: The matrix is not positive definite to working precision.
    """
    from scipy.linalg import solveh_banded

    inverse_pull = np.where(free, 1.0 / (pull + damping), 0.0)
    inverse_weights = 1.0 / weights
    matrix = stencil.matrix(run, inverse_weights, inverse_pull)
    previous = np.roll(residuals, 1)
    if not stencil.cyclic:
        previous[0] = 0.0
    wanted = -(residuals - run.by_angle * previous)
    wanted -= stencil.forward(run.by_request, inverse_pull * pull * toward)
    folded = np.empty_like(wanted)
    folded[stencil.position] = wanted
    multipliers = solveh_banded(matrix, folded, lower=True, overwrite_b=True)[stencil.position]
    change = inverse_pull * (stencil.backward(run.by_request, multipliers) + pull * toward)
    following = np.roll(run.by_angle * multipliers, -1)  # (B' y)[k] = y[k] - by_angle[k+1] y[k+1]
    if not stencil.cyclic:
        following[-1] = 0.0
    angles = -residuals - inverse_weights * (multipliers - following)
    return Step(change, angles)
