"""Costs of segments and the slope-bounded ideal, against least squares and convex programmes."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from planner.approximation.kernel import segment_costs
from planner.approximation.values import attainable_error, slope_bounded
from planner.trajectory import steps
from tests.approximation.samples import KINDS, samples_of

STEP = 0.3


NODES = np.array([0, 2, 3, 6, 9])


SAMPLES = 10


def squared_error(desired, start, end, at_start, slope):
    """Of a line over the samples after its start."""
    k = np.arange(1, end - start + 1)
    return float(np.sum((at_start + slope * k - desired[start + 1 : end + 1]) ** 2))


def pairs(fixed):
    """Numbers of two nodes, and whether a segment between them passes no node that must be one."""
    for i in range(len(NODES)):
        for j in range(len(NODES)):
            yield i, j, j > i and not fixed[i + 1 : j].any()


@pytest.fixture(params=range(6))
def instance(request):
    """Samples, and nodes that must be knots."""
    rng = np.random.default_rng(request.param)
    return rng.normal(scale=0.5, size=SAMPLES), rng.random(len(NODES)) < 0.3


def test_a_segment_costs_what_the_best_line_within_the_slopes_leaves(instance):
    desired, fixed = instance
    costs = segment_costs(desired, STEP, NODES, np.zeros((len(NODES), 1)), fixed, True)
    for i, j, possible in pairs(fixed):
        expected = np.inf
        if possible:
            start, end = NODES[i], NODES[j]
            # The error is a parabola of the slope: the nearest slope within the bounds is best.
            k, part = np.arange(1, end - start + 1), desired[start + 1 : end + 1]
            slope = np.clip(np.polyfit(k, part, 1)[0], -STEP, STEP) if len(k) > 1 else 0.0
            expected = squared_error(desired, start, end, np.mean(part - slope * k), slope)
        assert costs[j, i] == pytest.approx(expected, abs=1e-12)


def test_a_chord_costs_its_squared_error_where_it_is_not_too_steep(instance):
    desired, fixed = instance
    states = np.stack([desired[NODES] - 0.1, desired[NODES] + 0.2], axis=1)
    costs = segment_costs(desired, STEP, NODES, states, fixed, False)
    for i, j, possible in pairs(fixed):
        for a, b in np.ndindex(2, 2):
            start, end, expected = NODES[i], NODES[j], np.inf
            if possible:
                slope = (states[j, b] - states[i, a]) / (end - start)
                if abs(slope) <= STEP:
                    expected = squared_error(desired, start, end, states[i, a], slope)
            assert costs[2 * j + b, 2 * i + a] == pytest.approx(expected, abs=1e-12)


SOLVED = 1e-6
"""What Clarabel leaves of a squared error or a largest error of about one."""


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
