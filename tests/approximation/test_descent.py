"""Descents; the squared error and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation import kernel
from planner.approximation.problem import Problem, candidate
from planner.approximation.values import best_values, descend
from tests.from_python import from_python

constraints = from_python(kernel.constraints)
evaluate = from_python(kernel.evaluate)

SAME = 1e-9
"""Rounding of sums over some 60 samples of unit size, and of a few steps of Newton's."""


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
