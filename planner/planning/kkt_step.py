"""One Gauss-Newton step of the optimised inversion, at a cost in proportion to the length.

Angles and requests are unknowns both; that each angle follows from the one before it and from the
requests is a condition, linearised to ``B dM = H dR + defects`` (B bidiagonal, H banded;
defects of the dynamics, as in multiple shooting). The step solves (11) of ``docs/math.md``,

    minimise  2 g' dM + dM' (K + E) dM + alpha |R + dR - R*|^2 + dR' Delta dR   subject to the above

over the free requests, where g and K are gradient and curvature of the cost, sample by sample, and
Delta and E are diagonal, Levenberg-Marquardt terms. Of its KKT system the multipliers lambda are
found first: one unknown per sample and joint, and the banded positive definite Schur complement
``B (K + E)^-1 B' + H Q^-1 H'`` with ``Q = alpha + Delta`` (12). A cycle is folded, first sample
beside last, so that its matrix is banded too.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planner.model.sensitivity import Response
from planner.planning.tracking_problem import Windows
from planner.trajectory import Array, Indices, Mask

LEAST_PIVOT = 1e-14
"""Added to the matrix's diagonal, relative to its largest entry: a saturated cycle is singular."""


class Quadratic(NamedTuple):
    """A cost to second order: ``value + 2 sum gradient . d + sum d' curvature d``."""

    value: float
    gradient: Array  # (n, joints)
    curvature: Array  # (n, joints, joints), positive definite


class Regularisation(NamedTuple):
    """``weight |away|^2``: decides among requests that track alike.

    What counts is the distance of the requests from a centre, or their second differences; only
    ``qp_step`` knows the latter, which couple the requests.
    """

    weight: float
    away: Array  # requests - centre, or their second differences [rad], (.., joints)
    second_differences: bool = False


class Iterate(NamedTuple):
    """Where a search is: requests, angles, and to second order what they cost."""

    requests: Array  # R [rad], (n, joints)
    angles: Array  # M [rad], (n, joints)
    response: Response  # where the periods of the smoothed models lead from the angles
    defects: Array  # by how much the angles fall short of that [rad], (n, joints)
    cost: Quadratic  # of the angles
    regularisation: Regularisation  # cost of the requests
    value: float  # both costs


class Damping(NamedTuple):
    """Levenberg-Marquardt terms: weights on the squares of a step, not part of the cost."""

    requests: Array  # Delta > 0, (n, joints)
    angles: Array  # E >= 0, (n, joints)


class Step(NamedTuple):
    """A proposed change, and what the linearisation predicts of it."""

    requests: Array  # (n, joints) [rad]
    angles: Array  # (n, joints) [rad]
    multipliers: Array  # of the conditions, lambda of docs/math.md, (n, joints)
    reduced_gradient: Array  # half the cost's derivative by each request, free or not, (n, joints)
    predicted: float  # cost afterwards


def kkt_step(
    windows: Windows,
    current: Iterate,
    damping: Damping,
    *,
    free: Mask,
) -> Step:
    """The step of the module's problem: (11) and (12) of ``docs/math.md``.

    Args:
        windows: Where requests act.
        current: Where the search is.
        damping: The Levenberg-Marquardt terms.
        free: Requests that may change, shape (n, joints).

    Returns:
        The change of requests and of angles, and the cost that the linearisation predicts.

    Raises:
        numpy.linalg.LinAlgError: The matrix is not positive definite to working precision.
    """
    response, cost, regularisation = current.response, current.cost, current.regularisation
    inverse_q = free / (regularisation.weight + damping.requests)
    inverse = _inverse(cost.curvature, damping.angles)
    weighted = response.by_request * windows.spread(inverse_q)
    band = schur_band(windows)
    matrix = band.matrix(response, inverse, weighted)
    steepest = _times(inverse, cost.gradient)
    gradient = regularisation.weight * regularisation.away  # half that of the regularisation
    right = response.by_own * steepest[windows.before] - steepest - current.defects
    right += (weighted * windows.spread(gradient)).sum(axis=0)
    multipliers = band.solve(matrix, right)
    reduced_gradient = gradient - windows.gathered(response.by_request * multipliers)
    requests = -inverse_q * reduced_gradient
    # (B' lambda)[k] = lambda[k] - by_angle[k+1] lambda[k+1]
    forces = multipliers - (response.by_own * multipliers)[windows.after]
    angles = -steepest - _times(inverse, forces)
    moved = regularisation._replace(away=regularisation.away + requests)
    predicted = cost.value + 2.0 * float(np.vdot(cost.gradient, angles)) + cost_of(moved)
    predicted += float(np.vdot(angles, _times(cost.curvature, angles)))
    return Step(requests, angles, multipliers, reduced_gradient, predicted)


