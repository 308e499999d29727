"""Many curves downhill at once: the same as one by one."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.knot_search import moved, with_moved_knots
from planner.approximation.least_squares import slacks
from planner.approximation.problem import Problem, candidate
from planner.approximation.sqp import best_values, descend

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
