"""What measured angles tell: a sensor's delay, a disturbance, and what cannot be of the joint."""

import math
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from planner import InvalidTrajectory, JointModel, Trial
from planner.learning.measurements import (
    LATENCY_ERROR,
    agree,
    check_angles,
    check_trial,
    earlier,
    learnt,
    noise_of,
    pure_delay,
)
from planner.model.evidence import Evidence

COUNT = 2.0 * math.pi / 4096.0  # a count of a sensor of 12 bit [rad]
PHASE = 2.0 * np.pi * np.arange(60) / 60
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE)])
MODELLED = DESIRED + 0.01 * np.column_stack([np.cos(PHASE), np.sin(PHASE)])
REQUESTS = DESIRED + 0.05 * np.column_stack([np.cos(PHASE), -np.sin(PHASE)])
AWAY = 0.02 * np.sin(3.0 * PHASE)
MODEL = JointModel(v_max=5.0, theta_0=0.3, lag=0.03, acceleration_time=0.04, tick=0.01)
MODELS = [MODEL, MODEL]

LATE = 0.03 + 0.04 / 2.0 + 0.3 / 5.0
"""Lag, half the acceleration time and the time constant of the model's gain [s]."""

SAMPLES = 200
PERIOD = 0.02


def refused(message):
    """The context of a call that is refused with a message, or not where that is None."""
    return nullcontext() if message is None else pytest.raises(InvalidTrajectory, match=message)


def of_joint_2(angles):
    """Two cycles, in which joint 1 is measured as it is by its model, but for 0.02 rad."""
    return np.stack([np.column_stack([MODELLED[:, 0] + AWAY, angles])] * 2)


@pytest.mark.parametrize(
    ("noise", "off", "together"),
    [
        (0.0, 0.0049, True),  # in shares of the range of the second joint
        (0.0, 0.0051, False),
        (0.02, 2.8, True),  # in standard deviations of the difference of the means
        (0.02, 3.2, False),
    ],
)
def test_cycles_agree_within_three_deviations_or_half_a_percent_of_the_range(noise, off, together):
    rng = np.random.default_rng(1)
    first, second = (rng.standard_normal((count, 60, 2)) for count in (40, 10))
    first, second = (noise * (each - each.mean(axis=0)) for each in (first, second))
    cycle = 2.0 * MODELLED
    unit = noise * math.sqrt(1.0 / 40.0 + 1.0 / 10.0) or np.ptp(cycle[:, 1])
    second += [0.0, off * unit]
    assert agree(cycle + first, cycle + second, cyclic=True) == together


def test_a_joint_at_rest_agrees_within_a_count_of_its_sensor():
    at_rest = np.zeros((3, 60, 1))
    assert agree(at_rest, at_rest + COUNT, cyclic=True)
    assert not agree(at_rest, at_rest + 2.0 * COUNT, cyclic=True)


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        (DESIRED[:, 1] + AWAY, None),
        (0.1 + 1.4 * COUNT * (PHASE > 1.0), "joint 2 does not move: its angles have a range of"),
        (0.1 + 1.6 * COUNT * (PHASE > 1.0), None),
        (REQUESTS[:, 1] + 0.9e-4, "the angles of joint 2 are its requests"),
        (REQUESTS[:, 1] + 1.1e-4, None),
        (DESIRED[:, 1] + 0.9e-4, "the angles of joint 2 are the desired ones"),
        (DESIRED[:, 1] + 1.1e-4, None),
    ],
)
def test_the_joint_whose_angles_were_not_measured_is_named(angles, message):
    with refused(message):
        check_angles(of_joint_2(angles), REQUESTS, DESIRED, MODELLED, MODELLED)


@pytest.mark.parametrize(("apart", "message"), [(0.9e-4, None), (0.9e-9, "desired ones")])
def test_a_joint_that_is_expected_near_its_path_may_measure_that_but_not_to_the_last_digit(
    apart, message
):
    expected = DESIRED + 0.05 * (MODELLED - DESIRED)
    with refused(message):
        check_angles(of_joint_2(DESIRED[:, 1] + apart), REQUESTS, DESIRED, MODELLED, expected)


@pytest.mark.parametrize(("counts", "message"), [(14.0, None), (16.0, "joint 2 does")])
def test_a_joint_that_should_move_by_fifteen_counts_of_its_sensor_may_rest(counts, message):
    share = [1.0, counts * COUNT / np.ptp(MODELLED[:, 1])]
    with refused(message):
        check_angles(of_joint_2(0.0 * PHASE), REQUESTS, DESIRED, share * MODELLED, MODELLED)


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (81.0, None),
        (79.0, "move 79 times as far as the model: are they degrees"),
        (41.0, "move 41 times as far"),
        (39.0, None),
        (1.0 / 39.0, None),
        (1.0 / 41.0, "move 1/41 as far as the model: are they radians"),
        (1.0 / 79.0, "1/79 as far"),
        (1.0 / 81.0, None),
    ],
)
@pytest.mark.parametrize("resting", [False, True])
def test_angles_of_another_unit_move_forty_to_eighty_times_as_far_or_as_little(
    resting, factor, message
):
    """All of them, though one of the joints may rest."""
    moving = [1.0, 0.0 if resting else 1.0]
    requests, desired, modelled = (each * moving for each in (REQUESTS, DESIRED, MODELLED))
    with refused(message):
        check_angles(factor * modelled[np.newaxis], requests, desired, modelled, modelled)