def cost_of(regularisation: Regularisation) -> float:
    """Its share of the cost."""
    return regularisation.weight * float(np.vdot(regularisation.away, regularisation.away))


def _inverse(curvature: Array, added: Array) -> Array:
    """Inverse of each matrix with something added to its diagonal."""
    if added.shape[-1] == 1:
        reciprocals: Array = 1.0 / (curvature + added[:, :, np.newaxis])
        return reciprocals
    every = np.arange(added.shape[-1])
    matrices = curvature.copy()
    matrices[:, every, every] += added
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)


def _times(matrices: Array, vectors: Array) -> Array:
    """Each matrix times its vector: (n, joints)."""
    if matrices.shape[-1] == 1:
        return matrices[:, 0] * vectors
    product: Array = np.einsum("kij,kj->ki", matrices, vectors)
    return product


class SchurBand:
    """The matrix of (12) as the lower band that LAPACK reads, a cycle folded."""

    def __init__(self, windows: Windows) -> None:
        """Find the place of every entry once."""
        self.windows = windows
        self.joints = windows.joints
        self.width = windows.ages.width
        every = np.arange(windows.samples)
        if windows.cyclic:  # 0, n-1, 1, n-2, ...
            self.position = np.where(
                every < (windows.samples + 1) // 2, 2 * every, 2 * (windows.samples - every) - 1
            )
        else:
            self.position = every
        self._fold(windows)

    def _fold(self, windows: Windows) -> None:
        """Find where in the folded lower band the entries of every pair of samples go.

        Samples up to the width apart share requests, joint by joint; samples one apart share
        an angle, which couples the joints.
        """
        joint = np.arange(self.joints)
        here = np.arange(windows.samples)[:, np.newaxis]
        apart = np.arange(self.width)[:, np.newaxis, np.newaxis]
        onwards = np.arange(windows.samples + self.width - 1)
        last = windows.samples - 1
        self._onwards = onwards % (last + 1) if windows.cyclic else onwards.clip(0, last)
        shared = self._places(here, windows.wrap(here + apart), joint, joint)
        there = windows.wrap(here + 1)[:, :, np.newaxis]
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

    def matrix(self, response: Response, inverse: Array, weighted: Array) -> Array:
        """``B K^-1 B' + H Q^-1 H'``, folded, as a lower band: (bandwidth + 1, n * joints).

        Args:
            response: The derivatives in B and H.
            inverse: (K + E)^-1, (n, joints, joints).
            weighted: H Q^-1, like H.
        """
        by_angle, by_request = response.by_own, response.by_request
        size = self.windows.samples * self.joints
        shared = np.empty((self.width, size))
        weighted = weighted.reshape(self.width, size)
        onwards = by_request.take(self._onwards, axis=1).reshape(self.width, -1)
        for apart in range(self.width):
            later = onwards[apart:, apart * self.joints :][:, :size]
            np.einsum("ij,ij->j", weighted[: self.width - apart], later, out=shared[apart])
        kept = by_angle[:, :, np.newaxis]
        own = inverse + kept * inverse[self.windows.before] * by_angle[:, np.newaxis]
        beside = -inverse * by_angle[self.windows.after][:, np.newaxis]
        entries = np.concatenate([shared.ravel(), own.ravel(), beside.ravel()])
        entries *= self._factor
        entries = np.bincount(self._place, entries, minlength=(self.bandwidth + 1) * size)
        band = np.asarray(entries.reshape(size, self.bandwidth + 1), dtype=np.float64)
        band[:, 0] += LEAST_PIVOT * band[:, 0].max()
        return band.T  # laid out as LAPACK reads it

    def solve(self, matrix: Array, right: Array) -> Array:
        """The multipliers of the folded system, (n, joints); overwrites the matrix."""
        from scipy.linalg.lapack import dpbsv

        folded = np.empty_like(right)
        folded[self.position] = right
        _, solved, info = dpbsv(
            matrix, folded.reshape(-1, 1), lower=1, overwrite_ab=1, overwrite_b=1
        )
        if info:
            raise np.linalg.LinAlgError(f"the step's matrix is not positive definite at row {info}")
        multipliers: Array = solved.reshape(right.shape)[self.position]
        return multipliers


@lru_cache(maxsize=32)
def schur_band(windows: Windows) -> SchurBand:
    """The band for these windows: worked out at the first call, then kept."""
    return SchurBand(windows)
