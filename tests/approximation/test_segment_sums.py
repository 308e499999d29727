"""Errors from running sums against the QP in the values, knots picked, moved and exchanged."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.climbing import climbed, picked
from planner.approximation.descent import best_values
from planner.approximation.every import best_sets, of_every_set, within_reach
from planner.approximation.exchanged import exchanged, exchanges
from planner.approximation.objective import Problem
from planner.approximation.segment_sums import SegmentSums
from planner.approximation.whole import WholeKnots
from tests.approximation.samples import KINDS, samples_of

SAME = 1e-9
"""Relative difference that is left to the QP's ridge and to rounding."""


def problem_of(kind, cyclic, step, n=44):
    """A problem with weights of its own."""
    rng = np.random.default_rng(KINDS.index(kind))
    weights = rng.uniform(0.5, 1.5, size=n)
    return Problem(
        desired=samples_of(kind, n, rng),
        step=step,
        cyclic=cyclic,
        weights=weights / np.mean(weights),
    )


def error_of(problem, knots):
    """Squared error of the best values at these knots, from running sums."""
    sums = SegmentSums(problem)
    ends = np.append(knots, knots[0] + problem.samples) if problem.cyclic else knots
    return sums.square - float(sums.gains(sums.pieces(ends[:-1], ends[1:])))


@pytest.mark.parametrize("step", [0.02, 0.1, 100.0])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("cyclic", "knots"),
    [(True, [3.3, 20.0]), (True, [0.0, 17.25, 30.5]), (False, [0.0, 19.6, 43.0])],
)
def test_two_free_slopes_within_their_bounds_cost_what_the_qp_says(cyclic, knots, kind, step):
    problem = problem_of(kind, cyclic, step)
    knots = np.array(knots)
    expected = best_values(problem, knots).error
    assert error_of(problem, knots) == pytest.approx(expected, rel=SAME, abs=SAME)


@pytest.mark.parametrize("kind", KINDS)
def test_more_slopes_of_a_path_are_free(kind):
    knots = np.array([0.0, 8.5, 19.6, 30.0, 43.0])
    expected = best_values(problem_of(kind, False, 1e3), knots).error
    assert error_of(problem_of(kind, False, 1e-3), knots) == pytest.approx(
        expected, rel=SAME, abs=SAME
    )


@pytest.mark.parametrize(("cyclic", "segments"), [(True, 2), (False, 2), (False, 3)])
def test_no_set_of_knots_on_samples_is_better_than_the_first(cyclic, segments):
    problem = problem_of("walk", cyclic, 0.2 if segments == 2 else 100.0)
    sets, least = best_sets(problem, segments)
    whole = WholeKnots(problem)
    rng = np.random.default_rng(1)
    for _ in range(200):
        inner = segments if cyclic else segments - 1
        knots = np.sort(rng.choice(np.arange(1, 43), inner, replace=False)).astype(float)
        other = whole.curve(knots if cyclic else np.r_[0.0, knots, 43.0])
        assert least <= other.error * (1.0 + SAME)
    assert best_values(problem, sets[0]).error == pytest.approx(least, rel=SAME)


def test_slopes_that_bind_a_path_of_three_are_left_to_others():
    problem = problem_of("sines", False, 0.01)
    assert of_every_set(problem, 3) is None
    assert within_reach(problem, 2, 1.0)
    assert not within_reach(problem, 3, 1.0)


@pytest.mark.parametrize("cyclic", [True, False])
def test_climbing_never_loses_and_keeps_the_shortest_length(cyclic):
    problem = problem_of("noise", cyclic, 100.0)
    sums = SegmentSums(problem)
    ends = np.array([0.0, 15.0, 16.0, 44.0 if cyclic else 43.0])
    before = float(sums.gains(sums.pieces(ends[:-1], ends[1:])))
    sets, gains = climbed(sums, ends[None], (2.0, 1.0, 0.5))
    assert gains[0] > before
    assert np.min(np.diff(sets[0])) >= 1.0


def test_sets_that_are_picked_are_apart_and_the_best_is_first():
    sets = np.array([[0.0, 5.0, 20.0], [0.0, 6.0, 20.0], [0.0, 12.0, 20.0]])
    np.testing.assert_array_equal(picked(sets, np.array([1.0, 3.0, 2.0]), 2), sets[[1, 2]])


def test_an_exchange_leaves_one_knot_out_and_puts_another_in():
    knots = np.array([0.0, 4.5, 9.0, 20.0])
    for tried in exchanges(knots):
        assert np.count_nonzero(np.isin(tried, knots)) == 3
        assert np.min(np.diff(tried)) >= 1.0


def test_a_knot_at_the_wrong_end_is_exchanged_for_one_where_it_is_needed():
    corners, values = [0.0, 20.3, 50.6, 60.2, 79.0], [0.0, 1.0, -0.5, 0.8, 0.0]
    desired = np.interp(np.arange(80.0), corners, values)
    problem = Problem(desired=desired, step=10.0, cyclic=False)
    stuck = best_values(problem, np.array([0.0, 8.0, 20.3, 50.6, 79.0]))
    found = exchanged(problem, stuck)
    assert found.error <= 1e-6 * stuck.error
    assert exchanged(problem, found).error <= found.error