def test_a_joint_in_shares_may_be_anywhere_in_its_range_and_others_30_degrees_off():
    holding = of_joint_2(MODELLED[:, 1] + np.radians(45.0))
    share = MODEL.with_evidence(Evidence(unit="range"))
    check_trial(holding, MODELLED, [], [], [MODEL, share])
    with pytest.raises(InvalidTrajectory, match="of joint 2 are on average"):
        check_trial(holding, MODELLED, [], [], MODELS)


def test_another_motion_and_the_angles_of_an_earlier_trial_are_refused_by_number():
    trials = [Trial(requests=REQUESTS, measured=of_joint_2(k * AWAY), error=0.1) for k in range(3)]
    others, cycles = [0.5 * MODELLED] * 3, of_joint_2(MODELLED[:, 1])
    check_trial(cycles, MODELLED, trials, others, MODELS)
    with pytest.raises(InvalidTrajectory, match=r"the angles of joint 2 are .* from those of the "):
        check_trial(of_joint_2(-1.1 * MODELLED[:, 1]), MODELLED, trials, others, MODELS)
    check_trial(of_joint_2(MODELLED[:, 1] + np.radians(29.0)), MODELLED, trials, others, MODELS)
    with pytest.raises(InvalidTrajectory, match=r"of joint 2 are on average 1.6 rad from those of"):
        check_trial(of_joint_2(MODELLED[:, 1] + np.pi / 2.0), MODELLED, trials, others, MODELS)
    again = np.concatenate([cycles, trials[1].measured[1:] + 0.9e-9])
    with pytest.raises(InvalidTrajectory, match="same angles as in trial 2, whose requests were o"):
        check_trial(again, MODELLED, trials, others, MODELS)
    check_trial(again, MODELLED, trials, [MODELLED] * 3, MODELS)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("number", [0, 3, 10, 40, 80])
def test_of_one_frequency_the_cosine_of_its_phase_error_is_learnt(number, cyclic):
    k = np.arange(SAMPLES)
    if cyclic:
        hertz, rows = number / (SAMPLES * 0.01), np.cos(2.0 * np.pi * number * k / SAMPLES + 0.4)
    else:
        hertz, rows = number / (2.0 * SAMPLES * 0.01), np.cos(np.pi * number * (k + 0.5) / SAMPLES)
    trust = np.cos(min(2.0 * np.pi * hertz * LATENCY_ERROR * LATE, np.pi / 2.0))
    slow = replace(MODEL, lag=0.0, acceleration_time=0.01)  # every joint has its own
    two = np.column_stack([rows, rows])
    nothing = np.zeros((SAMPLES // 2 + 1 if cyclic else SAMPLES, 2))
    answer = learnt(two, nothing, [MODEL, slow], cyclic=cyclic)
    np.testing.assert_allclose(answer[:, 0], trust * rows, rtol=0.0, atol=1e-9)
    if 0.0 < trust < 1.0:
        assert np.max(np.abs(answer[:, 1])) > np.max(np.abs(answer[:, 0]))


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("cycles", [2, 3, 8])
def test_noise_between_cycles_has_its_variance_however_few_there_are(cycles, cyclic):
    rng = np.random.default_rng(cycles)
    trials = [rng.normal(scale=[0.01, 0.02], size=(cycles, 400, 2)) for _ in range(4)]
    power = noise_of(trials, np.zeros((400, 2)), cyclic=cyclic)
    np.testing.assert_allclose(np.sqrt(power.mean(axis=0)), [0.01, 0.02], rtol=0.05)


def test_twice_the_noise_is_taken_off_what_is_learnt_of_a_frequency():
    """Its power is averaged over five frequencies, of which the others have none."""
    rows = np.cos(2.0 * np.pi * 10 * np.arange(SAMPLES) / SAMPLES)[:, np.newaxis]
    known = replace(MODEL, lag=0.0, acceleration_time=0.01, theta_0=0.05, v_max=5.0)
    for share, left in ((0.1, 0.8), (0.45, 0.1), (0.55, 0.0)):
        noise = np.full((SAMPLES // 2 + 1, 1), share * SAMPLES / 4.0 / 5.0)
        answer = learnt(rows, noise, [known], cyclic=True)
        np.testing.assert_allclose(answer, left * rows, rtol=0.0, atol=0.01)


def motion(time):
    return 0.3 * np.sin(2.0 * np.pi * time / 4.0) + 0.1 * np.cos(2.0 * np.pi * time / 1.0)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("samples", [0.0, 0.4, -1.3, 22.7])
def test_a_delay_is_found_to_a_tenth_of_a_sample(samples, cyclic):
    time = PERIOD * np.arange(200)
    before = time - samples * PERIOD
    measured = motion(before if cyclic else np.maximum(before, 0.0)) + 0.05  # from rest or not
    delay, share = pure_delay(measured, motion(time), cyclic=cyclic)
    assert delay == pytest.approx(samples, abs=0.1)
    assert share == (pytest.approx(1.0, abs=0.05) if samples else 0.0)


@pytest.mark.parametrize("samples", [2.0, -3.0, 0.5])
def test_the_delay_of_one_of_several_joints_is_taken_off_its_angles_alone(samples):
    time = PERIOD * np.arange(200)
    measured = np.stack([np.column_stack([motion(time), motion(time + 1.0)])] * 2)
    moved = earlier(measured, [samples * PERIOD, 0.0], SimpleNamespace(period=PERIOD, cyclic=True))
    expected = np.column_stack([motion(time + samples * PERIOD), measured[0, :, 1]])
    np.testing.assert_allclose(
        moved, np.stack([expected] * 2), rtol=0.0, atol=1e-3
    )  # straight lines
