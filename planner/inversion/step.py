"""One Gauss-Newton step of the optimised inversion, at a cost in proportion to the length.

Angles and requests are unknowns both; that each angle follows from the one before it and from the
requests is a condition, linearised to ``B dM = H dR + c`` (B bidiagonal, H banded, c what the
condition lacks). The step solves

    minimise  2 g' dM + dM' (C + E) dM + rho |R + dR - R0|^2 + dR' D dR

over the free requests, where g and C are gradient and curvature of the cost, sample by sample, and
D and E are diagonal. Its dual has one unknown per sample and joint, and the banded positive
definite matrix ``B (C + E)^-1 B' + H Q^-1 H'`` with ``Q = rho + D`` (``docs/math.md``, equation
12); a cycle is folded, first sample beside last, so that its matrix is banded too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.inversion.stencil import Indices, Stencil
from planner.model.sensitivity import Response
from planner.trajectory import Array

Mask = npt.NDArray[np.bool_]


class Quadratic(NamedTuple):
    """A cost to second order: ``value + 2 sum gradient . d + sum d' curvature d``."""

    value: float
    gradient: Array  # (n, joints)
    curvature: Array  # (n, joints, joints), positive definite


class Pull(NamedTuple):
    """``weight |requests - toward|^2``, which decides among requests that track equally well."""

    weight: float
    away: Array  # requests - toward [rad], (n, joints)
    least: float = 0.0  # what it costs to be there

    @property
    def value(self) -> float:
        """The cost of being away."""
        return self.least + self.weight * float(np.vdot(self.away, self.away))


class Damping(NamedTuple):
    """Weights on the squares of a step, which hold it back and are no part of the cost."""

    requests: Array  # D > 0, (n, joints)
    angles: Array  # E >= 0, (n, joints)


class Step(NamedTuple):
    """A proposed change, and what the linearisation expects of it."""

    requests: Array  # (n, joints) [rad]
    angles: Array  # (n, joints) [rad]
    multipliers: Array  # of the conditions, y of docs/math.md, (n, joints)
    pushes: Array  # where the requests want to go, free or not, (n, joints)
    expected: float  # cost afterwards


def gauss_newton_step(
    stencil: Stencil,
    response: Response,
    cost: Quadratic,
    *,
    pull: Pull,
    lacking: Array,
    damping: Damping,
    free: Mask,
) -> Step:
    """The step of the module's problem.

    Args:
        stencil: Where requests act.
        response: Derivatives at the current angles and requests.
        cost: The cost of the angles.
        pull: The cost of the requests.
        lacking: c, by how much the angles fall short of where the periods lead, (n, joints).
        damping: What holds the step back.
        free: Requests that may change, shape (n, joints).

    Returns:
        The change of requests and of angles, and the cost that the linearisation expects.

    Raises:
        numpy.linalg.LinAlgError: The matrix is not positive definite to working precision.
    """
    inverse_pull = free / (pull.weight + damping.requests)
    inverse = _inverse(cost.curvature, damping.angles)
    weighted = response.by_request * stencil.felt(inverse_pull)
    matrix = stencil.matrix(response.by_angle, response.by_request, inverse, weighted)
    steepest = _times(inverse, cost.gradient)
    pulled = pull.weight * pull.away
    wanted = response.by_angle * steepest[stencil.before] - steepest - lacking
    wanted += (weighted * stencil.felt(pulled)).sum(axis=0)
    multipliers = _solved(matrix, wanted, stencil.position)
    pushes = stencil.gathered(response.by_request * multipliers) - pulled
    requests = inverse_pull * pushes
    # (B' y)[k] = y[k] - by_angle[k+1] y[k+1]
    forces = multipliers - (response.by_angle * multipliers)[stencil.after]
    angles = -steepest - _times(inverse, forces)
    moved = pull._replace(away=pull.away + requests)
    expected = cost.value + 2.0 * float(np.vdot(cost.gradient, angles)) + moved.value
    expected += float(np.vdot(angles, _times(cost.curvature, angles)))
    return Step(requests, angles, multipliers, pushes, expected)


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


def _solved(matrix: Array, right: Array, position: Indices) -> Array:
    """The multipliers of the folded, banded, positive definite system: (n, joints)."""
    from scipy.linalg.lapack import dpbsv

    folded = np.empty_like(right)
    folded[position] = right
    _, solved, info = dpbsv(matrix, folded.reshape(-1, 1), lower=1, overwrite_ab=1, overwrite_b=1)
    if info:
        raise np.linalg.LinAlgError(f"the step's matrix is not positive definite at row {info}")
    multipliers: Array = solved.reshape(right.shape)[position]
    return multipliers
