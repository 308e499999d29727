"""The values at given knots that are best within the slopes: a convex QP, solved by OSQP.

    minimise  Σ_k (P(k) - D(k))²    subject to    |y' - y| <= v_max (k' - k) for every segment

The Hessian is tridiagonal, closed to a ring for a cycle. OSQP says which bounds are active and what
the values are to its tolerance; :func:`polished` makes them exact, and the repair in
:mod:`planner.approximation.repair` makes the bounds hold to the last digit.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.approximation.objective import Problem, segment_ends, sums_by
from planner.approximation.requirements import at_rest, held, keeping_pins
from planner.exceptions import SolverFailed
from planner.trajectory import Array

TOLERANCE = 1e-9
"""OSQP's tolerances, relative and absolute; the samples are of size one here."""

TRUSTED = 1e-6
"""Excess over a limit, in the unit of the samples, up to which an answer of OSQP is repaired."""

MOST_ITERATIONS, TUBE_ITERATIONS = 50_000, 5_000
"""Iterations of OSQP, and where another answer is at hand."""

RIDGE = 1e-11
"""Pull towards the previous values, relative, that makes knots without samples determinate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ValuesQP:
    """Minimise ½ yᵀPy + qᵀy subject to lower <= Ay <= upper.

    Attributes:
        P: Hessian, sparse, shape (K, K).
        q: Gradient at zero, shape (K,).
        A: Rise of every segment, the values that are required and, where errors are bounded, every
            sample's angle, sparse, shape (S + p, K) or (S + p + n, K).
        lower: Least values of them.
        upper: Largest values of them.
    """

    P: Any
    q: Array
    A: Any
    lower: Array
    upper: Array

    def cost(self, values: Array) -> float:
        """The objective."""
        return float(values @ (0.5 * (self.P @ values) + self.q))

    def excess(self, values: Array) -> float:
        """Largest violation of a limit, 0 if there is none."""
        rows = self.A @ values
        return float(np.max(np.maximum(self.lower - rows, rows - self.upper), initial=0.0))


def build_values_qp(
    problem: Problem, knots: Array, near: Array, tube: float | None = None
) -> ValuesQP:
    """The QP in the values at ``knots``, with a tiny pull towards ``near``.

    Args:
        problem: What to approximate.
        knots: Knots, shape (K,).
        near: Values towards which undetermined ones are pulled, shape (K,).
        tube: Largest error at any sample, if that is bounded.
    """
    from scipy import sparse

    size = knots.size
    start, end = segment_ends(size, cyclic=problem.cyclic)
    ends = np.append(knots, knots[0] + problem.samples) if problem.cyclic else knots
    index = np.arange(problem.samples, dtype=np.float64)
    if problem.cyclic:
        index = knots[0] + np.mod(index - knots[0], problem.samples)
    segment = np.clip(np.searchsorted(knots, index, side="right") - 1, 0, ends.size - 2)
    share = (index - knots[segment]) / np.diff(ends)[segment]
    rest = 1.0 - share

    def total(products: Array) -> Array:
        return sums_by(problem.weights * products, segment, start.size)

    s00, s01, s11 = total(rest * rest), total(rest * share), total(share * share)
    P = sparse.csc_matrix(
        (
            np.concatenate([s00, s01, s01, s11]),
            (
                np.concatenate([start, start, end, end]),
                np.concatenate([start, end, start, end]),
            ),
        ),
        shape=(size, size),
    )
    q = -sums_by(total(rest * problem.desired), start, size)
    q -= sums_by(total(share * problem.desired), end, size)
    ridge = RIDGE * float(P.diagonal().max())
    row, ones = np.arange(start.size), np.ones(start.size)
    A = sparse.csc_matrix(
        (np.append(-ones, ones), (np.append(row, row), np.append(start, end))),
        shape=(row.size, size),
    )
    upper = problem.step * np.diff(ends)
    lower = -upper
    _, pinned = held(problem, knots)
    if np.any(pinned):
        A = sparse.vstack([A, sparse.eye(size, format="csr")[pinned]], format="csc")
        pins = keeping_pins(problem, knots, near)[pinned]
        lower, upper = np.append(lower, pins), np.append(upper, pins)
    if tube is not None:
        sample = np.arange(problem.samples)
        places = np.append(sample, sample), np.append(start[segment], end[segment])
        basis = sparse.csc_matrix((np.append(rest, share), places), shape=(problem.samples, size))
        A = sparse.vstack([A, basis], format="csc")
        lower = np.append(lower, problem.desired - tube)
        upper = np.append(upper, problem.desired + tube)
    return ValuesQP(
        P=(P + ridge * sparse.eye(size)).tocsc(),
        q=q - ridge * near,
        A=A,
        lower=lower,
        upper=upper,
    )


def solve_values(
    problem: Problem, knots: Array, near: Array | None = None, *, tube: float | None = None
) -> Array:
    """The best values at ``knots``; slopes within the bound up to rounding and :data:`TRUSTED`.

    Args:
        problem: What to approximate; samples of size one or less.
        knots: Knots, shape (K,).
        near: Values from which OSQP starts and to which undetermined ones are pulled, shape (K,).
        tube: Largest error at any sample; ``near`` keeps it.

    Returns:
        Values, shape (K,). Cost O(n), and O(K) per iteration of OSQP.

    Raises:
        SolverFailed: OSQP stopped short.
    """
    if knots.size == 1:
        return at_rest(problem, knots)
    near = at_rest(problem, knots) if near is None else near
    qp = build_values_qp(problem, knots, near)
    values = _solved(problem, qp, near)
    if tube is None:
        return values
    tube_qp = build_values_qp(problem, knots, near, tube)
    if tube_qp.excess(values) <= 0.0:
        return values
    try:
        values = _solved(problem, tube_qp, near, iterations=TUBE_ITERATIONS)
    except SolverFailed:  # it is slow where the tube is tight; ``near`` is within it
        return near
    return values if tube_qp.excess(values) <= 1e-12 else near


def _solved(
    problem: Problem, qp: ValuesQP, near: Array, *, iterations: int = MOST_ITERATIONS
) -> Array:
    """OSQP's answer, polished and checked."""
    import osqp
    from scipy import sparse

    # In z with y = centre + unit z, as all rises are tiny where v_max is.
    centre = float(np.mean(near))
    unit = min(1.0, problem.step * problem.samples)
    offset = np.full(near.size, centre)
    q = (qp.P @ offset + qp.q) / unit
    rows = qp.A @ offset
    scale = float(max(qp.P.diagonal().max(), np.max(np.abs(q))))
    solver = osqp.OSQP(algebra="builtin")
    solver.setup(
        sparse.triu(qp.P / scale, format="csc"),
        q / scale,
        qp.A,
        (qp.lower - rows) / unit,
        (qp.upper - rows) / unit,
        eps_abs=TOLERANCE,
        eps_rel=TOLERANCE,
        max_iter=iterations,
        polishing=False,  # OSQP's own prints when no bound is active
        verbose=False,
    )
    solver.warm_start(x=(near - centre) / unit)
    result = solver.solve(raise_error=False)
    values = centre + unit * np.asarray(result.x, dtype=np.float64)
    status = str(result.info.status)
    logging.getLogger(__name__).debug(
        "values at %d knots: OSQP says %s after %d iterations",
        near.size,
        status,
        result.info.iter,
    )
    if not (status.startswith("solved") and np.all(np.isfinite(values))):
        raise SolverFailed("values at the knots, OSQP", status)
    values = polished(qp, values, np.asarray(result.y, dtype=np.float64))
    if qp.excess(values) > TRUSTED:
        raise SolverFailed("values at the knots, OSQP", status, violation=qp.excess(values))
    return values


