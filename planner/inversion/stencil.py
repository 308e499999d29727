"""Where the requests of a trajectory act, and the banded matrix that follows from it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from planner.model.joint import Reach, acting
from planner.trajectory import Array

Indices = npt.NDArray[np.int_]

LEAST_PIVOT = 1e-14
"""Added to the matrix's diagonal, relative to its largest entry: a saturated cycle is singular."""


class Stencil:
    """Where requests act on the samples of a trajectory, for joints of one reach.

    Derivatives by requests have shape (width, n, joints), the youngest request first.
    """

    def __init__(self, reach: Reach, samples: int, joints: int, *, cyclic: bool) -> None:
        """Work out the indices once."""
        self.samples = samples
        self.cyclic = cyclic
        self.joints = joints
        self.width = reach.width
        every = np.arange(samples)
        self.acting = np.ascontiguousarray(acting(reach, samples, cyclic=cyclic).T)
        self._standing_in = np.maximum(self.acting, 0)
        ages = np.arange(reach.width)[:, np.newaxis]
        answering = self._wrap(every + reach.youngest + ages)
        self._answers = np.where(
            answering < 0, reach.width * samples, ages * samples + answering
        )  # where each request's derivatives are, among those of all; behind them where nowhere
        # From rest too the first sample comes after the last: by_angle is zero there.
        self.before, self.after = np.roll(every, 1), np.roll(every, -1)
        if cyclic:  # 0, n-1, 1, n-2, ...
            self.position = np.where(
                every < (samples + 1) // 2, 2 * every, 2 * (samples - every) - 1
            )
        else:
            self.position = every
        self._fold()

    def _wrap(self, index: Indices) -> Indices:
        if self.cyclic:
            return index % self.samples
        return np.where((index < 0) | (index >= self.samples), -1, index)

    def _fold(self) -> None:
        """Find where in the folded lower band the entries of every pair of samples go.

        Samples up to the width apart share requests, joint by joint; samples one apart share
        an angle, which couples the joints.
        """
        joint = np.arange(self.joints)
        here = np.arange(self.samples)[:, np.newaxis]
        apart = np.arange(self.width)[:, np.newaxis, np.newaxis]
        onwards = np.arange(self.samples + self.width - 1)
        self._onwards = onwards % self.samples if self.cyclic else onwards.clip(0, self.samples - 1)
        shared = self._places(here, self._wrap(here + apart), joint, joint)
        there = self._wrap(here + 1)[:, :, np.newaxis]
        one, other = joint[:, np.newaxis], joint
        own = self._places(here[:, :, np.newaxis], here[:, :, np.newaxis], one, other)
        beside = self._places(here[:, :, np.newaxis], there, one, other)
        # Joints couple both ways within a sample; the band holds one of the two.
        own = own[0], own[1], np.broadcast_to((one >= other).astype(np.float64), own[0].shape)
        # What lies on the diagonal though it couples two ends counts for both: a cycle so short
        # that it meets itself.
        shared[2][1:] *= 1.0 + (shared[0][1:] == 0)
        beside[2][:] *= 1.0 + ((beside[0] == 0) & (one == other))
        parts = shared, own, beside
        self.bandwidth = max(int(below.max()) for below, _, _ in parts)
        self._place = np.concatenate(
            [(column * (self.bandwidth + 1) + below).ravel() for below, column, _ in parts]
        )
        self._factor = np.concatenate([factor.ravel() for _, _, factor in parts])

    def _places(
        self, one: Indices, other: Indices, i: Indices, j: Indices
    ) -> tuple[Indices, Indices, Array]:
        """Where the entry of joint i at sample ``one`` and joint j at sample ``other`` goes.

        How far below the diagonal, in which column, and times what: 0 where there is no sample.
        """
        row, column = self.position[one] * self.joints + i, self.position[other] * self.joints + j
        missing = np.broadcast_to(other < 0, np.broadcast_shapes(row.shape, column.shape))
        below = np.where(missing, 0, np.abs(row - column))
        return below, np.minimum(row, column), np.where(missing, 0.0, 1.0)

    def windows(self, requests: Array) -> Array:
        """The requests that act before each sample, youngest first: (width, n, joints)."""
        windows: Array = requests.take(self._standing_in, axis=0)
        return windows

    def felt(self, weights: Array) -> Array:
        """Something of each request where the request acts, 0 before the first: (width, n, k)."""
        if not self.cyclic:
            weights = np.concatenate([weights, np.zeros((1, self.joints))])
        felt: Array = weights.take(self.acting, axis=0)  # -1 is the row of zeros
        return felt

    def gathered(self, entries: Array, combine: np.ufunc = np.add, nothing: float = 0.0) -> Array:
        """The sum over all samples of what each request has there: (n, joints).

        ``combine`` may put something else in the sum's place, and ``nothing`` what is its zero.
        """
        flat = entries.reshape(-1, self.joints)
        if not self.cyclic:
            flat = np.concatenate([flat, np.full((1, self.joints), nothing)])
        answer: Array = combine.reduce(flat.take(self._answers, axis=0), axis=0)
        return answer

    def matrix(self, by_angle: Array, by_request: Array, inverse: Array, weighted: Array) -> Array:
        """``B C^-1 B' + H Q^-1 H'``, folded, as a lower band: (bandwidth + 1, n * joints).

        Args:
            by_angle: B's derivatives, (n, joints).
            by_request: H, (width, n, joints).
            inverse: C^-1, (n, joints, joints).
            weighted: H Q^-1, like H.
        """
        size = self.samples * self.joints
        shared = np.empty((self.width, size))
        weighted = weighted.reshape(self.width, size)
        onwards = by_request.take(self._onwards, axis=1).reshape(self.width, -1)
        for apart in range(self.width):
            later = onwards[apart:, apart * self.joints :][:, :size]
            np.einsum("ij,ij->j", weighted[: self.width - apart], later, out=shared[apart])
        kept = by_angle[:, :, np.newaxis]
        own = inverse + kept * inverse[self.before] * by_angle[:, np.newaxis]
        beside = -inverse * by_angle[self.after][:, np.newaxis]
        entries = np.concatenate([shared.ravel(), own.ravel(), beside.ravel()])
        entries *= self._factor
        entries = np.bincount(self._place, entries, minlength=(self.bandwidth + 1) * size)
        band = np.asarray(entries.reshape(size, self.bandwidth + 1), dtype=np.float64)
        band[:, 0] += LEAST_PIVOT * band[:, 0].max()
        return band.T  # laid out as LAPACK reads it


@lru_cache(maxsize=32)
def stencil(reach: Reach, samples: int, joints: int, *, cyclic: bool) -> Stencil:
    """The stencil for this reach and size: worked out at the first call, then kept."""
    return Stencil(reach, samples, joints, cyclic=cyclic)
