"""Encoders that start again after a turn are read on; whatever only looks like it is left alone."""

from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.identification.grid import timing_of
from planner.identification.joint_fit import evenly_timed
from planner.identification.log import TURN, unwrapped
from tests.identification.made import AIBO, NOISE, measured, rich_log

SAME = 1e-12  # turns are added and taken to rounding [rad]


def wrapped(angles):
    return np.mod(angles + np.pi, TURN) - np.pi


def test_requests_that_start_again_alone_go_on_unless_the_joint_is_stuck():
    wave = np.sin(AIBO.period * np.arange(400.0))
    angles = planner.simulate(AIBO, wave, cyclic=False)
    log = replace(rich_log(), requests=wave, angles=angles)
    below = replace(log, requests=wave - 0.1)
    read, jumps = unwrapped(replace(below, requests=below.requests % TURN))
    assert jumps > 0
    moved = read.requests - read.angles - below.requests + log.angles
    assert np.max(np.abs(moved - TURN * np.round(moved[0] / TURN))) <= SAME
    far = np.repeat([0.0, 5.0, 0.0, 5.0], 100)  # nearer to this joint if they turned
    stuck = replace(log, requests=far, angles=0.1 * far)
    assert unwrapped(stuck) == (stuck, 0)


def test_angles_that_go_on_take_the_turn_of_their_requests_and_those_not_measured_make_none():
    """What stands in their rows, here for ten rows and at the start, is of no matter."""
    log = rich_log(noise=NOISE)
    below = log.angles - log.angles[0] - 0.1
    read, jumps = unwrapped(replace(log, angles=below % TURN))
    assert jumps > 0
    assert np.max(np.abs(read.angles - below)) <= SAME
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
    glitched = replace(log, angles=angles)
    assert unwrapped(glitched) == (glitched, 0)
    high = replace(log, requests=log.requests + 3.1, angles=wrapped(log.angles + 3.1))
    share = replace(high, unit="1")
    assert unwrapped(share) == (share, 0)
    slow = replace(high, times=0.3 * np.arange(len(high.times)))
    assert unwrapped(slow) == (slow, 0)


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


def test_rows_that_are_uneven_keep_their_times():
    rng = np.random.default_rng(3)
    fine = rich_log(rows=1200, amplitude=1.0)
    rows = np.cumsum(rng.integers(3, 6, size=290))
    times, rows = fine.times[rows], np.append(rows, len(fine.times))
    requests = np.repeat(fine.requests[rows[:-1]], np.diff(rows))
    before = np.full(rows[0], requests[0])
    angles = planner.simulate(AIBO, np.concatenate([before, requests]), cyclic=False)
    log = planner.Log(
        times=times, requests=fine.requests[rows[:-1]], angles=measured(angles[rows[:-1]], rng)
    )
    found = planner.identify(log, hold_out=False)
    assert np.array_equal(found.fits[0].log.times, times)
    assert not any("jitter" in text for text in found.warnings)


def test_dropped_rows_and_gaps_keep_their_places():
    log = rich_log()
    kept = np.ones(400, dtype=bool)
    kept[[50, 51, 130]] = kept[200:260] = False
    true = log.times[kept]
    rng = np.random.default_rng(1)
    times = true + rng.uniform(-0.1, 0.1, size=len(true)) * AIBO.period
    sparse = planner.Log(times=times, requests=log.requests[kept], angles=log.angles[kept])
    (even,), off = evenly_timed([sparse], AIBO.period)
    assert 0.02 * AIBO.period <= off <= 0.1 * AIBO.period
    for part in (slice(0, 197), slice(197, None)):
        assert np.std((even.times - true)[part]) <= 1e-3 * AIBO.period


@pytest.mark.parametrize(
    ("period", "given", "tick", "hold"),
    [
        (0.008, {}, 0.008, 1),
        (0.0084, {}, 0.0084, 1),  # 5 % more than the tick of the paper
        (0.0085, {}, 0.00425, 2),
        (0.02, {}, 0.005, 4),
        (0.0211, {}, 0.00422, 5),
        (0.2, {}, 0.01, 20),
        (0.02, {"tick": 0.004}, 0.004, 5),
        (0.02, {"hold": 2}, 0.01, 2),
        (0.02, {"tick": 0.01, "hold": 2}, 0.01, 2),
    ],
)
def test_ticks_are_those_asked_for_or_of_five_milliseconds_and_at_most_twenty(
    period, given, tick, hold
):
    log = rich_log(rows=50)
    timing = timing_of(
        [replace(log, times=period * np.arange(50))], **{"tick": None, "hold": None, **given}
    )
    assert (timing.tick, timing.period) == pytest.approx((tick, period))
    assert timing.hold == hold
    assert timing.ticking(1.01 * tick)[1:3] == pytest.approx((tick, hold))
