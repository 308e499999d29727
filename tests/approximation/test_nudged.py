"""Knots in the hollows of the squared error, which lie at samples."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.nudged import in_hollows, moved, nudged
from planner.approximation.objective import Problem, candidate

TENT = np.interp(np.arange(21.0), [0.0, 10.0, 20.0], [0.0, 1.0, 0.0])
"""A corner at sample 10."""


def tent_with(at_corner, knot):
    """The tent with its middle sample moved, and a curve whose knot is near it."""
    desired = TENT.copy()
    desired[10] = at_corner
    problem = Problem(desired=desired, step=1.0, cyclic=False)
    return problem, candidate(problem, np.array([0.0, knot, 20.0]), np.array([0.0, 1.0, 0.0]))


def test_a_knot_next_to_a_hollow_is_put_into_it_and_stays():
    # The curve bends down and lies below the sample: a step to either side costs at once.
    problem, curve = tent_with(1.5, 10.05)
    here, still = in_hollows(problem, curve)
    np.testing.assert_array_equal(here.knots, [0.0, 10.0, 20.0])
    np.testing.assert_array_equal(still, [False, True, False])


@pytest.mark.parametrize(("at_corner", "knot"), [(0.5, 10.05), (1.5, 10.3)])
def test_a_knot_on_a_ridge_or_far_from_a_sample_is_free(at_corner, knot):
    problem, curve = tent_with(at_corner, knot)
    here, still = in_hollows(problem, curve)
    assert here is curve
    assert not np.any(still)


def test_a_hollow_too_near_another_knot_is_left_alone():
    problem, _ = tent_with(1.5, 10.05)
    knots = np.array([0.0, 10.05, 11.05, 20.0])
    curve = candidate(problem, knots, np.array([0.0, 1.0, 0.9, 0.0]))
    here, still = in_hollows(problem, curve)
    assert np.min(np.diff(here.knots)) >= problem.shortest - 1e-9
    assert still.shape == knots.shape


def test_moves_keep_the_ends_and_the_shortest_segment():
    problem, curve = tent_with(1.0, 1.5)
    for each in moved(problem, curve):
        assert each.knots[0] == 0.0
        assert each.knots[-1] == 20.0
        assert np.min(np.diff(each.knots)) >= 1.0 - 1e-9


def test_a_nudged_curve_is_never_worse():
    problem, curve = tent_with(1.0, 7.0)
    assert nudged(problem, curve).error <= curve.error
