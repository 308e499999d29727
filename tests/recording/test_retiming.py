"""How fast a recording can be replayed: witnesses, proofs, and factors that vary along it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner import InvalidInput, JointModel, Log, fastest, replay, simulate
from planner.exceptions import Infeasible
from planner.model.evidence import Evidence

SERVO = JointModel(v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=0.005, hold=4)
PERIOD = SERVO.period
TOLERANCE = 0.02


def log(requests, joint="elbow", **others):
    angles = simulate(SERVO, requests, cyclic=False)
    times = PERIOD * np.arange(len(requests))
    return Log(times=times, requests=requests, angles=angles, joint=joint, **others)


def swing(size, count):
    return size * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, count))) / 2.0


@pytest.fixture(scope="module")
def constant():
    """A swing of 0.8 rad in three seconds, as fast as it may be."""
    return fastest(log(swing(0.8, 150)), SERVO, tolerance=TOLERANCE)


def test_the_replay_keeps_the_tolerance(constant):
    (joint,) = constant.replay.joints
    assert np.max(np.abs(joint.errors["planned"])) <= TOLERANCE
    assert constant.speed == constant.constant
    assert constant.factors[:-1] == pytest.approx(constant.speed)


def test_a_bound_by_a_top_speed_that_was_never_seen_holds_for_the_model_only(constant):
    model = SERVO.with_evidence(Evidence(0.01))
    found = fastest(log(swing(0.8, 150)), model, tolerance=TOLERANCE)
    assert found.impossible.of_model_only
    assert not constant.impossible.of_model_only


def test_the_bound_proves_a_speed_a_little_higher_impossible(constant):
    assert constant.speed < constant.impossible.speed < 1.1 * constant.speed
    assert constant.impossible.bound > 1.0
    made = replay(log(swing(0.8, 150)), SERVO, speed=constant.impossible.speed, norm="max")
    assert made.max_error > TOLERANCE


def test_the_curve_orders_plans_and_bounds(constant):
    for each in constant.curve:
        assert each.bound <= each.planned * (1.0 + 1e-6)
    kept = [each.planned <= 1.0 for each in constant.curve]
    assert kept == sorted(kept, reverse=True)
    assert constant.speed in [each.speed for each in constant.curve]
    assert constant.curve[0].direct > 1.0


def test_of_two_joints_the_one_that_is_farther_off_decides(constant):
    logs = [log(swing(0.8, 150)), log(swing(0.1, 150), "wrist")]
    calm = SERVO.with_evidence(Evidence(0.01))  # its top speed was never seen
    found = fastest(logs, {"elbow": SERVO, "wrist": calm}, tolerance=TOLERANCE)
    assert found.speed == pytest.approx(constant.speed, rel=0.02)
    assert (found.impossible.joint, found.impossible.of_model_only) == ("elbow", False)
    for each, alone in zip(found.curve, constant.curve, strict=True):
        assert each.bound == pytest.approx(alone.bound, rel=0.2)
        assert each.direct == pytest.approx(alone.direct, rel=0.2)


def test_of_two_joints_that_are_too_slow_the_one_whose_top_speed_is_known_is_named():
    logs = [log(swing(0.4, 75)), log(swing(0.4, 75), "wrist")]
    unseen = SERVO.with_evidence(Evidence(0.01))
    found = fastest(logs, {"elbow": unseen, "wrist": SERVO}, tolerance=TOLERANCE)
    assert (found.impossible.joint, found.impossible.of_model_only) == ("wrist", False)


def test_what_was_asked_and_not_done_contradicts_no_model():
    times = PERIOD * np.arange(60)
    asked = np.where(times < 0.4, 0.0, 1.0)
    steps = Log(times=times, requests=asked, angles=simulate(SERVO, asked, cyclic=False))
    found = fastest(steps, SERVO, tolerance=0.1, track="action", smoothness=0.0)
    assert found.contradicted == ()
    assert found.speed < 1.0


def test_a_varying_factor_is_faster_where_it_can_be():
    requests = np.concatenate([swing(0.8, 100), swing(0.2, 150)])
    found = fastest(log(requests), SERVO, tolerance=TOLERANCE, retime="varying")
    (joint,) = found.replay.joints
    assert np.max(np.abs(joint.errors["planned"])) <= TOLERANCE
    assert found.speed > 1.05 * found.constant
    assert (found.factors >= 0.0).all()
    moments = found.replay.moments
    assert moments[0] == 0.0
    assert moments[-1] == pytest.approx(PERIOD * 249, abs=found.factors[-2] * PERIOD)
    bends = np.abs(np.diff(found.factors[:-1])) / PERIOD
    assert np.max(bends) <= 2.0 * found.constant * 1.05


def test_a_share_of_a_range_may_be_off_by_as_many_percent():
    found = fastest(log(swing(0.8, 150), "jaw", unit="1"), SERVO, tolerance=np.radians(2.0))
    (joint,) = found.replay.joints
    assert 0.01 < np.max(np.abs(joint.errors["planned"])) <= 0.02


def test_a_tolerance_that_no_speed_keeps_is_refused():
    requests = 0.4 * np.sign(np.sin(np.arange(60)))
    times = PERIOD * np.arange(60)
    noise = Log(times=times, requests=requests, angles=requests + 1e-6 * times, joint="elbow")
    with pytest.raises(Infeasible, match="times as far off as allowed"):
        fastest(noise, SERVO, tolerance=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "tolerance: got none, or two"),
        ({"tolerance": 0.1, "foot_tolerance": 0.1}, "tolerance: got none, or two"),
        ({"tolerance": -1.0}, "expected more than 0"),
        ({"foot_tolerance": 0.01}, "needs the leg"),
        ({"tolerance": 0.1, "retime": "wild"}, "expected 'constant' or 'varying'"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, message):
    with pytest.raises(InvalidInput) as refusal:
        fastest(log(swing(0.8, 150)), SERVO, **arguments)
    assert message in str(refusal.value)


def test_a_recording_that_its_model_refutes_at_its_own_speed_proves_no_limit():
    joint = JointModel.ers210a().requested_every(0.04)
    slow = replace(joint, v_max=0.3 * joint.v_max, theta_0=0.3 * joint.theta_0)
    times = joint.period * np.arange(20)
    asked = 0.4 - 0.4 * np.cos(2.0 * np.pi * times)
    log = Log(times=times, requests=asked, angles=simulate(joint, asked, cyclic=False))
    found = fastest(log, slow, tolerance=np.radians(2.0))
    assert found.speed < 1.0
    assert (found.contradicted, found.impossible) == (("joint",), None)
