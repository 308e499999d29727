"""The quadratic programmes against independent solvers; the exact repair."""

import cvxpy as cp
import numpy as np
import pytest

from planner.approximation import inner_loops
from planner.approximation.fit_problem import Problem, candidate
from planner.approximation.values import (
    attainable_error,
    best_values,
    slope_bounded,
)
from planner.arrays import steps
from tests.approximation.samples import KINDS, samples_of
from tests.from_python import from_python

evaluate = from_python(inner_loops.evaluate)
SOLVED = 1e-6  # what Clarabel leaves of a squared error or a largest error of about one


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
@pytest.mark.parametrize(("seed", "count"), [(0, 5), (1, 5), (2, 5), (3, 5), (4, 20), (5, 20)])
def test_values_at_given_knots_are_those_of_an_independent_solver(cyclic, step, seed, count):
    rng = np.random.default_rng(seed)
    desired = np.clip(np.cumsum(rng.normal(size=60)) / 8.0, -1.0, 1.0)
    problem = Problem(desired=desired, step=step, cyclic=cyclic)
    knots = np.sort(rng.choice(58, count, replace=False)) + rng.uniform(0.0, 1.0, count)
    if not cyclic:
        knots[[0, -1]] = 0.0, 59.0
    expected = on_the_reference_of(problem, knots)
    assert best_values(problem, knots).error == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("cyclic", [True, False])
def test_gradient_and_hessian_are_those_of_finite_differences(cyclic):
    rng = np.random.default_rng(0)
    problem = Problem(desired=rng.normal(size=40), step=1.0, cyclic=cyclic)
    at = np.r_[0.3, 7.2, 18.9, 30.4, 38.6, rng.normal(size=5)]
    error, gradient, hessian, _ = evaluate(problem, at)
    if cyclic:
        assert error == pytest.approx(candidate(problem, at[:5], at[5:]).error, rel=1e-12)
    for i, way in enumerate(1e-6 * np.eye(10)):
        ahead, behind = evaluate(problem, at + way), evaluate(problem, at - way)
        half = 0.5 * (ahead[0] - behind[0]) / 2e-6
        assert gradient[i] == pytest.approx(half, rel=1e-6, abs=1e-7)
        change = (ahead[1] - behind[1]) / 2e-6
        np.testing.assert_allclose(hessian[i], change, rtol=1e-6, atol=1e-6)


def programme(desired, step, cyclic, objective):
    angles = cp.Variable(desired.size)
    rises = cp.diff(cp.hstack([angles, angles[0]]) if cyclic else angles)
    error = cp.Problem(cp.Minimize(objective(angles - desired)), [cp.abs(rises) <= step])
    return error.solve(solver="CLARABEL")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", [1e-5, 0.02, 0.1, 10.0])
@pytest.mark.parametrize("cyclic", [True, False])
def test_the_ideal_is_the_least_squares_sequence_within_the_slopes(kind, step, cyclic):
    desired = samples_of(kind, 50, np.random.default_rng(1))
    ideal = slope_bounded(desired, step, cyclic=cyclic)
    assert np.all(np.abs(steps(ideal, cyclic=cyclic)) <= step * (1.0 + 1e-9) + 1e-8)
    expected = programme(desired, step, cyclic, cp.sum_squares)
    assert np.sum((ideal - desired) ** 2) == pytest.approx(expected, rel=SOLVED, abs=SOLVED)


@pytest.mark.parametrize("seed", range(4))
def test_every_sample_counts_by_its_own_weight(seed):
    rng = np.random.default_rng(seed)
    desired, weights = rng.normal(size=30), rng.choice([1.0, 5.0, 50.0], size=30)
    ideal = slope_bounded(desired, 0.2, cyclic=False, weights=weights)
    expected = programme(
        desired, 0.2, False, lambda error: cp.sum_squares(cp.multiply(np.sqrt(weights), error))
    )
    assert weights @ (ideal - desired) ** 2 == pytest.approx(expected, rel=SOLVED)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cyclic", [True, False])
def test_the_attainable_error_is_that_of_a_linear_programme(kind, cyclic):
    desired = samples_of(kind, 50, np.random.default_rng(2))
    expected = programme(desired, 0.03, cyclic, cp.norm_inf)
    assert attainable_error(desired, 0.03, cyclic=cyclic) == pytest.approx(expected, abs=SOLVED)
