"""Where the requests of a trajectory act, and the banded matrix that follows from it."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.model.transition import Reach, acting
from planner.trajectory import Array

Indices = npt.NDArray[np.int_]

LEAST_PIVOT = 1e-14
"""Added to the matrix's diagonal, relative to its largest entry: a saturated cycle is singular."""


class Stencil:
    """Where requests act on the samples of a trajectory, for joints of one reach."""

    def __init__(self, reach: Reach, samples: int, joints: int, *, cyclic: bool) -> None:
        """Work out the indices once."""
        self.samples = samples
        self.cyclic = cyclic
        self.joints = joints
        width = reach.width
        self.acting = acting(reach, samples, cyclic=cyclic)  # request of H[k, j]
        every = np.arange(samples)
        answering = self._wrap(every[:, np.newaxis] + reach.youngest + np.arange(width))
        self._entries = np.where(
            answering < 0, samples * width, answering * width + np.arange(width)
        )
        # From rest too the first sample comes after the last: by_angle is zero there.
        self.before, self.after = np.roll(every, 1), np.roll(every, -1)
        if cyclic:  # 0, n-1, 1, n-2, ...
            self.position = np.where(
                every < (samples + 1) // 2, 2 * every, 2 * (samples - every) - 1
            )
        else:
            self.position = every
        self._fold(answering)

    def _wrap(self, index: Indices) -> Indices:
        if self.cyclic:
            return index % self.samples
        return np.where((index < 0) | (index >= self.samples), -1, index)

    def _fold(self, answering: Indices) -> None:
        """Find where in the folded lower band each product of two entries of a column of H goes.

        The same for ``B C^-1 B'``: its blocks lie on the diagonal and beside it.
        """
        joint = np.arange(self.joints)
        self._pairs = np.triu_indices(answering.shape[1])
        first, second = (answering[:, pair, np.newaxis] for pair in self._pairs)
        shared = _places(self.position, first, second, joint, joint)
        # A short cycle folds a request onto one sample twice: two entries of one diagonal.
        twice = (first == second) & (self._pairs[0] != self._pairs[1])[:, np.newaxis]
        missing = (first < 0) | (second < 0)
        self._factor = np.where(missing, 0.0, np.where(twice, 2.0, 1.0))
        here = np.arange(self.samples)[:, np.newaxis, np.newaxis]
        own = _places(self.position, here, here, joint[:, np.newaxis], joint)
        there = self._wrap(here + 1)
        beside = _places(self.position, here, there, joint[:, np.newaxis], joint)
        lower = joint[:, np.newaxis] >= joint
        alone = (here == there) & (joint[:, np.newaxis] == joint)  # a cycle of one sample
        self._own_factor = np.broadcast_to(lower, own.below.shape).astype(np.float64)
        self._beside_factor = np.where(there < 0, 0.0, np.where(alone, 2.0, 1.0))
        below = [
            np.where(missing, 0, shared.below),
            own.below,
            np.where(there < 0, 0, beside.below),
        ]
        self.bandwidth = max(int(each.max()) for each in below)
        size = self.samples * self.joints
        columns = [shared.column, own.column, beside.column]
        self._place = np.concatenate(
            [(b * size + np.maximum(c, 0)).ravel() for b, c in zip(below, columns, strict=True)]
        )

    def windows(self, requests: Array) -> Array:
        """The requests that act before each sample, youngest first: (n, width, joints)."""
        windows: Array = requests[np.maximum(self.acting, 0)]
        return windows

    def forward(self, by_request: Array, change: Array) -> Array:
        """H dR: (n, joints)."""
        padded = np.concatenate([change, np.zeros((1, self.joints))])
        answer: Array = np.einsum("kji,kji->ki", by_request, padded[self.acting])
        return answer

    def columns(self, by_request: Array) -> Array:
        """The entries of H by request instead of by sample: (n, width, joints)."""
        flat = by_request.reshape(-1, self.joints)
        columns: Array = np.concatenate([flat, np.zeros((1, self.joints))])[self._entries]
        return columns

    def backward(self, columns: Array, multipliers: Array) -> Array:
        """H' y: (n, joints)."""
        padded = np.concatenate([multipliers, np.zeros((1, self.joints))])
        at = np.minimum(self._entries // columns.shape[1], self.samples)
        answer: Array = np.einsum("kji,kji->ki", columns, padded[at])
        return answer

    def matrix(self, by_angle: Array, columns: Array, inverse: Array, inverse_pull: Array) -> Array:
        """``B C^-1 B' + H Q^-1 H'``, folded, as a lower band: (bandwidth + 1, n * joints)."""
        first, second = self._pairs
        shared = (columns * inverse_pull[:, np.newaxis])[:, first] * columns[:, second]
        kept = by_angle[:, :, np.newaxis]
        own = inverse + kept * inverse[self.before] * by_angle[:, np.newaxis]
        beside = -inverse * by_angle[self.after][:, np.newaxis]
        entries = np.concatenate(
            [
                (shared * self._factor).ravel(),
                (own * self._own_factor).ravel(),
                (beside * self._beside_factor).ravel(),
            ]
        )
        size = self.samples * self.joints
        band = np.bincount(self._place, weights=entries, minlength=(self.bandwidth + 1) * size)
        matrix = np.asarray(band.reshape(self.bandwidth + 1, size), dtype=np.float64)
        matrix[0] += LEAST_PIVOT * np.max(matrix[0])
        return matrix


class _Places(NamedTuple):
    """Places in a lower band: how far below the diagonal, and in which column."""

    below: Indices
    column: Indices


def _places(position: Indices, one: Indices, other: Indices, i: Indices, j: Indices) -> _Places:
    """Where the entry of joint i at sample ``one`` and joint j at sample ``other`` goes."""
    joints = int(np.max(i)) + 1
    row, column = position[one] * joints + i, position[other] * joints + j
    return _Places(np.abs(row - column), np.minimum(row, column))


@lru_cache(maxsize=32)
def stencil(reach: Reach, samples: int, joints: int, *, cyclic: bool) -> Stencil:
    """The stencil for this reach and size: worked out at the first call, then kept."""
    return Stencil(reach, samples, joints, cyclic=cyclic)
