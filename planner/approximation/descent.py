"""Knots and values together, from a start downhill: sequential quadratic programmes.

Slope bounds and lengths are linear in knots and values together, so every iterate keeps them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from planner.approximation.basis import basis_of
from planner.approximation.objective import (
    Candidate,
    Iterate,
    Problem,
    candidate,
    constraint_rows,
    evaluate,
    slacks,
)
from planner.approximation.requirements import at_rest, held
from planner.approximation.small_qp import minimize_damped, minimize_quadratic
from planner.trajectory import Array

LARGEST_WINDOW = 16
"""Most knots that are moved together; of more, windows of so many are moved in turn."""

PROGRESS = 1e-7
"""Relative decrease of the squared error below which a descent ends."""

EXACT = 1e-26
"""Squared error, relative to the sum of squares of the samples, that counts as none."""


def best_values(problem: Problem, knots: Array) -> Candidate:
    """The values at given knots that are best within the slopes: one convex QP.

    Args:
        problem: What to approximate.
        knots: Knots, shape (K,), at most ``LARGEST_WINDOW`` of them.

    Returns:
        The curve; a constant if the QP was not solved.
    """
    rest = at_rest(problem, knots)
    free = ~held(problem, knots)[1]
    basis = basis_of(problem, knots)
    residual = basis @ rest - problem.desired
    weighed = problem.weights * residual
    moves = basis[:, free]
    hessian = moves.T @ (problem.weights[:, None] * moves)
    variable = np.flatnonzero(free) + knots.size
    ridge = 1e-10 * np.max(hessian.diagonal(), initial=0.0) * np.eye(variable.size)
    slopes = slacks(problem, knots, rest)
    slopes = slopes[: slopes.size * 2 // 3]
    rows = constraint_rows(knots.size, problem.step, cyclic=problem.cyclic)
    rows = rows[: slopes.size, variable]
    gradient = weighed @ moves
    step = minimize_quadratic(hessian + ridge, gradient, rows, np.maximum(slopes, 0.0))
    if step is None:
        return Candidate(knots, rest, float(residual @ weighed))
    values = rest.copy()
    values[free] += step
    residual = residual + moves @ step
    return Candidate(knots, values, float(residual @ (problem.weights * residual)))


def descend(
    problem: Problem,
    start: Candidate,
    *,
    rounds: int,
    only: npt.NDArray[np.bool_] | None = None,
    hold: npt.NDArray[np.bool_] | None = None,
) -> Candidate:
    """Move knots and values downhill until there is no progress; the ends of a path stay.

    Args:
        problem: What to approximate.
        start: Where to start, within the slopes.
        rounds: Most evaluations.
        only: Samples, shape (n,): of many knots, those in no window with one of them stay.
        hold: Knots that stay, shape (K,), besides those that must.

    Returns:
        The best curve found; never worse than the start.
    """
    fixed = np.concatenate(held(problem, start.knots))
    if hold is not None:
        fixed[: hold.size] |= hold
    if start.knots.size > LARGEST_WINDOW:
        return _sweep(problem, start, fixed=fixed, rounds=rounds, only=only)
    free = ~fixed
    if not np.any(free):
        return start
    return _descend(problem, start, free=free, rounds=rounds)


def _sweep(
    problem: Problem,
    start: Candidate,
    *,
    fixed: npt.NDArray[np.bool_],
    rounds: int,
    only: npt.NDArray[np.bool_] | None,
) -> Candidate:
    """Move one window of knots after the other, each between knots that stay."""
    size, n = start.knots.size, problem.samples
    knots, values = start.knots.copy(), start.values.copy()
    for first in range(0, size if problem.cyclic else size - 2, LARGEST_WINDOW // 2):
        last = first + LARGEST_WINDOW - 1
        if not problem.cyclic:
            last = min(last, size - 1)
        number = np.arange(first, last + 1)
        places = knots[number % size] + n * (number // size)
        low, high = math.ceil(places[0]), math.floor(places[-1])
        inside = np.arange(low, high + 1) % n
        if only is not None and not np.any(only[inside]):
            continue
        window = replace(
            problem,
            desired=problem.desired[inside],
            weights=problem.weights[inside],
            cyclic=False,
        )
        free = ~np.concatenate([fixed[number % size], fixed[size + number % size]])
        free[[0, number.size - 1]] = False
        if problem.cyclic or first > 0:
            free[number.size] = False
        if problem.cyclic or last < size - 1:
            free[-1] = False
        before = candidate(window, places - low, values[number % size])
        after = _descend(window, before, free=free, rounds=rounds)
        knots[number % size] = after.knots + low - n * (number // size)
        values[number % size] = after.values
    return candidate(problem, knots, values)


def _descend(
    problem: Problem, start: Candidate, *, free: npt.NDArray[np.bool_], rounds: int
) -> Candidate:
    """Newton's method on the free variables, damped until it goes down."""
    size = start.knots.size
    here = evaluate(problem, start.knots, start.values)
    rows = constraint_rows(size, problem.step, cyclic=problem.cyclic)[:, free]
    cells = np.ix_(free, free)
    none = EXACT * float(problem.desired @ problem.desired)
    damping = 1e-3
    for _ in range(rounds):
        if here.error <= none:
            break
        step, damping, promised = minimize_damped(
            here.hessian[cells],
            _scale(here)[free],
            damping,
            here.gradient[free],
            rows,
            np.maximum(slacks(problem, here.knots, here.values), 0.0),
        )
        if step is None:
            damping *= 10.0
            continue
        move = np.zeros(2 * size)
        move[free] = step
        there = evaluate(problem, here.knots + move[:size], here.values + move[size:])
        gain = here.error - there.error
        if gain > 0.0:
            here = there
            if gain <= PROGRESS * here.error and damping < 1.0:
                break
        elif promised <= PROGRESS * here.error:
            break
        damping *= 0.2 if gain > 0.5 * promised else 0.7 if gain > 0.0 else 6.0
    return Candidate(here.knots, here.values, here.error)


def _scale(here: Iterate) -> Array:
    """Curvature of each variable, against which damping is measured."""
    size = here.knots.size
    own = here.gauss_newton.copy()
    by_value = float(own[size:].sum()) / size
    by_knot = float(own[:size].sum()) / size
    own[:size] += 1e-2 * by_knot + 1e-12 * by_value
    own[size:] += 1e-6 * by_value
    return own
