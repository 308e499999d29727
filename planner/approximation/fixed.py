"""Knots that are given: the values alone are sought, a convex programme."""

from __future__ import annotations

import numpy as np

from planner.approximation.objective import Problem, candidate, residuals
from planner.approximation.repair import within_slopes
from planner.approximation.requirements import at_rest
from planner.approximation.values import build_values_qp, solve_values
from planner.exceptions import Infeasible, SolverFailed
from planner.trajectory import Array

BARELY = 1e-9
"""Relative distance from a bound on the error that rounding cannot cross."""


def best_at(problem: Problem, knots: Array, bound: float | None, unit: float) -> Array:
    """The best values at given knots, with no error above ``bound`` if there is one.

    Args:
        problem: What to approximate, samples of size one.
        knots: Knots, shape (K,).
        bound: Largest error at any sample, if that is bounded.
        unit: Unit of the samples [rad], for the message.

    Returns:
        Values, shape (K,).

    Raises:
        Infeasible: These knots cannot keep the bound; names the two samples that show it.
        SolverFailed: A solver stopped short.
    """
    values = solve_values(problem, knots, at_rest(problem, knots))
    if bound is None or np.max(np.abs(residuals(problem, knots, values))) <= bound:
        return values
    closest, pair = closest_at(problem, knots)
    least = float(np.max(np.abs(residuals(problem, knots, closest))))
    if least > bound * (1.0 + BARELY):
        raise Infeasible(
            f"knots and max_error: with these knots samples {pair[0]} and {pair[1]} cannot both be "
            f"kept within {bound * unit:.6g} rad, the smallest largest error is "
            f"{least * unit:.6g} rad; add a knot near them or allow more error"
        )
    return solve_values(problem, knots, closest, tube=max(bound, least) * (1.0 - 0.5 * BARELY))


def closest_at(problem: Problem, knots: Array) -> tuple[Array, tuple[int, int]]:
    """Values with the smallest largest error, a linear programme, and two samples that bind it."""
    from scipy import sparse
    from scipy.optimize import linprog

    near = at_rest(problem, knots)
    qp = build_values_qp(problem, knots, near, tube=0.0)
    n, size = problem.samples, knots.size
    basis, others = qp.A[-n:], qp.A[:-n]
    both = sparse.vstack([basis, -basis, others, -others])
    allowance = np.append(-np.ones(2 * n), np.zeros(2 * others.shape[0]))  # the error, of samples
    rows = sparse.hstack([both, sparse.csr_array(allowance[:, np.newaxis])])
    limits = np.concatenate([problem.desired, -problem.desired, qp.upper[:-n], -qp.lower[:-n]])
    result = linprog(
        np.append(np.zeros(size), 1.0),
        A_ub=rows.tocsr(),
        b_ub=limits,
        bounds=[(None, None)] * size + [(0.0, None)],
        method="highs",
    )
    if result.x is None:
        raise SolverFailed("largest error at given knots, HiGHS", str(result.message))
    ends = np.append(knots, knots[0] + n) if problem.cyclic else knots
    limits = problem.step * np.diff(ends)
    values = within_slopes(result.x[:size], limits, cyclic=problem.cyclic, towards=near)
    pressed = np.abs(result.ineqlin.marginals[: 2 * n]).reshape(2, n).sum(axis=0)
    first, second = sorted(np.argsort(-pressed, kind="stable")[:2].tolist())
    return candidate(problem, knots, values).values, (first, second)
