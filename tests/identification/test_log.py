"""Encoders that start again after a turn are read on; whatever only looks like it is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.identification.log import TURN, unwrapped
from tests.identification.made import AIBO, NOISE, changed, rich_log

SAME = 1e-12
"""Turns are added and taken to rounding [rad]."""


def wrapped(angles):
    return np.mod(angles + np.pi, TURN) - np.pi


def test_an_encoder_that_starts_again_gives_the_model_of_one_that_does_not():
    log = rich_log(noise=NOISE)
    high = changed(log, requests=log.requests + 3.1, angles=log.angles + 3.1)
    found = planner.identify(changed(high, angles=wrapped(high.angles)), hold_out=False)
    assert found.accepted
    assert any("jumps by a whole turn" in text for text in found.warnings)
    expected = planner.identify(high, hold_out=False).model
    assert np.isclose(found.model.v_max, expected.v_max, rtol=1e-6)
    assert np.isclose(found.model.offset, expected.offset, atol=1e-6)
    assert np.max(np.abs(found.fits[0].log.angles - high.angles)) <= SAME


def test_requests_that_start_again_too_go_on_as_well():
    log = rich_log(noise=NOISE)
    both = changed(log, requests=wrapped(log.requests + 3.1), angles=wrapped(log.angles + 3.1))
    read, jumps = unwrapped(both)
    assert jumps > 0
    assert np.max(np.abs(np.diff(read.angles))) < 1.0
    assert np.max(np.abs(read.angles - read.requests - log.angles + log.requests)) <= SAME


def test_requests_that_start_again_alone_go_on_unless_the_joint_is_stuck():
    wave = np.sin(AIBO.period * np.arange(400.0))
    angles = planner.simulate(AIBO, wave, cyclic=False)
    log = changed(rich_log(), requests=wave, angles=angles)
    below = changed(log, requests=wave - 0.1)
    read, jumps = unwrapped(changed(below, requests=below.requests % TURN))
    assert jumps > 0
    moved = read.requests - read.angles - below.requests + log.angles
    assert np.max(np.abs(moved - TURN * np.round(moved[0] / TURN))) <= SAME
    far = np.repeat([0.0, 5.0, 0.0, 5.0], 100)  # nearer to this joint if they turned
    stuck = changed(log, requests=far, angles=0.1 * far)
    assert unwrapped(stuck) == (stuck, 0)


def test_angles_that_go_on_take_the_turn_of_their_requests():
    log = rich_log(noise=NOISE)
    below = log.angles - log.angles[0] - 0.1
    read, jumps = unwrapped(changed(log, angles=below % TURN))
    assert jumps > 0
    assert np.max(np.abs(read.angles - below)) <= SAME


def test_angles_that_were_not_measured_make_no_turn():
    """What stands in their rows, here for ten rows and at the start, is of no matter."""
    log = rich_log(noise=NOISE)
    known = (np.arange(400) >= 3) & ((np.arange(400) < 100) | (np.arange(400) >= 110))
    high = replace(log, requests=log.requests + 3.1, angles=log.angles + 3.1)
    gaps = replace(high, angles=np.where(known, high.angles, -9.0), measured=known)
    assert unwrapped(gaps) == (gaps, 0)
    turned = wrapped(high.angles)
    read, jumps = unwrapped(replace(gaps, angles=np.where(known, turned, -9.0)))
    assert jumps == np.count_nonzero(np.abs(np.diff(turned[known])) > 4.0) > 0
    assert np.max(np.abs((read.angles - high.angles)[known])) <= SAME


def test_glitches_shares_and_slow_logs_are_left_alone():
    log = rich_log(noise=NOISE)
    angles = log.angles.copy()
    angles[[50, 120, 121]] += 6.0
    glitched = changed(log, angles=angles)
    assert unwrapped(glitched) == (glitched, 0)
    high = changed(log, requests=log.requests + 3.1, angles=wrapped(log.angles + 3.1))
    share = replace(high, unit="1")
    assert unwrapped(share) == (share, 0)
    slow = replace(high, times=0.3 * np.arange(len(high.times)))
    assert unwrapped(slow) == (slow, 0)


def test_every_row_of_every_piece_with_known_requests_is_used():
    log = rich_log(noise=NOISE)
    times = log.times + 2.0 * (np.arange(400) >= 200)
    found = planner.identify(changed(log, times=times), hold_out=False)
    used = found.fits[0].used
    assert used[[198, 199, 398, 399]].all()
    assert used[:200].sum() >= 170
    assert used[200:].sum() >= 170


@pytest.mark.parametrize("period", [0.008, 1.0 / 30.0, 0.1, 0.2])
@pytest.mark.parametrize("both", [False, True])
def test_a_turn_lost_between_rows_far_apart_is_found_whether_requests_wrap_or_not(period, both):
    joint = AIBO.requested_every(period)
    times = period * np.arange(int(20.0 / period))
    requests = np.radians(350.0 + 30.0 * np.sin(times) + 8.0 * np.sign(np.sin(2.3 * times)))
    angles = planner.simulate(joint, requests, cyclic=False)
    recorded = requests % TURN if both else requests
    log = planner.Log(times=times, requests=recorded, angles=angles % TURN)
    found, jumps = unwrapped(log)
    assert jumps == np.count_nonzero(np.abs(np.diff(angles % TURN)) > 4.0) > 0
    assert np.allclose(found.angles - found.requests, angles - requests, rtol=0.0, atol=SAME)
    assert np.allclose(np.diff(found.angles), np.diff(angles), rtol=0.0, atol=SAME)
