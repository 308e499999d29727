"""What a model was tested on tells the error to expect, and which motion is outside of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.model.evidence import (
    Evidence,
    Run,
    errors_of_motion,
    expectation,
    under_moving_requests,
    untested_words,
)
from planner.model.joint import JointModel
from tests.instances import joint_of

SEEN = Evidence(0.02, 2.0, 0.5, (-1.0, 1.0), ((0.0, 0.01), (4.0, 0.03)))
PHASE = 2.0 * np.pi * np.arange(200) / 200
ROOT = np.sqrt(2.0)
ROWS = 0.02 * np.arange(1000)
LEVELS = np.random.default_rng(2).uniform(-1.0, 1.0, 1000)


def sine(amplitude, frequency=1.0):
    """A cycle and its period; the rms acceleration is (2 pi frequency)^2 amplitude / sqrt 2."""
    return amplitude * np.sin(PHASE), 1.0 / frequency / 200


@pytest.mark.parametrize(
    ("acceleration", "error"), [(0.0, 0.01), (2.0, 0.02), (4.0, 0.03), (8.0, 0.06)]
)
def test_the_error_grows_with_the_acceleration_of_a_motion(acceleration, error):
    angles, period = sine(acceleration * ROOT / (2.0 * np.pi) ** 2)
    # Differences of 200 samples a cycle miss a sine's acceleration by 1e-4 of it.
    assert SEEN.error_of(angles, period=period, cyclic=True) == pytest.approx(error, rel=2e-4)


@pytest.mark.parametrize(
    ("amplitude", "frequency", "load", "outside"),
    [
        (0.1, 1.0, -0.54, ()),
        (0.1, 1.0, -0.56, ("load",)),
        (2.15 / (0.8 * np.pi), 0.4, 0.0, ()),
        (2.25 / (0.8 * np.pi), 0.4, 0.0, ("speed",)),
        (4.35 * ROOT / (4.0 * np.pi) ** 2, 2.0, 0.0, ()),
        (4.45 * ROOT / (4.0 * np.pi) ** 2, 2.0, 0.0, ("acceleration",)),
        (1.3, 0.2, 0.0, ("angle",)),
    ],
)
def test_motion_is_outside_where_it_exceeds_what_was_tested_by_10_percent(
    amplitude, frequency, load, outside
):
    angles, period = sine(amplitude, frequency)
    assert SEEN.exceeded(angles, period=period, cyclic=True, load=load) == outside


@pytest.mark.parametrize(("beyond", "outside"), [(0.98, ()), (1.02, ("acceleration",))])
def test_motion_is_outside_by_the_part_that_accelerates_most_however_long_it_rests(beyond, outside):
    """A part lasts as long as those of the tests, two seconds."""
    times = 0.005 * np.arange(4000)
    size = beyond * 1.1 * 4.0 * ROOT / (4.0 * np.pi) ** 2
    angles = size * (np.cos(4.0 * np.pi * times) - 1.0) * (times <= 2.0)
    seen = SEEN._replace(speed=9.0)
    for cyclic, shift in ((False, 0), (False, 1500), (True, -200), (True, 0)):
        moved = np.roll(angles, shift)
        assert seen.exceeded(moved, period=0.005, cyclic=cyclic) == outside


def test_after_a_log_of_steps_the_error_of_the_delay_counts_with_the_speed():
    """It is what a sine's angles miss if they come 20 ms late, and what was tested beside it."""
    steps = SEEN._replace(delay_error=0.02)
    amplitude, frequency = 0.05, 1.5
    angles, period = sine(amplitude, frequency)
    late, _ = sine(amplitude * 2.0 * np.pi * frequency * 0.02)
    tested = SEEN.error_of(angles, period=period, cyclic=True)
    told = steps.error_of(angles, period=period, cyclic=True)
    assert told == pytest.approx(np.hypot(tested, np.sqrt(np.mean(late**2))), rel=1e-3)


def test_a_plan_is_outside_of_a_log_of_steps_where_the_delay_counts_most():
    angles, period = sine(0.2)  # 0.9 rad/s and 5.6 rad/s^2 rms, for which 42 mrad were tested
    for delay_error, outside in ((0.0, False), (0.03, False), (0.06, True)):
        seen = SEEN._replace(delay_error=delay_error, by_acceleration=((0.0, 0.01), (8.0, 0.055)))
        assert ("moving requests" in seen.exceeded(angles, period=period, cyclic=True)) is outside
        told = expectation(seen, angles, angles, period=period, cyclic=True)
        words = untested_words(["knee"], [told])
        assert words.endswith(": knee (moving requests: the logs hold steps only)") is outside


