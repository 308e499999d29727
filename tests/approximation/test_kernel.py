"""Costs of segments for chains, against least squares of each segment by itself."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.kernel import chord_costs, line_costs

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
    costs = line_costs(desired, STEP, NODES, fixed)
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
    costs = chord_costs(desired, STEP, NODES, states, fixed)
    for i, j, possible in pairs(fixed):
        for a, b in np.ndindex(2, 2):
            start, end, expected = NODES[i], NODES[j], np.inf
            if possible:
                slope = (states[j, b] - states[i, a]) / (end - start)
                if abs(slope) <= STEP:
                    expected = squared_error(desired, start, end, states[i, a], slope)
            assert costs[2 * j + b, 2 * i + a] == pytest.approx(expected, abs=1e-12)
