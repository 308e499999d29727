"""One Gauss-Newton step of the optimised inversion, at a cost in proportion to the length.

With the angles' linearised response ``B dM = H dR`` (B bidiagonal, H banded) the step solves

    minimise  2 g' dM + dM' C dM + rho |R + dR - R0|^2 + mu |dR|^2

over the free requests, where g and C are gradient and curvature of the cost, sample by sample. Its
dual has one unknown per sample and joint, and the banded positive definite matrix
``B C^-1 B' + H Q^-1 H'`` with ``Q = rho + mu`` (``docs/math.md``, equation 12); a cycle is folded,
first sample beside last, so that its matrix is banded too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.inversion.stencil import Indices, Stencil
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
    inverse_pull = np.where(free, 1.0 / (pull.weight + damping), 0.0)
    inverse = _inverse(cost.curvature)
    columns = stencil.columns(response.by_request)
    matrix = stencil.matrix(response.by_angle, columns, inverse, inverse_pull)
    steepest = _times(inverse, cost.gradient)
    wanted = response.by_angle * steepest[stencil.before] - steepest
    wanted += stencil.forward(response.by_request, inverse_pull * pull.weight * pull.away)
    multipliers = _solved(matrix, wanted, stencil.position)
    requests = inverse_pull * (stencil.backward(columns, multipliers) - pull.weight * pull.away)
    # (B' y)[k] = y[k] - by_angle[k+1] y[k+1]
    forces = multipliers - (response.by_angle * multipliers)[stencil.after]
    angles = -steepest - _times(inverse, forces)
    moved = pull._replace(away=pull.away + requests)
    expected = cost.value + 2.0 * float(np.vdot(cost.gradient, angles)) + moved.value
    expected += float(np.vdot(angles, _times(cost.curvature, angles)))
    return Step(requests, angles, expected)


def _inverse(matrices: Array) -> Array:
    if matrices.shape[-1] == 1:
        reciprocals: Array = 1.0 / matrices
        return reciprocals
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
