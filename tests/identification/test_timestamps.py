"""Times that jitter are distinguished from uneven rows by the loss of the fit."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from planner.identification.fit import evenly_timed
from planner.identification.grid import timing_of
from tests.identification.made import AIBO, NOISE, changed, measured, rich_log, step_logs

JITTER = 1e-3
"""Standard deviation of the noted times [s], an eighth of a period."""

WHITE = 1.3
"""A good fit leaves little more than the noise and the resolution, by this factor."""

LEFT = 1e-4
"""What is left of a jitter of 1 ms by the line through 400 rows, and more than that [s]."""

WIDER = 1.1
"""Times to a tenth of a millisecond widen no interval by more than this factor."""


def jittered(log, seed=0):
    rng = np.random.default_rng(seed)
    times = np.sort(log.times + rng.normal(scale=JITTER, size=len(log.times)))
    return changed(log, times=times + 1e-9 * np.arange(len(times)))


def test_times_that_jitter_are_made_even_and_leave_no_more_than_the_noise():
    log = rich_log(noise=NOISE)
    found = planner.identify(jittered(log))
    assert any("the times of the rows jitter" in text for text in found.warnings)
    assert found.held_out_rms <= WHITE * NOISE
    assert np.std(found.fits[0].log.times - log.times) <= LEFT


def test_intervals_of_times_that_jitter_are_as_narrow_as_those_of_even_ones_and_as_true():
    logs = step_logs()
    even = planner.identify(logs, hold_out=False)
    found = planner.identify(
        [jittered(log, seed) for seed, log in enumerate(logs)], tick=AIBO.tick, hold_out=False
    )
    for name, (lower, upper) in found.intervals.items():
        low, high = even.intervals[name]
        assert upper - lower <= WIDER * (high - low), name
        assert lower <= getattr(AIBO, name) <= upper, name


def test_the_period_of_times_that_jitter_is_as_plain_as_they_allow():
    noise = 1e-3 * np.random.default_rng(0).uniform(-1.0, 1.0, size=6000)
    for period, found in ((0.01, 0.01), (0.010017, None)):
        times = period * np.arange(6000) + noise
        log = planner.Log(times=times, requests=np.zeros(6000), angles=np.zeros(6000))
        told = timing_of([log], tick=None, hold=None).period
        assert told == found if found else abs(told - period) < 1e-6


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
        [changed(log, times=period * np.arange(50))], **{"tick": None, "hold": None, **given}
    )
    assert (timing.tick, timing.period) == pytest.approx((tick, period))
    assert timing.hold == hold
    assert timing.ticking(1.01 * tick)[1:3] == pytest.approx((tick, hold))
