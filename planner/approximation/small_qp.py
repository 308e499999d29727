"""Small convex quadratic programmes, solved exactly enough to be iterated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.trajectory import Array

FEASIBLE = 1e-9
"""Violation of a constraint, relative to the step, up to which an answer is believed."""

MOST_DAMPING = 1e12
"""Damping beyond which a Hessian is given up."""


class Damped(NamedTuple):
    """A step, and the damping with which it was found."""

    step: Array | None  # (k,)
    damping: float
    promised: float  # by how much the step should lower twice the programme


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
    inverse = _inverse_factor(hessian)
    return None if inverse is None else _from_factor(inverse, gradient, rows, bounds)


def minimize_damped(
    hessian: Array, scale: Array, damping: float, gradient: Array, rows: Array, bounds: Array
) -> Damped:
    """:func:`minimize_quadratic` with as much damping on the diagonal as makes H definite.

    Args:
        hessian: H, shape (k, k).
        scale: What a damping of one adds to its diagonal, shape (k,).
        damping: The least damping.
        gradient: g, shape (k,).
        rows: A, shape (m, k).
        bounds: b, shape (m,).

    Returns:
        The step, None where no trustworthy one was found.
    """
    diagonal = np.arange(scale.size)
    while damping < MOST_DAMPING:
        damped = hessian.copy()
        damped[diagonal, diagonal] += damping * scale
        inverse = _inverse_factor(damped)
        if inverse is None:
            damping *= 10.0
            continue
        step = _from_factor(inverse, gradient, rows, bounds)
        if step is None:
            break
        promised = -2.0 * float(gradient @ step) - float(step @ (damped @ step))
        return Damped(step, damping, promised)
    return Damped(None, damping, 0.0)


def _inverse_factor(hessian: Array) -> Array | None:
    """L⁻¹ of H = LLᵀ, shape (k, k); None if H is not positive definite."""
    from scipy.linalg import lapack

    factor, failed = lapack.dpotrf(hessian, lower=1)
    if failed:
        return None
    # The inverse, as LAPACK's triangular solves start threads that wait for each other even at this
    # size, milliseconds on a busy machine.
    inverse, failed = lapack.dtrtri(factor, lower=1)
    return None if failed else np.asarray(inverse)


def _from_factor(inverse: Array, gradient: Array, rows: Array, bounds: Array) -> Array | None:
    """The minimiser, from the inverse of the Hessian's factor."""
    from scipy.optimize import nnls

    free = inverse @ gradient
    normals = rows @ inverse.T
    shortfall = -(bounds + normals @ free)  # of z = 0, as normals z <= bounds + normals free
    worst = float(shortfall.max()) if shortfall.size else 0.0
    if worst <= 0.0:
        return np.asarray(-(free @ inverse))
    scale = max(worst, -float(shortfall.min()))
    system = np.empty((free.size + 1, shortfall.size))
    np.negative(normals.T, out=system[:-1])
    np.divide(shortfall, scale, out=system[-1])
    target = np.zeros(free.size + 1)
    target[-1] = 1.0
    try:
        multipliers, _ = nnls(system, target)
    except RuntimeError:  # it did not end; the caller damps more and asks again
        return None
    residual = target - system @ multipliers
    if residual[-1] <= 0.0:
        return None
    step = ((-scale / residual[-1]) * residual[:-1] - free) @ inverse
    size = float((np.abs(rows) @ np.abs(step)).max())
    if (rows @ step - bounds).max() > FEASIBLE * max(size, 1e-300):
        return None
    return np.asarray(step)
