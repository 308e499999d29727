"""The values at few knots to the last digit, without a sparse solver's fixed cost."""

from __future__ import annotations

import numpy as np

from planner.approximation.basis import basis_of
from planner.approximation.descent import best_values
from planner.approximation.objective import Problem, constraint_rows, slacks
from planner.approximation.requirements import held
from planner.trajectory import Array

PRESSED = 1e-9
"""Distance from a bound on a slope, in the unit of the samples, at which it is met exactly."""

KEPT = 1e-12
"""Excess over a bound that is left to the repair."""

SOFT = 1e-9
"""Regularisation of bounds that repeat one another, relative; refinements remove it."""


def small_values(problem: Problem, knots: Array) -> Array | None:
    """The best values at few knots: the active bounds found, then met as equations.

    Args:
        problem: What to approximate; samples of size one.
        knots: Knots, shape (K,), few enough for dense matrices, samples in every segment.

    Returns:
        Values, shape (K,); None where they cannot be trusted. Cost O(n + K³).
    """
    size = knots.size
    curve = best_values(problem, knots)
    free = np.flatnonzero(~held(problem, knots)[1])
    if free.size == 0:
        return curve.values
    rows = constraint_rows(size, problem.step, cyclic=problem.cyclic)
    bounds = slacks(problem, knots, curve.values)
    slopes = bounds.size * 2 // 3
    active = np.flatnonzero(bounds[:slopes] <= PRESSED)
    rows = rows[:slopes, size + free]
    basis = basis_of(problem, knots)
    moves = basis[:, free]
    weighed = problem.weights[:, None] * moves
    hessian = moves.T @ weighed
    weight = float(np.max(hessian.diagonal()))
    if float(np.min(hessian.diagonal())) <= 1e-9 * weight:  # a knot between samples
        return None
    system = np.zeros((free.size + active.size, free.size + active.size))
    system[: free.size, : free.size] = hessian / weight
    system[free.size :, : free.size] = rows[active]
    system[: free.size, free.size :] = rows[active].T
    system[free.size :, free.size :] = -SOFT * np.eye(active.size)
    values, pressure = curve.values.copy(), np.zeros(active.size)
    for _ in range(3):
        residual = basis @ values - problem.desired
        gradient = (residual @ weighed) / weight + pressure @ rows[active]
        lack = slacks(problem, knots, values)[active]
        try:
            move = np.linalg.solve(system, np.append(-gradient, lack))
        except np.linalg.LinAlgError:
            return None
        values[free] += move[: free.size]
        pressure += move[free.size :]
    if not np.all(np.isfinite(values)) or np.min(slacks(problem, knots, values)[:slopes]) < -KEPT:
        return None
    return values if np.all(pressure >= -PRESSED) else None