def polished(qp: ValuesQP, values: Array, multipliers: Array) -> Array:
    """The minimiser with the active bounds of ``values`` as equations, if it is at least as good.

    Args:
        qp: The QP.
        values: A solution to some tolerance, shape (K,).
        multipliers: Of the bounds, positive at the upper ones.

    Returns:
        Values, shape (K,).
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu

    pressed = np.abs(multipliers) > 1e-9 * np.max(np.abs(multipliers), initial=0.0)
    active = np.flatnonzero(pressed | (qp.lower == qp.upper))
    target = np.where(multipliers > 0.0, qp.upper, qp.lower)[active]
    rows = qp.A[active, :]
    # A touch of regularisation for bounds that repeat one another; two refinements remove it.
    lower = -1e-9 * sparse.eye(active.size)
    system = sparse.bmat([[qp.P, rows.T], [rows, None if active.size == 0 else lower]], "csc")
    exact = np.append(np.zeros(qp.q.size), np.zeros(active.size))
    try:
        factor = splu(system)
    except RuntimeError:  # singular
        return values
    for _ in range(3):
        y, u = exact[: qp.q.size], exact[qp.q.size :]
        residual = np.append(-qp.q - qp.P @ y - rows.T @ u, target - rows @ y)
        exact = exact + factor.solve(residual)
    better = exact[: qp.q.size]
    if qp.excess(better) > max(qp.excess(values), 1e-12):
        return values
    return better
