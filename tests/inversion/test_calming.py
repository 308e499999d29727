"""The pull on the squared changes of requests."""

from __future__ import annotations

import numpy as np
import pytest

from planner.inversion.calming import STIFFNESS, calming, changes, restlessness

ROUNDING = 1e-12
"""Sums of a few dozen numbers near one, added up in two orders."""

CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])


def requests_of(seed, *, samples=12, joints=2):
    return np.random.default_rng(seed).normal(size=(samples, joints))


def differences(samples, *, cyclic):
    """D, so that D R are the changes."""
    matrix = np.roll(np.eye(samples), 1, axis=1) - np.eye(samples)
    return matrix if cyclic else matrix[:-1]


@CYCLIC
def test_changes_are_differences_and_a_cycle_has_one_more(cyclic):
    requests = requests_of(0)
    expected = differences(12, cyclic=cyclic) @ requests
    np.testing.assert_allclose(changes(requests, cyclic=cyclic), expected, rtol=0.0, atol=ROUNDING)
    assert restlessness(requests, cyclic=cyclic) == pytest.approx(np.sum(expected**2))


@CYCLIC
def test_the_pull_has_the_value_and_the_slope_of_the_squared_changes(cyclic):
    requests, weight = requests_of(1), 0.3
    pull = calming(requests, weight, cyclic=cyclic)
    D = differences(12, cyclic=cyclic)
    assert pull.value == pytest.approx(weight * np.sum((D @ requests) ** 2), rel=ROUNDING)
    np.testing.assert_allclose(
        pull.weight * pull.away, weight * D.T @ D @ requests, rtol=0.0, atol=ROUNDING
    )


@CYCLIC
def test_steps_under_the_pull_alone_take_the_changes_away(cyclic):
    requests, mean = requests_of(2), requests_of(2).mean(axis=0)
    for _ in range(600):
        before = restlessness(requests, cyclic=cyclic)
        requests = requests - calming(requests, 1.0, cyclic=cyclic).away
        assert restlessness(requests, cyclic=cyclic) <= before
    np.testing.assert_allclose(requests, np.tile(mean, (12, 1)), rtol=0.0, atol=1e-6)


def test_the_stiffness_is_enough_for_the_pull_to_converge():
    assert 4.0 / 2.0 < STIFFNESS <= 4.0  # half of the largest curvature of squared changes, or more
