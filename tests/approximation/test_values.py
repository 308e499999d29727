"""The quadratic programmes against independent solvers; the exact repair."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.approximation import inner_loops
from planner.approximation.fit_problem import Problem, candidate
from planner.approximation.inner_loops import segment_costs
from planner.approximation.values import (
    attainable_error,
    best_values,
    descend,
    slope_bounded,
    within_slopes,
)
from planner.trajectory import steps
from tests.approximation.samples import KINDS, samples_of
from tests.from_python import from_python

minimise_damped = from_python(inner_loops.minimise_damped)


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


constraints = from_python(inner_loops.constraints)
evaluate = from_python(inner_loops.evaluate)

SAME = 1e-9  # rounding of sums over some 60 samples of unit size, and of a few steps of Newton's


def problem_of(rng, *, cyclic):
    n = 60
    desired = np.sin(np.arange(n) / 7.0) + 0.1 * rng.normal(size=n)
    return Problem(desired=desired, step=0.08, cyclic=cyclic)


def knots_of(rng, *, size, cyclic):
    knots = np.linspace(0.0, 54.0, size) + rng.uniform(0.0, 3.0, size=size)
    if cyclic:
        return np.sort(knots) + rng.uniform(-20.0, 30.0)
    return np.r_[0.0, knots[1:-1], 59.0]


def slacks_of(problem, curve):
    rows, limits = constraints(problem, curve.knots.size)
    return limits - rows @ np.append(curve.knots, curve.values)


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_descent_keeps_the_slopes_and_is_never_worse(cyclic):
    rng = np.random.default_rng(3)
    problem = problem_of(rng, cyclic=cyclic)
    for _ in range(6):
        start = best_values(problem, knots_of(rng, size=5, cyclic=cyclic))
        end = descend(problem, start, rounds=6)
        assert end.error <= start.error * (1.0 + SAME)
        assert end.error == pytest.approx(candidate(problem, end.knots, end.values).error, rel=SAME)
        assert np.min(slacks_of(problem, end)) >= -SAME


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_descent_between_knots_that_stay_moves_the_others(cyclic):
    rng = np.random.default_rng(5)
    knots = knots_of(rng, size=6, cyclic=cyclic)
    problem = problem_of(rng, cyclic=cyclic)
    required = np.sort(np.mod(knots[[1, 2]], 60.0))
    problem = problem._replace(required=required, pins=np.full(2, np.nan))
    start = best_values(problem, knots)
    end = descend(problem, start, rounds=8)
    assert np.array_equal(end.knots[1:3], knots[1:3])
    assert end.error < 0.999 * start.error


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


@pytest.mark.parametrize("cyclic", [True, False])
def test_the_conditions_are_those_on_slopes_and_lengths(cyclic):
    rng = np.random.default_rng(1)
    problem = Problem(desired=rng.normal(size=40), step=0.7, cyclic=cyclic)
    knots, values = np.array([1.0, 9.0, 20.0, 33.0]), rng.normal(size=4)
    lengths = np.diff(problem.ends(knots))
    rises = np.diff(np.append(values, values[0]) if cyclic else values)
    expected = np.r_[0.7 * lengths - rises, 0.7 * lengths + rises, lengths - 1.0]
    slacks = slacks_of(problem, candidate(problem, knots, values))
    np.testing.assert_allclose(slacks, expected, atol=1e-12)


STEP = 0.3
NODES = np.array([0, 2, 3, 6, 9])


def squared_error(desired, start, end, at_start, slope):
    """Of a line over the samples after its start."""
    k = np.arange(1, end - start + 1)
    return float(np.sum((at_start + slope * k - desired[start + 1 : end + 1]) ** 2))


@pytest.mark.parametrize("seed", range(6))
def test_a_chord_costs_its_squared_error_where_it_is_not_too_steep_nor_passes_a_knot(seed):
    rng = np.random.default_rng(seed)
    desired, fixed = rng.normal(scale=0.5, size=10), rng.random(len(NODES)) < 0.3
    values = desired[NODES] + 0.1 * np.arange(len(NODES))
    costs = segment_costs(desired, STEP, NODES, values, fixed)
    for i, j in np.ndindex(costs.shape):
        start, end, expected = NODES[i], NODES[j], np.inf
        if (
            j > i
            and not fixed[i + 1 : j].any()
            and abs(slope := (values[j] - values[i]) / (end - start)) <= STEP
        ):
            expected = squared_error(desired, start, end, values[i], slope)
        assert costs[j, i] == pytest.approx(expected, abs=1e-12)


SOLVED = 1e-6  # what Clarabel leaves of a squared error or a largest error of about one


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
