"""A small convex quadratic programme, solved exactly enough to be iterated."""

from __future__ import annotations

import numpy as np

from planner.trajectory import Array

FEASIBLE = 1e-9
"""Violation of a constraint, relative to the step, up to which an answer is believed."""


def minimize_quadratic(hessian: Array, gradient: Array, rows: Array, bounds: Array) -> Array | None:
    """The p that minimises ½ pᵀHp + gᵀp among those with A p <= b.

    With H = LLᵀ and z = Lᵀp + L⁻¹g this is the point of a polyhedron that is nearest to the origin,
    which one call of non-negative least squares finds (Lawson and Hanson, Solving Least Squares
    Problems, 1974, Chapter 23).

    Args:
        hessian: H, shape (k, k).
        gradient: g, shape (k,).
        rows: A, shape (m, k).
        bounds: b, shape (m,).

    Returns:
        p, shape (k,); None if H is not positive definite or no trustworthy answer was found.
    """
    from scipy.optimize import nnls

    try:
        factor = np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        return None
    # The inverse, as LAPACK's triangular solves start threads that wait for each other even at this
    # size, milliseconds on a busy machine.
    inverse = np.linalg.inv(factor)
    free, normals = inverse @ gradient, inverse @ rows.T
    shortfall = -(bounds + normals.T @ free)  # of z = 0, as normals.T z <= bounds + normals.T free
    if np.all(shortfall <= 0.0):
        z = np.zeros_like(free)
    else:
        scale = float(np.max(np.abs(shortfall)))
        system = np.vstack([-normals, shortfall / scale])
        target = np.zeros(free.size + 1)
        target[-1] = 1.0
        try:
            multipliers, _ = nnls(system, target)
        except RuntimeError:  # it did not end; the caller damps more and asks again
            return None
        residual = target - system @ multipliers
        if residual[-1] <= 0.0:
            return None
        z = scale * -residual[:-1] / residual[-1]
    step = inverse.T @ (z - free)
    size = float(np.max(np.abs(rows) @ np.abs(step), initial=0.0))
    if np.max(rows @ step - bounds, initial=0.0) > FEASIBLE * max(size, 1e-300):
        return None
    return np.asarray(step)
