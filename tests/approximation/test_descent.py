"""Descents, alone and many at once; the squared error and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.descent import best_values, constraint_rows, descend, evaluate, slacks
from planner.approximation.problem import Problem, candidate
from planner.approximation.search import moved, with_moved_knots

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


@pytest.mark.parametrize("cyclic", [True, False])
def test_descents_and_values_are_those_of_each_alone(cyclic):
    rng = np.random.default_rng(3)
    problem = problem_of(rng, cyclic=cyclic)
    knots = [knots_of(rng, size=5, cyclic=cyclic) for _ in range(6)]
    starts = best_values(problem, knots)
    for start, k in zip(starts, knots, strict=True):
        assert start.error == pytest.approx(best_values(problem, [k])[0].error, rel=SAME)
    ends = descend(problem, starts, rounds=6)
    for start, end in zip(starts, ends, strict=True):
        alone = descend(problem, [start], rounds=6)[0]
        assert end.error == pytest.approx(alone.error, rel=1e-6)
        assert end.error <= start.error * (1.0 + SAME)
        assert np.min(slacks(problem, end.knots, end.values)) >= -SAME


@pytest.mark.parametrize("cyclic", [True, False])
def test_moving_a_knot_along_the_curve_keeps_the_slopes_and_moving_helps(cyclic):
    rng = np.random.default_rng(11)
    problem = problem_of(rng, cyclic=cyclic)
    [start] = descend(
        problem, best_values(problem, [knots_of(rng, size=6, cyclic=cyclic)]), rounds=15
    )
    for other in moved(problem, start):
        assert np.count_nonzero(other.knots != start.knots) == 1
        assert np.min(slacks(problem, other.knots, other.values)) >= -SAME
    found = with_moved_knots(problem, [start])
    assert found.error < start.error
    assert candidate(problem, found.knots, found.values).error == pytest.approx(found.error)


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
