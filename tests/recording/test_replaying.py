"""Recordings replayed at any speed: the requests, their promise, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner import InvalidInput, Log, replay, simulate
from planner.arrays import rms
from planner.identification.log import Doubt
from planner.model.evidence import Evidence
from planner.recording.recorded_path import is_gripper, recorded_path
from planner.recording.replaying import replay_at
from tests.instances import SERVO

OWN = SERVO.period
COUNT = 150

SAGGING = replace(SERVO, compliance=0.05, speed_per_torque=0.5)
"""The servo under loads: it sags by 0.05 rad/(N m)."""


def asked(size=0.6):
    """A motion that begins and ends at rest [rad]."""
    phase = np.linspace(0.0, 2.0 * np.pi, COUNT)
    return size * (1.0 - np.cos(phase)) / 2.0


def recorded(joint="elbow", *, requests=None, times=None, **others):
    """A log of the servo as its own model answers."""
    requests = asked() if requests is None else requests
    angles = simulate(SERVO, requests, cyclic=False)
    times = OWN * np.arange(len(requests)) if times is None else times
    return Log(times=times, requests=requests, angles=angles, joint=joint, **others)


def test_at_its_own_speed_the_joint_repeats_what_it_did_to_the_last_row():
    log = recorded()
    made = replay(log, SERVO, smoothness=0.0)
    (joint,) = made.joints
    assert made.requests.shape == (COUNT, 1)
    assert not any(each.flags.writeable for each in (made.requests, made.moments))
    assert joint.desired == pytest.approx(log.angles, abs=1e-12)
    again = simulate(SERVO, made.requests[:, 0], cyclic=False, start=log.angles[0])
    assert joint.predicted == pytest.approx(again, abs=1e-12)
    assert rms(joint.errors["planned"]) < 1e-3 * rms(joint.errors["direct"])
    for count in range(20, 150):
        path = recorded_path([recorded(requests=asked()[:count])], SERVO)
        assert len(path.moments(1.0)) == count


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5, 2.0])
def test_the_plan_is_closest_whatever_the_speed(speed):
    (joint,) = replay(recorded(), SERVO, speed=speed).joints
    errors = {kind: rms(each) for kind, each in joint.errors.items()}
    assert errors["planned"] <= errors["shifted"] <= errors["direct"]
    assert errors["planned"] >= joint.inversion.lower_bound - 1e-9
    assert len(joint.requests) == int((COUNT - 1) / speed + 1e-6) + 1


def test_the_action_is_what_was_asked():
    log = recorded()
    (joint,) = replay(log, SERVO, track="action").joints
    assert joint.desired == pytest.approx(log.requests, abs=1e-12)
    assert joint.recorded_requests == pytest.approx(log.requests, abs=1e-12)
    assert joint.recorded_angles == pytest.approx(log.angles, abs=1e-12)
    assert rms(joint.errors["planned"]) < 0.1 * rms(joint.recorded_errors)


def test_grippers_and_joints_without_a_model_get_recorded_requests_unless_named_or_alone():
    elbow, jaw, tail = recorded("elbow"), recorded("Jaw", unit="1"), recorded("tail")
    made = replay([elbow, jaw, tail], {"elbow": SERVO, "Jaw": SERVO}, speed=1.5)
    assert all(map(is_gripper, ("Claw", "left_finger2", "THUMB", "hand", "jaw", "gripper.pos")))
    reasons = {each.name: each.path.reason for each in made.joints}
    assert reasons == {"elbow": "", "Jaw": "a gripper", "tail": "no model"}
    moments = OWN * 1.5 * np.arange(len(made.requests))
    assert made.requests[:, 1] == pytest.approx(np.interp(moments, jaw.times, jaw.requests))
    only = recorded_path([elbow, jaw, tail], {"elbow": SERVO}, joints=["elbow"])
    assert [each.reason for each in only.joints] == ["", "a gripper", "not chosen"]
    logs = [recorded("elbow"), recorded("gripper", unit="1")]
    named = replay(logs, SERVO, joints=["gripper"])
    assert [each.name for each in named.planned] == ["gripper"]
    assert [each.name for each in replay(logs[1], SERVO).planned] == ["gripper"]


def test_shares_of_a_range_stay_inside_it():
    log = recorded("jaw", requests=asked(size=1.0), unit="1")
    made = replay(log, SERVO, speed=4.0)
    assert made.requests.min() >= 0.0
    assert made.requests.max() <= 1.0
    beyond = recorded("jaw", requests=asked(size=1.3) - 0.1, unit="1")
    assert np.max(beyond.angles) < 1.198
    assert recorded_path(beyond, SERVO).limits == {"jaw": pytest.approx((-0.1, 1.2), abs=1e-3)}
    sags = replace(SERVO, offset=-0.05)
    assert recorded_path(log, sags).limits == {"jaw": pytest.approx((-0.05, 1.05))}
    both = recorded_path([recorded("elbow"), log], SERVO, limits={"elbow": (-0.5, 0.7)})
    assert both.limits == {"elbow": (-0.5, 0.7), "jaw": (0.0, 1.0)}


def test_jitter_and_gaps_are_bridged_and_told_where_they_are_replayed():
    times = OWN * np.arange(COUNT) + np.random.default_rng(1).uniform(0.0, 2e-4, COUNT)
    times[100:] += 0.5
    made = replay(recorded(times=times), SERVO)
    assert made.period == pytest.approx(OWN, rel=1e-3)
    assert len(made.requests) == pytest.approx(COUNT + 25, abs=1)
    assert any("gap of 0.5" in remark for remark in made.path.remarks)
    times = OWN * np.arange(COUNT)
    times[80:] += 0.5
    log = recorded(times=times)
    for part, told in (({}, True), ({"begin": 2.2}, False), ({"end": 1.2}, False)):
        remarks = replay(log, SERVO, **part).path.remarks
        assert any("is bridged by a straight line" in each for each in remarks) == told


def test_joints_that_begin_later_keep_their_time():
    first, late = recorded("a"), recorded("b")
    late = replace(late, times=late.times + 0.1)
    for logs in ([first, late], [late, first]):
        made = replay(logs, SERVO, begin=0.2)
        assert made.path.last == pytest.approx(first.times[-1])
        desired = {each.name: each.desired for each in made.joints}
        assert desired["a"][0] == pytest.approx(np.interp(0.2, first.times, first.angles))
        assert desired["b"][0] == pytest.approx(np.interp(0.2, late.times, late.angles))
        with pytest.raises(InvalidInput, match=r"begin: got 0\.05 s, expected .*, 0\.1 to 2\.98 s"):
            replay(logs, SERVO, begin=0.05)


def test_parts_faster_than_the_joint_are_named_up_to_the_end_of_the_recording():
    (joint,) = replay(recorded(requests=asked(size=3.0)), SERVO, speed=3.0).joints
    assert joint.too_fast
    steps = np.abs(np.diff(joint.desired)) / OWN
    inside = {k for span in joint.too_fast for k in range(*(round(end / OWN) for end in span))}
    assert inside == set(np.flatnonzero(steps > SERVO.v_max).tolist())
    requests = np.concatenate([np.zeros(60), 0.1 * np.arange(1.0, 31.0)])  # 5 rad/s
    times = OWN * np.arange(90)
    log = Log(times=times, requests=requests, angles=requests, joint="elbow")
    (joint,) = replay(log, SERVO, track="action", smoothness=0.0).joints
    (span,) = joint.too_fast
    assert span == pytest.approx((59 * OWN, 89 * OWN))


def test_requests_as_recorded_the_path_itself_and_its_best_shift_are_run_by_the_model():
    (joint,) = replay(recorded(), SERVO, speed=1.5).joints
    own, path = joint.recorded_requests, joint.desired
    assert own == pytest.approx(joint.path.at(joint.moments, joint.path.requests), abs=1e-12)

    def run(requests):  # the first request holds the joint where the plan begins
        sent = np.append(joint.requests[:1], requests[1:])
        return simulate(SERVO, sent, cyclic=False, start=path[0])

    def early(lead):
        return np.interp(np.arange(len(path)) + lead / OWN, np.arange(len(path)), path)

    assert joint.angles("resent") == pytest.approx(run(own), abs=1e-12)
    assert joint.angles("direct") == pytest.approx(run(path), abs=1e-12)
    delay = SERVO.lag + SERVO.acceleration_time / 2.0 + SERVO.theta_0 / SERVO.v_max
    assert joint.shift.leads[0] == pytest.approx(delay, abs=OWN)
    assert joint.angles("shifted") == pytest.approx(run(early(joint.shift.leads[0])), abs=1e-12)
    for lead in (joint.shift.leads[0] - OWN / 4.0, joint.shift.leads[0] + OWN / 4.0):
        assert rms(joint.errors["shifted"]) < rms(run(early(lead)) - path)


@pytest.mark.parametrize(
    ("error", "off", "serve"),
    [(0.45, -1, False), (0.55, -1, True), (0.55, 19, True), (0.55, 20, False), (0.55, 149, False)],
)
def test_recorded_requests_may_serve_by_half_of_their_error_where_the_torque_was_on(
    error, off, serve
):
    """Of a slower joint than the model, whose torque was off at one row, before the part or in it.

    The error to expect is the root of the squares of the plan's and the model's.
    """
    slow = replace(SERVO, theta_0=1.2 * SERVO.theta_0)
    angles = simulate(slow, asked(), cyclic=False)
    log = replace(recorded(), angles=angles, torque_on=np.arange(COUNT) != off)
    part = {"begin": 20 * OWN, "smoothness": 0.0}
    (joint,) = replay(log, SERVO, **part).joints
    size = rms(joint.errors["resent"])
    of_model = math.sqrt((error * size) ** 2 - rms(joint.errors["planned"]) ** 2)
    known = SERVO.with_evidence(Evidence(of_model))
    made = replay([log, replace(log, joint="wrist")], known, **part)
    assert made.resent_may_serve == (made.joints if serve else ())


@pytest.mark.parametrize(
    ("changed", "serve"), [({}, True), ({"speed": 1.25}, False), ({"track": "action"}, False)]
)
def test_recorded_requests_may_serve_only_along_the_recorded_angles_at_their_speed(changed, serve):
    made = replay(recorded(), SERVO.with_evidence(Evidence(0.5)), **changed)
    assert made.joints[0].resent_may_serve
    assert made.resent_may_serve == (made.joints if serve else ())


@pytest.mark.parametrize(
    ("error", "off", "speed", "fits"),
    [(None, -1, 1.0, False), (1.05, -1, 1.5, True), (0.95, -1, 1.5, False), (0.1, 75, 1.0, None)],
)
def test_a_model_fits_a_recording_up_to_twice_the_largest_error_to_expect(error, off, speed, fits):
    """Of a joint that trails the model by 0.1 s; by no test that of the requests, best delayed."""
    angles = simulate(replace(SERVO, lag=SERVO.lag + 0.1), asked(), cyclic=False)
    log = replace(recorded(), angles=angles, torque_on=np.arange(COUNT) != off)
    size = rms(angles[:-1] - recorded().angles[:-1])
    tested = None if error is None else Evidence(error * size / 2.0 / 1.5, spread=(0.5, 1.5))
    (joint,) = replay(log, SERVO.with_evidence(tested), speed=speed).joints
    assert joint.fits is fits
    assert fits is None or joint.fit[0] == pytest.approx(size, rel=1e-2)


@pytest.mark.parametrize("rate", [None, 10.0, 100.0])
def test_a_recording_by_the_model_itself_fits_it_at_any_rate_of_the_replay(rate):
    """Quick requests at 50 Hz: held for 0.1 s instead they would move it otherwise."""
    model = SERVO.requested_every(0.02)
    requests = 0.3 * np.sin(2.0 * np.pi * np.arange(100) / 25.0)
    angles = simulate(model, requests, cyclic=False)
    log = Log(times=0.02 * np.arange(100), requests=requests, angles=angles)
    (joint,) = replay(log, model.with_evidence(Evidence(1e-3)), rate=rate).joints
    assert joint.fits
    assert joint.fit[0] < 1e-3  # rad: a joint with other ticks answers the same but for rounding


@pytest.mark.parametrize("known", [True, False])
def test_a_model_that_feels_load_is_judged_where_the_load_is_known(known):
    load = 0.5 * np.cos(np.linspace(0.0, 6.0, COUNT))
    angles = simulate(SAGGING, asked(), cyclic=False, load=load)
    log = replace(recorded(), angles=angles, load=load if known else None)
    assert replay(log, SAGGING).joints[0].fits is (True if known else None)


@pytest.mark.parametrize(("noise", "track"), [(0.0, "state"), (6e-3, "state"), (6e-3, "action")])
def test_requests_that_follow_noise_turn_more_often_than_the_recorded_ones(noise, track):
    log = recorded()
    angles = log.angles + noise * np.random.default_rng(0).standard_normal(COUNT)
    (joint,) = replay(replace(log, angles=angles), SERVO, track=track).joints
    assert bool(joint.rough) == (noise > 0.0 and track == "state")


def test_the_unit_is_asked_about_where_the_angles_of_all_joints_are_doubted():
    doubted = recorded(notes=("a note", Doubt("actual angles span only 1 degrees: are they rad?")))
    others = ([], [recorded("wrist")], [recorded("jaw", unit="1")], [replace(doubted, joint="hip")])
    asked = [recorded_path([doubted, *logs], SERVO).remarks for logs in others]
    words = f"elbow: {doubted.notes[1]}"
    assert asked == [(words,), (), (words,), (f"all joints, such as {words}",)]
    slow = recorded(notes=("are the times in seconds?",))
    assert recorded_path([slow, recorded("wrist")], SERVO).remarks == slow.notes


def test_a_recording_faster_than_the_top_speed_contradicts_the_model_where_it_is_replayed():
    log = recorded()
    fastest = np.max(np.abs(np.diff(log.angles))) / OWN
    slow = {each: replace(SERVO, v_max=each * fastest) for each in (0.7, 1.1)}
    both = replay([log, replace(log, joint="wrist")], {"elbow": slow[0.7], "wrist": slow[1.1]})
    assert both.contradicted == ("elbow",)
    assert replay(log, slow[0.7], end=0.1 * OWN * COUNT).contradicted == ()


def carried(joint="elbow"):
    """A log of the sagging servo under a torque that grows, which the log has."""
    torques = np.linspace(0.0, 2.0, COUNT)
    angles = simulate(SAGGING, asked(), cyclic=False, load=torques)
    times = OWN * np.arange(COUNT)
    return Log(times=times, requests=asked(), angles=angles, joint=joint, load=torques)


def test_the_torque_of_a_log_acts_at_the_moments_of_the_replay_on_all_kinds_of_requests():
    log = carried()
    (joint,) = replay(log, SAGGING, speed=2.0, smoothness=0.0).joints
    torques = np.interp(joint.moments, log.times, log.load)
    np.testing.assert_allclose(joint.inversion.plan.task.loads[joint.inversion.column], torques)
    assert recorded_path(log, SERVO).joints[0].load is None  # which this model does not feel
    (own,) = replay(log, SAGGING, smoothness=0.0).joints
    start = float(own.desired[0])
    for requests, angles in (
        (own.requests, own.predicted),
        (np.append(own.requests[0], own.desired[1:]), own.angles("direct")),
        (np.append(own.requests[0], log.requests[1:]), own.angles("resent")),
    ):
        expected = simulate(SAGGING, requests, cyclic=False, start=start, load=log.load)
        np.testing.assert_allclose(angles, expected, rtol=0.0, atol=1e-12)
    assert rms(own.errors["resent"]) < 1e-9  # what was sent makes what was done


def test_the_bound_of_each_joint_of_a_replay_is_its_own_and_of_the_rms_whatever_the_norm():
    logs = [recorded("elbow", requests=asked(3.0)), recorded("wrist", requests=asked(2.5))]
    largest, mean = (replay(logs, SERVO, speed=2.0, norm=norm).joints for norm in ("max", "rms"))
    bounds = [[each.lower_bound for each in joints] for joints in (largest, mean)]
    assert bounds[0] == pytest.approx(bounds[1])
    assert mean[0].lower_bound > 1.1 * mean[1].lower_bound > 0.0
    assert largest[0].lower_bound < largest[0].inversion.lower_bound
    pose = replay(logs[0], replace(SERVO, compliance=0.01), load=np.cos)
    assert math.isnan(pose.joints[0].lower_bound)


def test_the_load_of_a_pose_that_belongs_to_the_recording_acts_unless_another_is_given():
    path = recorded_path([recorded()], replace(SERVO, compliance=0.05))
    moments, given = path.moments(2.0), []

    def load_at(at):
        given.append(at)
        return np.cos

    posed = replace(path, load_at=load_at)
    own, same, other, none = (
        replay_at(each, moments, load=load).requests
        for each, load in ((posed, None), (path, np.cos), (posed, np.sin), (path, None))
    )
    assert [len(at) for at in given] == [len(moments)]
    np.testing.assert_array_equal(own, same)
    assert not np.allclose(own, other)
    assert not np.allclose(own, none)


def test_a_first_request_off_the_middle_of_the_dead_band_leaves_the_joint_where_it_was():
    """Under all kinds of requests: dry friction holds it there."""
    sticky = replace(SERVO, dead_band=0.05)
    (joint,) = replay(recorded(), sticky, speed=2.0, begin=0.6).joints
    assert abs(joint.requests[0] - joint.desired[0]) > 0.02
    for angles in map(joint.angles, ("planned", "direct", "resent", "shifted")):
        assert angles[0] == joint.desired[0]
    sent = np.append(joint.requests[:1], joint.desired[1:])
    start = float(joint.desired[0])
    expected = simulate(sticky, sent, cyclic=False, start=start)
    np.testing.assert_array_equal(joint.angles("direct"), expected)
