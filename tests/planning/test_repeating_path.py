"""A path that about repeats goes on as it did a cycle before, as far as that explains it."""

import numpy as np
import pytest

from planner.planning.repeating_path import continue_path, repeating_path

KNOWN, CYCLE, AHEAD = 10, 40, 15


def wave(phase):
    """Two joints that repeat together, at phases in cycles, shape (2, n)."""
    turns = 2.0 * np.pi * phase
    return np.array([np.sin(turns) + 0.3 * np.cos(2.0 * turns), 0.5 * np.cos(turns)])


def fed(path, last, *, missed=(), unknown=()):
    """The path's continuation at a tick, after all before it, some with the second joint bad."""
    repeating, periods = repeating_path(2, KNOWN, CYCLE, ahead=AHEAD), 0
    for k in range(last + 1):
        periods += 1
        if k not in missed:
            bad = np.array([False, k in unknown])
            stretch, weights = np.zeros((2, KNOWN + AHEAD)), np.zeros(2)
            stretch[~bad, :KNOWN] = path[~bad, k : k + KNOWN]
            continue_path(repeating, stretch, bad, periods, weights)
            periods = 0
    return stretch[:, KNOWN:], weights


def assert_continued(path, last, *, weight=1.0, **bad):
    """It goes on as the path does."""
    follow, weights = fed(path, last, **bad)
    expected = path[:, last + KNOWN : last + KNOWN + AHEAD]
    np.testing.assert_allclose(follow, expected, rtol=0.0, atol=1e-12)
    assert np.all(weights >= weight - 1e-12)


def test_a_path_that_repeats_is_continued_exactly_once_a_cycle_is_known():
    path = wave(np.arange(200) / CYCLE)
    for last in (0, 20, CYCLE - 1):
        follow, weights = fed(path, last)
        assert np.all(weights == 0.0)
        assert np.array_equal(follow, np.repeat(path[:, [last + KNOWN - 1]], AHEAD, axis=1))
    for last in (CYCLE, 90):
        assert_continued(path, last)


def test_cycles_of_another_length_are_found_and_paths_that_drift_go_on_from_where_they_are():
    for length in (33, 47):  # rows, where 40 are expected
        path = wave(np.arange(200) / length)
        assert_continued(path, 100, weight=0.999)  # its first ones were of another cycle
    path = wave(np.arange(200) / CYCLE) + 0.002 * np.arange(200)
    assert_continued(path, 100)


def test_the_weight_is_the_share_of_the_motion_that_the_cycle_before_explains():
    path = wave(np.arange(200) / CYCLE)
    path[:, 100:] = 0.3 * np.random.default_rng(0).normal(size=(2, 100))
    assert fed(path, 100)[1].max() < 0.9
    standing = np.ones((2, 200))
    assert fed(standing, 100)[1].min() == 1.0
    standing[:, 105:] += 0.1  # it begins to move
    assert fed(standing, 100)[1].max() == 0.0
    walking = wave(np.arange(200) / CYCLE)
    walking[:, 100:] = walking[:, [100]]  # it has stopped
    assert fed(walking, 100)[1].max() == 0.0


def test_continuations_that_were_wrong_for_a_while_are_relied_on_again_later():
    path = wave(np.arange(400) / CYCLE)
    path[:, 120:160] = np.random.default_rng(0).normal(size=(2, 40))
    assert fed(path, 165)[1].max() < 0.2
    assert fed(path, 350)[1].min() > 0.95


def test_missed_ticks_leave_what_was_known_and_longer_outages_wait_for_a_cycle():
    path = wave(np.arange(200) / CYCLE)
    assert_continued(path, 90, missed=range(60, 60 + KNOWN - 1))
    path = wave(np.arange(300) / CYCLE)
    outage = range(60, 90)
    assert np.all(fed(path, 110, missed=outage)[1] == 0.0)
    assert_continued(path, 180, missed=outage)


def test_a_joint_of_which_nothing_is_known_leaves_the_others_alone():
    path = wave(np.arange(200) / CYCLE)
    follow, weights = fed(path, 90, unknown=range(91))
    assert np.allclose(follow[0], path[0, 90 + KNOWN : 90 + KNOWN + AHEAD], atol=1e-12)
    assert weights == pytest.approx([1.0, 0.0])
    assert_continued(path, 90, weight=0.0, unknown=(50, 70))


def test_a_path_that_never_repeats_is_not_expected_to_go_on_as_what_is_nearest_did():
    rng = np.random.default_rng(0)
    for _ in range(3):
        path = np.repeat(np.cumsum(rng.normal(size=(1, 200)), axis=1), 2, axis=0)
        weights = [fed(path, last)[1].max() for last in range(100, 180, 10)]
        assert np.mean(weights) < 0.1  # the nearest stretches explain 0.14 to 0.33 of what is known
