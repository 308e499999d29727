"""Many curves downhill at once: the same as one by one."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.descent import best_values, descend
from planner.approximation.nudged import moved, nudged
from planner.approximation.objective import Problem, candidate, evaluate, slacks
from planner.approximation.together import (
    all_best_values,
    all_slacks,
    descend_all,
    evaluate_all,
)

SAME = 1e-9
"""Rounding of sums over some 60 samples of unit size, and of a few steps of Newton's."""


def problem_of(rng, *, cyclic, even=False):
    n = 60
    desired = np.sin(np.arange(n) / 7.0) + 0.1 * rng.normal(size=n)
    weights = np.ones(n) if even else rng.uniform(0.5, 1.5, size=n)
    return Problem(desired=desired, step=0.08, cyclic=cyclic, weights=weights)


def knots_of(rng, *, size, cyclic):
    knots = np.linspace(0.0, 54.0, size) + rng.uniform(0.0, 3.0, size=size)
    if cyclic:
        return np.sort(knots) + rng.uniform(-20.0, 30.0)
    return np.r_[0.0, knots[1:-1], 59.0]


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("size", [2, 3, 7])
def test_errors_and_derivatives_are_those_of_each_alone(size, cyclic):
    rng = np.random.default_rng(size)
    problem = problem_of(rng, cyclic=cyclic)
    knots = np.array([knots_of(rng, size=size, cyclic=cyclic) for _ in range(5)])
    values = rng.normal(size=(5, size))
    together = evaluate_all(problem, knots, values)
    limits = all_slacks(problem, knots, values)
    for row, (k, y) in enumerate(zip(knots, values, strict=True)):
        alone = evaluate(problem, k, y)
        assert together.errors[row] == pytest.approx(alone.error, rel=SAME)
        np.testing.assert_allclose(together.gradients[row], alone.gradient, atol=SAME)
        np.testing.assert_allclose(together.hessians[row], alone.hessian, atol=SAME)
        np.testing.assert_allclose(together.gauss_newton[row], alone.gauss_newton, atol=SAME)
        np.testing.assert_allclose(limits[row], slacks(problem, k, y), atol=SAME)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("cyclic", [True, False])
def test_descents_and_values_are_those_of_each_alone(cyclic, even):
    rng = np.random.default_rng(3)
    problem = problem_of(rng, cyclic=cyclic, even=even)
    knots = [knots_of(rng, size=5, cyclic=cyclic) for _ in range(6)]
    starts = all_best_values(problem, knots)
    for start, k in zip(starts, knots, strict=True):
        assert start.error == pytest.approx(best_values(problem, k).error, rel=SAME)
    ends = descend_all(problem, starts, rounds=6)
    for start, end in zip(starts, ends, strict=True):
        alone = descend(problem, start, rounds=6)
        assert end.error == pytest.approx(alone.error, rel=1e-6)
        assert end.error <= start.error * (1.0 + SAME)
        assert np.min(slacks(problem, end.knots, end.values)) >= -SAME


@pytest.mark.parametrize("cyclic", [True, False])
def test_moving_a_knot_along_the_curve_keeps_the_slopes_and_looking_around_helps(cyclic):
    rng = np.random.default_rng(11)
    problem = problem_of(rng, cyclic=cyclic)
    start = descend(problem, best_values(problem, knots_of(rng, size=6, cyclic=cyclic)), rounds=15)
    for other in moved(problem, start):
        assert np.count_nonzero(other.knots != start.knots) == 1
        assert np.min(slacks(problem, other.knots, other.values)) >= -SAME
    found = nudged(problem, start)
    assert found.error < start.error
    assert candidate(problem, found.knots, found.values).error == pytest.approx(found.error)
