"""The quadratic programmes against independent solvers; the exact repair."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.approximation import kernel
from planner.approximation.problem import Problem, candidate
from planner.approximation.values import best_values, solve_values, within_slopes
from tests.from_python import from_python

minimise_damped = from_python(kernel.minimise_damped)


def on_the_reference_of(problem, knots):
    """Squared error of the best values, by cvxpy with Clarabel."""
    n, size = problem.samples, knots.size
    index = np.arange(n, dtype=float)
    basis = np.empty((n, size))
    for k, hat in enumerate(np.eye(size)):
        period = n if problem.cyclic else None
        basis[:, k] = np.interp(index, knots, hat, period=period)
    values = cp.Variable(size)
    ends = np.append(knots, knots[0] + n) if problem.cyclic else knots
    rises = cp.diff(cp.hstack([values, values[0]]) if problem.cyclic else values)
    bounds = [cp.abs(rises) <= problem.step * np.diff(ends)]
    program = cp.Problem(cp.Minimize(cp.sum_squares(basis @ values - problem.desired)), bounds)
    return program.solve(solver="CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("step", [0.01, 0.05, 10.0])
@pytest.mark.parametrize("seed", range(4))
def test_values_at_given_knots_are_those_of_an_independent_solver(cyclic, step, seed):
    rng = np.random.default_rng(seed)
    desired = np.clip(np.cumsum(rng.normal(size=60)) / 8.0, -1.0, 1.0)
    problem = Problem(desired=desired, step=step, cyclic=cyclic)
    knots = np.sort(rng.choice(58, 5, replace=False)) + rng.uniform(0.0, 1.0, 5)
    if not cyclic:
        knots[[0, -1]] = 0.0, 59.0
    expected = on_the_reference_of(problem, knots)
    for values in (solve_values(problem, knots), best_values(problem, knots).values):
        assert candidate(problem, knots, values).error == pytest.approx(expected, rel=1e-6)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=8), st.floats(1e-9, 1e3), st.booleans())
def test_repaired_values_keep_every_limit_in_floating_point(values, limit, cyclic):
    values, knots = np.array(values), 2.0 * np.arange(len(values))
    problem = Problem(desired=np.zeros(2 * values.size), step=limit, cyclic=cyclic)
    repaired = within_slopes(problem, knots, values)
    rises = np.diff(np.append(repaired, repaired[0]) if cyclic else repaired)
    assert np.all(np.abs(rises) <= 2.0 * limit * (1.0 + 1e-12))


def undamped_step(hessian, gradient, rows, bounds):
    """The step of one small QP, None where none was found."""
    free, scales = np.ones(gradient.size, dtype=bool), np.zeros(gradient.size)
    step, solved, _ = minimise_damped(hessian, gradient, rows, bounds, free, scales, 1.0)
    return step if solved else None


@pytest.mark.parametrize("seed", range(8))
def test_the_small_qp_is_solved_like_an_independent_solver_does(seed):
    rng = np.random.default_rng(seed)
    root, rows = rng.normal(size=(6, 6)), rng.normal(size=(9, 6))
    hessian, gradient = root @ root.T + 0.1 * np.eye(6), 3.0 * rng.normal(size=6)
    bounds = rng.uniform(0.0, 0.5, size=9) * (rng.random(9) < 0.7)
    step = undamped_step(hessian, gradient, rows, bounds)
    x = cp.Variable(6)
    cost = 0.5 * cp.quad_form(x, cp.psd_wrap(hessian)) + gradient @ x
    expected = cp.Problem(cp.Minimize(cost), [rows @ x <= bounds]).solve(solver="CLARABEL")
    assert np.all(rows @ step <= bounds + 1e-9)
    assert 0.5 * step @ hessian @ step + gradient @ step == pytest.approx(expected, abs=1e-7)
