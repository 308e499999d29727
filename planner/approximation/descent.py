"""Knots and values together, from a start downhill: sequential quadratic programmes.

Slope bounds and lengths are linear in knots and values together, so every iterate keeps them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.approximation.objective import Iterate, Problem, constraints, evaluate
from planner.approximation.small_qp import minimize_quadratic
from planner.trajectory import Array

LARGEST_WINDOW = 16
"""Most knots that are moved together; of more, windows of so many are moved in turn."""

PROGRESS = 1e-7
"""Relative decrease of the squared error below which a descent ends."""

EXACT = 1e-26
"""Squared error per sample, relative to the size of the samples squared, that counts as none."""


def best_values(problem: Problem, knots: Array, near: Array | None = None) -> Array:
    """The values at given knots that are best within the slopes: one convex QP.

    Args:
        problem: What to approximate.
        knots: Knots, shape (K,), at most ``LARGEST_WINDOW`` of them.
        near: Values within the slopes to fall back to; by default a constant.

    Returns:
        Values, shape (K,).
    """
    size = knots.size
    start = np.full(size, float(np.mean(problem.desired))) if near is None else near
    here = evaluate(problem, knots, start)
    rows, bounds = constraints(problem, knots, start)
    hessian = here.gauss_newton[size:, size:]
    hessian = hessian + 1e-10 * np.max(np.diag(hessian)) * np.eye(size)
    slopes = bounds.size * 2 // 3
    step = minimize_quadratic(
        hessian, here.gradient[size:], rows[:slopes, size:], np.maximum(bounds[:slopes], 0.0)
    )
    return start if step is None else start + step


def descend(
    problem: Problem, knots: Array, values: Array, *, free: npt.NDArray[np.bool_], rounds: int
) -> Iterate:
    """Move knots and values downhill until there is no progress.

    Args:
        problem: What to approximate.
        knots: Knots to start from, shape (K,).
        values: Values to start from, within the slopes, shape (K,).
        free: Which of the knots, then of the values, may move, shape (2K,).
        rounds: Most evaluations.

    Returns:
        The best curve found; never worse than the start.
    """
    size = knots.size
    here = evaluate(problem, knots, values)
    none = EXACT * float(problem.desired @ problem.desired)
    damping = 1e-3
    for _ in range(rounds):
        if here.error <= none:
            break
        rows, bounds = constraints(problem, here.knots, here.values)
        diagonal = _scale(here)
        hessian = here.gauss_newton + here.curvature + damping * np.diag(diagonal)
        step = minimize_quadratic(
            hessian[np.ix_(free, free)],
            here.gradient[free],
            rows[:, free],
            np.maximum(bounds, 0.0),
        )
        if step is None:
            damping *= 10.0
            continue
        move = np.zeros(2 * size)
        move[free] = step
        there = evaluate(problem, here.knots + move[:size], here.values + move[size:])
        gain = here.error - there.error
        promised = -2.0 * float(here.gradient @ move) - float(move @ hessian @ move)
        if gain > 0.0:
            here = there
            if gain <= PROGRESS * here.error and damping < 1.0:
                break
        elif promised <= PROGRESS * here.error:
            break
        damping *= 0.2 if gain > 0.5 * promised else 0.7 if gain > 0.0 else 6.0
    return here


def _scale(here: Iterate) -> Array:
    """Curvature of each variable, against which damping is measured."""
    size = here.knots.size
    own = np.diag(here.gauss_newton).copy()
    by_value = float(np.mean(own[size:]))
    by_knot = float(np.mean(own[:size]))
    own[:size] += 1e-2 * by_knot + 1e-12 * by_value
    own[size:] += 1e-6 * by_value
    return own
