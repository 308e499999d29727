"""The squared error, its derivatives and its constraints, against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.least_squares import constraint_rows, evaluate, slacks
from planner.approximation.problem import Problem, candidate


@pytest.mark.parametrize("cyclic", [True, False])
def test_gradient_and_hessian_are_those_of_finite_differences(cyclic):
    rng = np.random.default_rng(0)
    problem = Problem(desired=rng.normal(size=40), step=1.0, cyclic=cyclic)
    at = np.r_[0.3, 7.2, 18.9, 30.4, 38.6, rng.normal(size=5)]
    here = evaluate(problem, at[None, :5], at[None, 5:])
    if cyclic:
        assert here.errors[0] == pytest.approx(candidate(problem, at[:5], at[5:]).error, rel=1e-12)
    for i, way in enumerate(1e-6 * np.eye(10)):
        ahead = evaluate(problem, *np.split((at + way)[None], 2, axis=1))
        behind = evaluate(problem, *np.split((at - way)[None], 2, axis=1))
        half = 0.5 * (ahead.errors[0] - behind.errors[0]) / 2e-6
        assert here.gradients[0, i] == pytest.approx(half, rel=1e-6, abs=1e-7)
        change = (ahead.gradients[0] - behind.gradients[0]) / 2e-6
        np.testing.assert_allclose(here.hessians[0, i], change, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_step_along_the_rows_uses_up_the_slacks(cyclic):
    rng = np.random.default_rng(1)
    problem = Problem(desired=np.zeros(40), step=0.7, cyclic=cyclic)
    knots, values = np.array([1.0, 9.0, 20.0, 33.0]), rng.normal(size=4)
    step = rng.normal(size=8)
    expected = (
        slacks(problem, knots, values) - constraint_rows(4, problem.step, cyclic=cyclic) @ step
    )
    moved = slacks(problem, knots + step[:4], values + step[4:])
    np.testing.assert_allclose(moved, expected, atol=1e-12)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("size", [2, 3, 7])
def test_many_curves_are_evaluated_as_each_alone(size, cyclic):
    rng = np.random.default_rng(size)
    problem = Problem(desired=rng.normal(size=60), step=0.08, cyclic=cyclic)
    knots = np.sort(rng.uniform(0.0, 57.0, size=(5, size)) + np.arange(size))
    knots[:, -1] += 1.0
    if not cyclic:
        knots[:, [0, -1]] = 0.0, 59.0
    values = rng.normal(size=(5, size))
    together = evaluate(problem, knots, values)
    for row in range(5):
        alone = evaluate(problem, knots[[row]], values[[row]])
        for many, one in zip(together, alone, strict=True):
            np.testing.assert_allclose(many[row], one[0], rtol=1e-9, atol=1e-9)