def held(requests, rows):
    """Each request for so many rows."""
    return np.repeat(requests[::rows], rows)[: len(requests)]


@pytest.mark.parametrize(
    ("requests", "share"),
    [
        (np.sin(3.0 * ROWS), 1.0),
        (held(np.sin(3.0 * ROWS), 5), 1.0),
        (np.abs(np.mod(ROWS, 4.0) - 2.0), 1.0),
        (held(LEVELS, 50), 0.0),
        (held(LEVELS, 20), 0.0),
        (held(LEVELS, 20) + 1e-3 * LEVELS, 0.0),
        (np.zeros(1000), 0.0),
    ],
    ids=["sine", "ten a second", "triangle", "steps", "quick steps", "noisy steps", "rest"],
)
def test_requests_move_where_they_neither_jump_nor_rest(requests, share):
    assert np.mean(under_moving_requests(requests, 0.02)) == pytest.approx(share, abs=0.05)


def test_a_cycle_is_as_fast_and_as_accelerated_as_where_it_begins_again():
    saw = 0.4 * np.linspace(-1.0, 1.0, 200)
    for cyclic, outside in ((True, ("speed", "acceleration")), (False, ())):
        assert SEEN.exceeded(saw, period=0.005, cyclic=cyclic) == outside
    turns = np.r_[np.zeros(100), 0.004, np.zeros(99)]  # the same jump and stop, wherever it is
    told = [SEEN.error_of(np.roll(turns, k), period=0.01, cyclic=True) for k in (0, 99, 100)]
    assert told == pytest.approx(3 * told[:1])


def test_what_was_not_tested_is_not_exceeded_but_for_a_load_and_promises_nothing():
    angles, period = sine(9.0, 10.0)
    assert not Evidence(0.01).exceeded(angles, period=period, cyclic=True)
    assert Evidence(0.01).exceeded(angles, period=period, cyclic=False, load=0.1) == ("load",)
    untested = Evidence(intervals={"v_max": (5.0, 6.0)})
    told = expectation(untested, PHASE, PHASE, period=0.01, cyclic=False, load=np.ones(200))
    assert np.isnan(told.error)
    assert told.untested == ()


def grown(*, power):
    """Sines of six frequencies, 1 mrad off, and by a power of the acceleration more."""
    times, runs = 0.02 * np.arange(500), []
    for frequency in (0.5, 2.0, 1.0, 3.0, 1.5, 2.5):
        angles = 0.3 * np.sin(2.0 * np.pi * frequency * times)
        size = 0.3 * (2.0 * np.pi * frequency) ** 2 / ROOT
        errors = (0.001 + 0.01 * (size / 10.0) ** power) * np.where(np.arange(500) % 2, 1.0, -1.0)
        runs.append(Run(angles, errors[np.newaxis], 0.02))
    return runs


@pytest.mark.parametrize("power", [1, 3])
def test_errors_that_grow_with_the_acceleration_are_found_as_they_are(power):
    """On a line, or on a curve, from motions in any order."""
    runs = grown(power=power)
    by_acceleration, spread = errors_of_motion(runs)
    assert len(by_acceleration) == 7
    seen = Evidence(0.01, by_acceleration=by_acceleration)
    for run in runs:
        told = seen.error_of(run.angles, period=run.period, cyclic=False)
        assert told == pytest.approx(np.max(run.errors), rel=0.02)
    # All alike, so that only what other motions scatter is left.
    assert np.log(spread) == pytest.approx(np.log([1.0 / 1.8, 1.8]), rel=0.1)


def test_the_noise_of_the_sensor_is_no_error_of_the_joint():
    rng, times = np.random.default_rng(0), 0.02 * np.arange(3000)
    angles = 0.3 * np.sin(2.0 * np.pi * 0.5 * times)
    joint = 0.001 * np.where(times % 1.0 < 0.5, 1.0, -1.0)
    run = Run(angles, (joint + rng.normal(scale=0.002, size=3000))[np.newaxis], 0.02)
    with_noise, without = (
        Evidence(0.0, by_acceleration=errors_of_motion([run], noise=noise)[0])
        for noise in (0.0, 0.002)
    )
    told = {"period": 0.02, "cyclic": False}
    assert with_noise.error_of(angles, **told) == pytest.approx(math.hypot(0.001, 0.002), rel=0.1)
    assert without.error_of(angles, **told) == pytest.approx(0.001, rel=0.2)


