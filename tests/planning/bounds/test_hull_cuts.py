"""The hull of one request's calls: its support function, and cuts that every request meets."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planner.planning.bounds.saturation_relaxation import (
    UNBOUNDED,
    RequestSet,
    nearest_request,
    separate,
    support,
)

ROUNDING = 1e-9
"""Sums of at most a dozen terms of about one."""


def random_set(rng, *, interval=True):
    count = int(rng.integers(1, 10))
    lower = np.cumsum(rng.normal(size=count))
    upper = lower + rng.exponential(size=count) * rng.choice([0.0, 0.1, 1.0, 5.0])
    ends = np.sort(rng.normal(size=2) * 3.0)
    requests = RequestSet(float(rng.uniform(0.02, 1.9)), lower, upper)
    if rng.random() < 0.5:
        requests = requests._replace(excess=float(rng.uniform(-0.9, 0.9)))
    kinds = [UNBOUNDED, tuple(ends), (ends[0], np.inf), (-np.inf, ends[1]), (ends[0], ends[0])]
    return requests._replace(interval=kinds[rng.integers(len(kinds))]) if interval else requests


def random_points(rng, requests, count=500):
    """Calls of random requests at random angles of the place, ends of ranges included."""
    reach = 2.0 / requests.gain
    low = max(requests.interval[0], float(requests.lower.min()) - reach)
    high = min(requests.interval[1], float(requests.upper.max()) + reach)
    low, high = min(low, requests.interval[1]), max(high, requests.interval[0])
    for request in np.append(rng.uniform(low, high, size=count), [low, high]):
        share = np.clip(rng.uniform(-0.5, 1.5, size=len(requests.lower)), 0.0, 1.0)
        angles = requests.lower + share * (requests.upper - requests.lower)
        called = requests.gain * (request - angles)
        yield np.clip(called, requests.excess - 1.0, requests.excess + 1.0), angles


@given(st.integers(0, 2**32 - 1))
def test_no_request_and_no_angles_exceed_the_support(seed):
    rng = np.random.default_rng(seed)
    requests = random_set(rng)
    nu, xi = rng.normal(size=(2, len(requests.lower)))
    xi *= rng.choice([0.0, 0.1, 1.0])
    most = support(nu, xi, requests)
    for calls, angles in random_points(rng, requests):
        assert nu @ calls - xi @ angles <= most.value + ROUNDING


@given(st.integers(0, 2**32 - 1))
def test_the_support_is_attained_at_a_point_of_the_set(seed):
    rng = np.random.default_rng(seed)
    requests = random_set(rng)
    nu, xi = rng.normal(size=(2, len(requests.lower)))
    most = support(nu, xi, requests)
    np.testing.assert_allclose(
        nu @ most.contributions - xi @ most.angles, most.value, atol=ROUNDING
    )
    assert np.all(most.angles >= requests.lower)
    assert np.all(most.angles <= requests.upper)
    _, distance = nearest_request(
        most.contributions,
        most.angles,
        requests._replace(lower=most.angles, upper=most.angles),
    )
    assert distance <= ROUNDING


@given(st.integers(0, 2**32 - 1))
def test_a_cut_takes_away_the_point_and_no_request(seed):
    rng = np.random.default_rng(seed)
    requests = random_set(rng)
    calls = requests.excess + rng.uniform(-1.0, 1.0, size=len(requests.lower))
    at = rng.uniform(requests.lower, requests.upper)
    cut = separate(calls, at, requests)
    if cut is None:
        return
    nu, xi, limit = cut
    assert nu @ calls - xi @ at > limit
    for others, angles in random_points(rng, requests):
        assert nu @ others - xi @ angles <= limit


@given(st.integers(0, 2**32 - 1))
def test_what_a_request_calls_for_is_never_cut_off(seed):
    rng = np.random.default_rng(seed)
    requests = random_set(rng)
    for calls, angles in random_points(rng, requests, count=3):
        assert separate(calls, angles, requests) is None


def test_half_of_a_saturated_request_each_way_may_keep_its_call():
    # Two requests, one far ahead and one far behind: their mixture calls for nothing, unchanged.
    angles = np.array([0.0, 0.5, 1.0])
    assert separate(np.zeros(3), angles, RequestSet(0.5, angles, angles)) is None


def test_a_call_that_falls_late_must_have_been_saturated_before():
    # Every pair of ticks alone allows it: the call does not rise, and falls no faster than the
    # joint moves. Only far ahead is a call constant and then falls, and there it is 1, not 0.
    angles = np.array([0.0, 0.5, 1.0])
    cut = separate(np.array([0.0, 0.0, -0.25]), angles, RequestSet(0.5, angles, angles))
    assert cut is not None
