"""What a model was tested on tells the error to expect, and which motion is outside of it."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.exceptions import InvalidFile, InvalidInput
from planner.files.joint_model import models_text
from planner.model.evidence import (
    ENCODER_STEP,
    Evidence,
    Expectation,
    Run,
    errors_of_motion,
    expectation,
    refusal,
    under_moving_requests,
    unproven_gains,
    untested_words,
    with_reasons,
)
from planner.model.joint import JointModel

SEEN = Evidence(0.02, 2.0, 0.5, (-1.0, 1.0), ((0.0, 0.01), (4.0, 0.03)))

PHASE = 2.0 * np.pi * np.arange(200) / 200

ROOT = np.sqrt(2.0)


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


def test_without_pairs_the_error_is_that_of_all_rows():
    angles, period = sine(1.0)
    assert Evidence(0.03).error_of(angles, period=period, cyclic=True) == 0.03


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


@pytest.mark.parametrize(
    ("middle", "outside"), [(-1.2, True), (-1.18, False), (1.18, False), (1.2, True)]
)
def test_motion_is_outside_at_either_end_of_the_tested_angles(middle, outside):
    angles, period = sine(0.01)
    found = SEEN.exceeded(middle + angles, period=period, cyclic=True)
    assert found == (("angle",) if outside else ())


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


@pytest.mark.parametrize(("steps", "outside"), [(0.9, False), (1.1, True)])
def test_a_delay_that_counts_for_less_than_a_step_of_an_encoder_is_none(steps, outside):
    angles, period = sine(0.1, 1.0)
    speed = 2.0 * np.pi * 0.1 / ROOT
    seen = SEEN._replace(
        delay_error=steps * ENCODER_STEP / speed, by_acceleration=((0.0, 1e-6), (8.0, 1e-6))
    )
    assert ("moving requests" in seen.exceeded(angles, period=period, cyclic=True)) is outside


def held(requests, rows):
    """Each request for so many rows."""
    return np.repeat(requests[::rows], rows)[: len(requests)]


ROWS = 0.02 * np.arange(1000)

LEVELS = np.random.default_rng(2).uniform(-1.0, 1.0, 1000)


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


def test_what_is_expected_of_a_plan_is_outside_under_a_load_that_was_not_tested():
    for load, untested in ((None, ()), (np.full(200, 0.6), ("load",))):
        told = expectation(SEEN, 0.0 * PHASE, 0.0 * PHASE, period=0.01, cyclic=True, load=load)
        assert told.untested == untested


def test_what_is_not_known_is_not_exceeded_but_for_a_load():
    angles, period = sine(9.0, 10.0)
    assert not Evidence(0.01).exceeded(angles, period=period, cyclic=True)
    assert Evidence(0.01).exceeded(angles, period=period, cyclic=False, load=0.1) == ("load",)


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


@pytest.mark.parametrize("sizes", [(0.001, 0.004), (0.004, 0.001)])
def test_parts_of_the_same_acceleration_have_one_error_whatever_their_order(sizes):
    """A square wave of the speed: parts hold one change each."""
    speeds = np.where(np.arange(1602) // 50 % 2, 0.3, -0.3)
    runs = [Run(0.02 * np.cumsum(speeds), np.full((1, 1602), size), 0.02) for size in sizes]
    ((_, error),), _ = errors_of_motion(runs)
    assert error == pytest.approx(0.002)


def test_the_order_of_motions_changes_nothing():
    runs = grown(power=1)
    assert errors_of_motion(runs) == errors_of_motion(runs[::-1])


def test_an_error_that_falls_with_the_acceleration_is_told_as_the_same_for_all():
    by_acceleration, _ = errors_of_motion(grown(power=-1))
    (_, calm), (_, most) = by_acceleration
    assert calm == most


def test_the_noise_of_the_sensor_is_no_error_of_the_joint():
    rng, times = np.random.default_rng(0), 0.02 * np.arange(3000)
    angles = 0.3 * np.sin(2.0 * np.pi * 0.5 * times)
    joint = 0.001 * np.where(times % 1.0 < 0.5, 1.0, -1.0)
    run = Run(angles, (joint + rng.normal(scale=0.002, size=3000))[np.newaxis], 0.02)
    with_noise, without = (
        Evidence(0.0, by_acceleration=errors_of_motion([run], noise=noise).by_acceleration)
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


def test_of_an_error_below_the_noise_a_tenth_of_its_square_stays():
    angles = 0.3 * np.sin(np.pi * 0.02 * np.arange(400))
    ((_, error), _), _ = errors_of_motion(
        [Run(angles, np.full((1, 400), 0.001), 0.02)], noise=0.002
    )
    assert error == pytest.approx(0.001 * math.sqrt(0.1), rel=1e-3)


def test_parts_in_which_the_joint_rests_say_nothing_of_its_motion():
    moving = 0.3 * np.sin(2.0 * np.pi * 0.5 * 0.02 * np.arange(400))
    rest = Run(1e-4 * moving, np.full((1, 400), 1e-5), 0.02)
    runs = [Run(moving, np.full((1, 400), 0.01), 0.02)]
    assert errors_of_motion([*runs, *(5 * [rest])]) == errors_of_motion(runs)


def test_nine_motions_of_ten_are_in_the_range_where_they_scatter_more_than_parts_of_a_log():
    """Normal logarithms: 0.5 from part to part, and 90 % within a factor of 1.8 beside."""
    random, period = np.random.default_rng(0), 0.02
    angles = 0.3 * np.sin(2.0 * np.pi * 0.5 * period * np.arange(100))
    sizes = 0.01 * np.exp(0.5 * random.standard_normal(2000))
    runs = [Run(angles, np.full((1, 100), size), period) for size in sizes]
    by_acceleration, spread = errors_of_motion(runs)
    seen = Evidence(0.01, by_acceleration=by_acceleration, spread=spread)
    low, high = seen.range_of(angles, period=period, cyclic=True)
    others = sizes * np.exp(np.log(1.8) / 1.645 * random.standard_normal(len(sizes)))
    assert np.mean((low <= others) & (others <= high)) == pytest.approx(0.9, abs=0.03)
    for size in (0.001, 0.02, 0.1):
        told = expectation(seen, angles + size, angles, period=period, cyclic=True)
        # The two errors may cancel, or add up, by a correlation of 0.7.
        every = np.linspace(low, high, 10001)
        assert told.low**2 == pytest.approx(np.min(size**2 + every**2 - 1.4 * size * every))
        assert told.high**2 == pytest.approx(size**2 + high**2 + 1.4 * size * high)
        assert told.low < told.error < told.high


def test_models_of_the_same_rows_count_by_the_geometric_mean_of_their_errors():
    angles = 0.3 * np.sin(np.pi * 0.02 * np.arange(400))
    each = np.array([0.002, 0.018])[:, np.newaxis] * np.ones(400)
    told = [
        Evidence(0.0, by_acceleration=errors_of_motion([Run(angles, errors, 0.02)]).by_acceleration)
        for errors in (each, each[:1])
    ]
    errors = [one.error_of(angles, period=0.02, cyclic=False) for one in told]
    assert errors == pytest.approx([0.006, 0.002])


def test_the_interval_of_the_delay_counts_at_the_upper_end_of_the_range_only():
    angles, period = sine(0.2)
    seen = SEEN._replace(spread=(0.5, 2.0))
    low, high = seen.range_of(angles, period=period, cyclic=True)
    least, most = seen._replace(delay_error=0.05).range_of(angles, period=period, cyclic=True)
    speed = 0.2 * 2.0 * np.pi / ROOT
    tested = SEEN.error_of(angles, period=period, cyclic=True)
    assert (least, low, high) == pytest.approx((0.5 * tested, 0.5 * tested, 2.0 * tested))
    assert most == pytest.approx(np.hypot(high, 0.05 * speed), rel=1e-3)


def test_without_a_spread_no_range_is_told():
    angles, period = sine(0.2)
    told = expectation(SEEN, angles, angles, period=period, cyclic=True)
    assert math.isnan(told.low)
    assert math.isnan(told.high)


def test_a_model_carries_its_evidence_until_a_parameter_changes():
    model = JointModel.ers210a().with_evidence(SEEN)
    assert model == JointModel.ers210a()
    assert model.evidence == SEEN
    assert model.requested_every(0.02).evidence == SEEN
    assert replace(model, lag=0.02).evidence is None
    assert JointModel.ers210a().evidence is None


def test_a_model_that_was_not_tested_promises_nothing_whatever_its_intervals():
    untested = Evidence(intervals={"v_max": (5.0, 6.0)})
    told = expectation(untested, PHASE, PHASE, period=0.01, cyclic=False, load=np.ones(200))
    assert np.isnan(told.error)
    assert told.untested == ()


@pytest.mark.parametrize(
    "wrong",
    [
        ((1.0, np.nan), (np.nan, 1.0)),
        ((1.0, 5.0), (5.0, 1.0)),
        ((30.0, 0.0), (0.0, 30.0)),
        ((1.0, 0.5), (0.4, 1.0)),
        ((1.0,),),
        ((1.0, 0.5), (0.5,)),
        "high",
    ],
)
def test_correlations_that_are_none_are_refused_of_a_caller_and_in_a_file(wrong, tmp_path):
    joint = JointModel.ers210a()
    intervals = {"v_max": (4.0, 5.6), "lag": (0.03, 0.034)}
    right = joint.with_evidence(Evidence(intervals=intervals, correlations=((1, 0.5), (0.5, 1))))
    with pytest.raises(InvalidInput, match=r"symmetric matrix .* each interval: v_max, lag"):
        joint.with_evidence(right.evidence._replace(correlations=wrong))
    right.to_toml(tmp_path / "joint.toml")
    text = (tmp_path / "joint.toml").read_text()
    assert JointModel.from_toml(tmp_path / "joint.toml").evidence == right.evidence
    start = text.index("correlations = ")
    matrix = json.dumps(wrong).replace("NaN", "nan")
    (tmp_path / "joint.toml").write_text(f"{text[:start]}correlations = {matrix}\n")
    with pytest.raises(InvalidFile, match=r"symmetric matrix .* each interval: v_max, lag"):
        JointModel.from_toml(tmp_path / "joint.toml")


def test_a_large_matrix_of_correlations_is_shown_in_a_short_line():
    intervals = dict.fromkeys(("v_max", "lag", "acceleration_time", "offset"), (0.0, 1.0))
    wrong = tuple(tuple(0.123456789 * (i + 5) for i in range(4)) for _ in range(4))
    with pytest.raises(InvalidInput, match=r"^correlations: got .{,100}, expected") as refused:
        JointModel.ers210a().with_evidence(Evidence(intervals=intervals, correlations=wrong))
    assert len(str(refused.value)) < 300


def test_intervals_in_another_unit_are_scaled_but_for_times_and_the_gain():
    intervals = {
        "v_max": (1.0, np.inf),
        "gain": (30.0, 40.0),
        "lag": (0.02, 0.03),
        "acceleration_time": (0.0, 0.05),
        "time_constant": (0.02, 0.03),
    }
    scaled = SEEN._replace(intervals=intervals, correlations=((1.0,),)).scaled(100.0)
    assert scaled.intervals == intervals | {"v_max": (100.0, np.inf)}
    assert scaled.correlations == ((1.0,),)


def test_evidence_in_another_unit_is_scaled_but_for_loads_times_and_shares():
    seen = SEEN._replace(delay_error=0.01, spread=(0.5, 2.0), over_delay=0.3)
    assert seen.scaled(100.0) == seen._replace(
        error=2.0, speed=200.0, angles=(-100.0, 100.0), by_acceleration=((0.0, 1.0), (400.0, 3.0))
    )


def test_a_short_log_is_cut_into_shorter_parts():
    angles = 0.3 * np.sin(2.0 * np.pi * 2.0 * 0.02 * np.arange(60))
    (_, (_, error)), _ = errors_of_motion([Run(angles, np.full((1, 60), 0.01), 0.02)])
    assert error == pytest.approx(0.01)


def test_reasons_beyond_the_third_are_counted_by_their_joints():
    reasons = dict(zip("abcdef", ("slow", "slow", "late", "stuck", "weak", "weak"), strict=True))
    assert with_reasons(reasons) == "a, b (slow), c (late), d (stuck) and 2 more"


def test_the_same_joint_with_requests_at_another_rate_has_its_intervals_moved_with_it():
    intervals = {"lag": (0.03, 0.034), "gain": (40.0, 50.0), "v_max": (5.0, 6.0)}
    joint = JointModel.ers210a().with_evidence(SEEN._replace(intervals=intervals))
    other = joint.requested_every(0.02)
    later, gain = other.lag - joint.lag, joint.theta_0 / other.theta_0
    assert later == pytest.approx(-0.5 * (0.008 - 0.02 / 3.0))
    assert gain > 1.01
    assert other.evidence.intervals == {
        "lag": pytest.approx((0.03 + later, 0.034 + later)),
        "gain": pytest.approx((40.0 * gain, 50.0 * gain)),
        "v_max": (5.0, 6.0),
    }
    same = joint.requested_every(2.0 * joint.tick)
    assert (same.hold, same.evidence) == (2, joint.evidence)


def test_an_error_that_the_noise_hides_may_be_none():
    noise = 0.002 * np.random.default_rng(0).standard_normal((1, len(PHASE)))
    hidden = errors_of_motion([Run(0.3 * np.sin(PHASE), noise, 0.02)], noise=0.002)
    assert hidden.spread[0] == 0.0
    shown = errors_of_motion([Run(0.3 * np.sin(PHASE), noise, 0.02)], noise=0.001)
    assert shown.spread[0] > 0.5


def test_evidence_that_is_none_is_refused():
    with pytest.raises(InvalidInput, match="evidence: got 'much', expected an Evidence or None"):
        JointModel.ers210a().with_evidence("much")


REFUSED = Evidence(verdict="refused", reason='the joint is "stuck"')


def test_models_near_pure_delays_and_motion_beyond_the_tests_are_listed_by_joint():
    shares = (0.93, 0.8, 0.85, math.nan)
    known = [*(Evidence(over_delay=share) for share in shares), None]
    near = "on rows held out the errors of models are near those of pure delays: a (93 %), c (85 %)"
    assert unproven_gains("abcde", known) == near
    assert not unproven_gains("b", known[1:2])
    ways = (("speed", "load"), (), ("moving requests",))
    told = [Expectation(0.1, each) for each in ways]
    beyond = "a (speed, load), c (moving requests: the logs hold steps only)"
    assert untested_words("abc", told).endswith(f"errors may be larger: {beyond}")
    assert not untested_words("b", told[1:2])


def test_who_reads_or_streams_a_model_that_is_not_to_be_planned_with_is_warned_once(tmp_path):
    bad, good = (JointModel.ers210a().with_evidence(each) for each in (REFUSED, SEEN))
    text = models_text({"hip": bad, "knee": bad, "ankle": good})
    (tmp_path / "arm.toml").write_text(text)
    words = "do not plan with the models of hip, knee .the joint is .stuck..: identify them anew"
    with pytest.warns(UserWarning, match=words) as read:
        models = planner.read_models(tmp_path / "arm.toml")
    with pytest.warns(UserWarning, match=words) as streamed:
        planner.Stream(models, preview=25)
    assert [each.filename for each in (*read, *streamed)] == [__file__, __file__]
    assert models["hip"].evidence == REFUSED
    with pytest.warns(UserWarning, match="the model of knee"):
        JointModel.from_toml(tmp_path / "arm.toml", "knee")
    assert JointModel.from_toml(tmp_path / "arm.toml", "ankle").evidence == SEEN
    planner.Stream({"ankle": models["ankle"]}, preview=25)


def test_a_model_that_a_delay_beats_is_refused_and_one_alone_is_named_in_the_singular():
    worse = Evidence(verdict="worse than a delay")
    assert worse.refused
    assert worse.leaves_top_speed_open
    words = "do not plan with the model of {} (worse than a delay): "
    words += "use --method shift, or identify it anew"
    assert refusal({"hip": worse, "knee": SEEN, "ankle": None}) == words.format("hip")
    assert refusal({"": worse, "knee": SEEN}) == words.format("every other joint")
    of_two = refusal({"hip": worse, "knee": REFUSED})
    assert of_two.endswith(": identify them anew"), "no shift is recommended for the knee"
    assert not refusal({"hip": None, "knee": SEEN})


def test_the_only_model_of_a_file_is_warned_of_as_the_model(tmp_path):
    JointModel.ers210a().with_evidence(REFUSED).to_toml(tmp_path / "joint.toml")
    with pytest.warns(UserWarning, match="^do not plan with the model .the joint is .stuck..: ide"):
        planner.read_models(tmp_path / "joint.toml")


@pytest.mark.parametrize("verdict", [None, "holds", "usable"])
def test_models_that_may_be_planned_with_are_read_without_a_word(tmp_path, verdict):
    known = SEEN._replace(verdict=verdict, reason="it misses 3 % of the motion" if verdict else "")
    JointModel.ers210a().with_evidence(known).to_toml(tmp_path / "joint.toml")
    assert planner.read_models(tmp_path / "joint.toml")[""].evidence == known


def test_with_ticks_of_another_length_the_intervals_hold_the_parameters_of_the_same_joint():
    joint = JointModel(
        v_max=5.0,
        theta_0=0.1,
        lag=0.02,
        acceleration_time=0.02,
        dead_band=0.01,
        time_constant=0.01,
        max_acceleration=500.0,
    )
    intervals = {"theta_0": (0.098, 0.102), "max_acceleration": (480.0, np.inf)}
    other = joint.with_evidence(SEEN._replace(intervals=intervals)).requested_every(0.02)
    assert other.max_acceleration != joint.max_acceleration
    low, high = other.evidence.intervals["theta_0"]
    assert (low / other.theta_0, high / other.theta_0) == pytest.approx((0.98, 1.02))
    low, high = other.evidence.intervals["max_acceleration"]
    assert (low - other.max_acceleration, high) == (pytest.approx(-20.0), np.inf)


def test_what_is_known_of_a_joint_moves_with_its_gain_and_its_lag():
    seen = Evidence(intervals={"lag": (0.01, 0.03), "gain": (10.0, 12.0), "v_max": (4.0, 5.0)})
    moved = seen.moved({"gain": 2.0}, {"lag": 0.005}).intervals
    assert moved == {
        "lag": pytest.approx((0.015, 0.035)),
        "gain": (20.0, 24.0),
        "v_max": (4.0, 5.0),
    }
    assert seen.moved({}, {"lag": -0.02}).intervals["lag"] == pytest.approx((0.0, 0.01))
