"""The hull of one request's calls: its support function, and cuts that every request meets."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planner.inversion.bounds.hull_cuts import (
    ANYWHERE,
    TOO_SHALLOW,
    Place,
    calls_of,
    nearest_request,
    separate,
    support,
)

ROUNDING = 1e-9
"""Sums of at most a dozen terms of about one."""


def random_place(rng, *, between=True):
    count = int(rng.integers(1, 10))
    least = np.cumsum(rng.normal(size=count))
    most = least + rng.exponential(size=count) * rng.choice([0.0, 0.1, 1.0, 5.0])
    ends = np.sort(rng.normal(size=2) * 3.0)
    place = Place(float(rng.uniform(0.02, 1.9)), least, most)
    kinds = [ANYWHERE, tuple(ends), (ends[0], np.inf), (-np.inf, ends[1]), (ends[0], ends[0])]
    return place._replace(between=kinds[rng.integers(len(kinds))]) if between else place


def random_points(rng, place, count=500):
    """Calls of random requests at random angles of the place, ends of ranges included."""
    low = max(place.between[0], float(place.least.min()) - 2.0 / place.gain)
    high = min(place.between[1], float(place.most.max()) + 2.0 / place.gain)
    low, high = min(low, place.between[1]), max(high, place.between[0])
    for request in np.append(rng.uniform(low, high, size=count), [low, high]):
        share = np.clip(rng.uniform(-0.5, 1.5, size=len(place.least)), 0.0, 1.0)
        angles = place.least + share * (place.most - place.least)
        yield calls_of(np.array([request]), angles, place.gain)[0], angles


@given(st.integers(0, 2**32 - 1))
def test_no_request_and_no_angles_exceed_the_support(seed):
    rng = np.random.default_rng(seed)
    place = random_place(rng)
    by_call, by_angle = rng.normal(size=(2, len(place.least)))
    by_angle *= rng.choice([0.0, 0.1, 1.0])
    most = support(by_call, by_angle, place)
    for calls, angles in random_points(rng, place):
        assert by_call @ calls - by_angle @ angles <= most.value + ROUNDING


@given(st.integers(0, 2**32 - 1))
def test_the_support_is_attained_at_a_point_of_the_set(seed):
    rng = np.random.default_rng(seed)
    place = random_place(rng)
    by_call, by_angle = rng.normal(size=(2, len(place.least)))
    most = support(by_call, by_angle, place)
    np.testing.assert_allclose(
        by_call @ most.calls - by_angle @ most.angles, most.value, atol=ROUNDING
    )
    assert np.all(most.angles >= place.least)
    assert np.all(most.angles <= place.most)
    _, distance = nearest_request(
        most.calls, most.angles, place._replace(least=most.angles, most=most.angles)
    )
    spacing = 2.0 / 299.0 * (1.0 + place.gain * np.ptp(most.angles)) * len(most.calls)
    assert distance <= spacing


@given(st.integers(0, 2**32 - 1))
def test_a_cut_takes_away_the_point_and_no_request(seed):
    rng = np.random.default_rng(seed)
    place = random_place(rng)
    calls = rng.uniform(-1.0, 1.0, size=len(place.least))
    at = rng.uniform(place.least, place.most)
    cut = separate(calls, at, place)
    if cut is None:
        return
    assert cut.by_call @ calls - cut.by_angle @ at > cut.limit
    for others, angles in random_points(rng, place):
        assert cut.by_call @ others - cut.by_angle @ angles <= cut.limit


@given(st.integers(0, 2**32 - 1))
def test_what_a_request_calls_for_is_never_cut_off(seed):
    rng = np.random.default_rng(seed)
    place = random_place(rng)
    for calls, angles in random_points(rng, place, count=3):
        assert separate(calls, angles, place) is None


def test_half_of_a_saturated_request_each_way_may_keep_its_call():
    # Two requests, one far ahead and one far behind: their mixture calls for nothing, unchanged.
    angles = np.array([0.0, 0.5, 1.0])
    assert separate(np.zeros(3), angles, Place(0.5, angles, angles)) is None


def test_a_call_that_falls_late_must_have_been_saturated_before():
    # Every pair of ticks alone allows it: the call does not rise, and falls no faster than the
    # joint moves. Only far ahead is a call constant and then falls, and there it is 1, not 0.
    angles = np.array([0.0, 0.5, 1.0])
    cut = separate(np.array([0.0, 0.0, -0.25]), angles, Place(0.5, angles, angles))
    assert cut is not None


def test_a_shallow_violation_is_not_worth_a_row():
    angles = np.zeros(2)
    calls = np.array([0.0, TOO_SHALLOW / 4.0])
    assert separate(calls, angles, Place(0.5, angles, angles)) is None