def test_a_log_without_motion_or_too_short_says_nothing_of_acceleration():
    unknown = ((), (0.0, math.inf))
    assert errors_of_motion([Run(np.zeros(500), np.ones((1, 500)), 0.02)]) == unknown
    assert errors_of_motion([Run(PHASE[:10], PHASE[np.newaxis, :10], 0.02)]) == unknown
    assert errors_of_motion([]) == unknown


def test_nine_motions_of_ten_are_in_the_range_where_they_scatter_more_than_parts_of_a_log():
    """Normal logarithms: 0.5 from part to part, and 90 % within a factor of 1.8 beside."""
    random, period = np.random.default_rng(0), 0.02
    angles = 0.3 * np.sin(2.0 * np.pi * 0.5 * period * np.arange(100))
    sizes = 0.01 * np.exp(0.5 * random.standard_normal(2000))
    runs = [Run(angles, np.full((1, 100), size), period) for size in sizes]
    by_acceleration, spread = errors_of_motion(runs)
    seen = Evidence(0.01, by_acceleration=by_acceleration, spread=spread)
    low, high = expectation(seen, angles, angles, period=period, cyclic=True)[2:]
    others = sizes * np.exp(np.log(1.8) / 1.645 * random.standard_normal(len(sizes)))
    assert np.mean((low <= others) & (others <= high)) == pytest.approx(0.9, abs=0.03)
    for size in (0.001, 0.02, 0.1):
        told = expectation(seen, angles + size, angles, period=period, cyclic=True)
        # The two errors may cancel, or add up, by a correlation of 0.7.
        every = np.linspace(low, high, 10001)
        assert told.low**2 == pytest.approx(np.min(size**2 + every**2 - 1.4 * size * every))
        assert told.high**2 == pytest.approx(size**2 + high**2 + 1.4 * size * high)
        assert told.low < told.error < told.high


def test_a_model_carries_its_evidence_until_a_parameter_changes():
    model = JointModel.ers210a().with_evidence(SEEN)
    assert model == JointModel.ers210a()
    assert model.evidence == SEEN
    assert model.requested_every(0.02).evidence == SEEN
    assert replace(model, lag=0.02).evidence is None
    assert JointModel.ers210a().evidence is None


def test_evidence_in_another_unit_is_scaled_but_for_loads_times_the_gain_and_shares():
    times = ("gain", "lag", "acceleration_time", "time_constant", "integral_rate")
    intervals = dict.fromkeys(times, (0.02, 0.03))
    seen = SEEN._replace(delay_error=0.01, spread=(0.5, 2.0), over_delay=0.3)
    seen = seen._replace(intervals=intervals | {"v_max": (1.0, np.inf)}, correlations=((1.0,),))
    assert seen.scaled(100.0, ["v_max"]) == seen._replace(
        error=2.0,
        speed=200.0,
        angles=(-100.0, 100.0),
        by_acceleration=((0.0, 1.0), (400.0, 3.0)),
        intervals=intervals | {"v_max": (100.0, np.inf)},
    )


def test_the_same_joint_with_requests_at_another_rate_has_its_intervals_moved_with_it():
    terms = {"dead_band": 0.01, "time_constant": 0.01, "max_acceleration": 500.0}
    joint = joint_of(5.0, 0.1, 0.02, 0.02, **terms)
    for model, open_end in ((joint, "max_acceleration"), (JointModel.ers210a(), "v_max")):
        names = ("v_max", "theta_0", "lag", "gain", "max_acceleration")
        known = {name: getattr(model, name) for name in names}
        intervals = {name: (0.98 * each, 1.02 * each) for name, each in known.items()}
        intervals[open_end] = (0.98 * known[open_end], np.inf)
        tested = model.with_evidence(SEEN._replace(intervals=intervals))
        other = tested.requested_every(0.02)
        assert other.lag - model.lag < -1e-4
        for name, ends in other.evidence.intervals.items():
            value, moved = known[name], getattr(other, name)
            share = moved / value if name in ("gain", "theta_0") else 1.0
            shift = 0.0 if name in ("gain", "theta_0", "v_max") or moved == value else moved - value
            low, high = intervals[name]
            assert ends == pytest.approx((share * low + shift, share * high + shift)), name
        same = tested.requested_every(2.0 * model.tick)
        assert (same.hold, same.evidence) == (2, tested.evidence)
    assert replace(joint, lag=0.001).requested_every(0.02).lag == 0.0
