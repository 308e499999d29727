"""The slope-bounded ideal and the smallest largest error, against convex programmes."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from planner.approximation.values import attainable_error, envelopes, slope_bounded
from tests.approximation.samples import KINDS, samples_of

SOLVED = 1e-6
"""What Clarabel leaves of a squared error or a largest error of about one."""


def programme(desired, step, cyclic, objective):
    angles = cp.Variable(desired.size)
    rises = cp.diff(cp.hstack([angles, angles[0]]) if cyclic else angles)
    error = cp.Problem(cp.Minimize(objective(angles - desired)), [cp.abs(rises) <= step])
    return error.solve(solver="CLARABEL")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", [0.02, 0.1, 10.0])
@pytest.mark.parametrize("cyclic", [True, False])
def test_the_ideal_is_the_least_squares_sequence_within_the_slopes(kind, step, cyclic):
    desired = samples_of(kind, 50, np.random.default_rng(1))
    ideal = slope_bounded(desired, step, cyclic=cyclic)
    assert np.all(np.abs(np.diff(ideal)) <= step * (1.0 + 1e-9))
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


@pytest.mark.parametrize("cyclic", [True, False])
def test_both_envelopes_and_so_their_mean_keep_the_slopes(cyclic):
    desired = samples_of("steps", 50, np.random.default_rng(3))
    for envelope in envelopes(desired, 0.05, cyclic=cyclic):
        rises = np.diff(np.append(envelope, envelope[0]) if cyclic else envelope)
        assert np.all(np.abs(rises) <= 0.05 * (1.0 + 1e-12))
