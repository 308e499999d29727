"""Recordings replayed at any speed: the requests, their promise, and what is refused."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from planner import InvalidInput, JointModel, Log, replay, simulate
from planner.model.evidence import Evidence
from planner.recording.recorded_path import is_gripper, recorded_path
from planner.recording.replaying import replay_at

SERVO = JointModel(v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=0.005, hold=4)
"""A servo that is asked 50 times a second."""

OWN = SERVO.period
COUNT = 150


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


def rms(errors):
    return float(np.sqrt(np.mean(errors**2)))


def test_at_its_own_speed_the_joint_repeats_what_it_did():
    log = recorded()
    made = replay(log, SERVO, smoothness=0.0)
    (joint,) = made.joints
    assert made.requests.shape == (COUNT, 1)
    assert not any(each.flags.writeable for each in (made.requests, made.moments))
    assert joint.desired == pytest.approx(log.angles, abs=1e-12)
    again = simulate(SERVO, made.requests[:, 0], cyclic=False, start=log.angles[0])
    assert joint.predicted == pytest.approx(again, abs=1e-12)
    assert rms(joint.errors["planned"]) < 1e-3 * rms(joint.errors["direct"])


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5, 2.0])
def test_the_plan_is_closest_whatever_the_speed(speed):
    (joint,) = replay(recorded(), SERVO, speed=speed).joints
    errors = {kind: rms(each) for kind, each in joint.errors.items()}
    assert errors["planned"] <= errors["shifted"] <= errors["direct"]
    assert errors["planned"] >= joint.inversion.lower_bound - 1e-9
    assert len(joint.requests) == int((COUNT - 1) / speed + 1e-6) + 1


def test_twice_as_fast_takes_half_the_time():
    log = recorded()
    made = replay(log, SERVO, speed=2.0)
    assert made.joints[0].desired == pytest.approx(log.angles[::2], abs=1e-12)


def test_the_action_is_what_was_asked():
    log = recorded()
    (joint,) = replay(log, SERVO, track="action").joints
    assert joint.desired == pytest.approx(log.requests, abs=1e-12)
    assert joint.recorded_requests == pytest.approx(log.requests, abs=1e-12)
    assert joint.recorded_angles == pytest.approx(log.angles, abs=1e-12)
    assert rms(joint.errors["planned"]) < 0.1 * rms(joint.recorded_errors)


def test_the_errors_of_the_recorded_run_are_those_of_the_part_that_is_replayed():
    log = recorded()
    (joint,) = replay(log, SERVO, begin=20 * OWN, end=70 * OWN).joints
    assert joint.recorded_errors == pytest.approx((log.angles - log.requests)[20:71], abs=1e-12)
    (whole,) = replay(log, SERVO).joints
    assert len(whole.recorded_errors) == COUNT


def test_grippers_and_joints_without_a_model_get_their_recorded_requests():
    elbow, jaw, tail = recorded("elbow"), recorded("Jaw", unit="1"), recorded("tail")
    made = replay([elbow, jaw, tail], {"elbow": SERVO, "Jaw": SERVO}, speed=1.5)
    assert all(map(is_gripper, ("Claw", "left_finger2", "THUMB", "hand", "jaw", "gripper.pos")))
    reasons = {each.name: each.path.reason for each in made.joints}
    assert reasons == {"elbow": "", "Jaw": "a gripper", "tail": "no model"}
    moments = OWN * 1.5 * np.arange(len(made.requests))
    assert made.requests[:, 1] == pytest.approx(np.interp(moments, jaw.times, jaw.requests))
    assert made.summary()["joints"]["tail"]["reason"] == "no model"
    only = recorded_path([elbow, jaw, tail], {"elbow": SERVO}, joints=["elbow"])
    assert [each.reason for each in only.joints] == ["", "a gripper", "not chosen"]


def test_a_gripper_is_planned_where_it_is_named_or_alone():
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
    both = recorded_path([recorded("elbow"), log], SERVO, limits={"elbow": (-0.5, 0.7)})
    assert both.limits == {"elbow": (-0.5, 0.7), "jaw": (0.0, 1.0)}


def test_jitter_and_gaps_are_bridged_on_even_requests():
    times = OWN * np.arange(COUNT) + np.random.default_rng(1).uniform(0.0, 2e-4, COUNT)
    times[100:] += 0.5
    made = replay(recorded(times=times), SERVO)
    assert made.period == pytest.approx(OWN, rel=1e-3)
    assert len(made.requests) == pytest.approx(COUNT + 25, abs=1)
    assert any("gap of 0.5" in remark for remark in made.path.remarks)


def test_the_rate_may_be_any_number():
    made = replay(recorded(), SERVO, rate=49.85)
    assert made.period == pytest.approx(1.0 / 49.85)
    assert made.planned[0].inversion.model.hold == SERVO.hold


def test_joints_that_begin_later_keep_their_time():
    first, late = recorded("a"), recorded("b")
    late = replace(late, times=late.times + 0.1)
    for logs in ([first, late], [late, first]):
        made = replay(logs, SERVO, begin=0.2)
        assert made.path.last == pytest.approx(first.times[-1])
        desired = {each.name: each.desired for each in made.joints}
        assert desired["a"][0] == pytest.approx(np.interp(0.2, first.times, first.angles))
        assert desired["b"][0] == pytest.approx(np.interp(0.2, late.times, late.angles))


def test_a_gap_is_told_where_the_replay_bridges_it():
    times = OWN * np.arange(COUNT)
    times[80:] += 0.5
    log = recorded(times=times)
    for part, told in (({}, True), ({"begin": 2.2}, False), ({"end": 1.2}, False)):
        remarks = replay(log, SERVO, **part).path.remarks
        assert any("is bridged by a straight line" in each for each in remarks) == told


def test_parts_faster_than_the_joint_are_named():
    (joint,) = replay(recorded(requests=asked(size=3.0)), SERVO, speed=3.0).joints
    assert joint.too_fast
    steps = np.abs(np.diff(joint.desired)) / OWN
    inside = {
        k for span in joint.too_fast for k in range(round(span.first / OWN), round(span.last / OWN))
    }
    assert inside == set(np.flatnonzero(steps > SERVO.v_max).tolist())


def test_requests_as_recorded_the_path_itself_and_its_best_shift_are_run_by_the_model():
    (joint,) = replay(recorded(), SERVO, speed=1.5).joints
    own, path = joint.recorded_requests, joint.desired
    assert own == pytest.approx(joint.path.at(joint.moments, joint.path.requests), abs=1e-12)

    def run(requests):  # the first request holds the joint where the plan begins
        sent = np.append(joint.requests[:1], requests[1:])
        return simulate(SERVO, sent, cyclic=False, start=path[0])

    def early(lead):
        return np.interp(np.arange(len(path)) + lead / OWN, np.arange(len(path)), path)

    assert joint.resent == pytest.approx(run(own), abs=1e-12)
    assert joint.direct == pytest.approx(run(path), abs=1e-12)
    delay = SERVO.lag + SERVO.acceleration_time / 2.0 + SERVO.theta_0 / SERVO.v_max
    assert joint.lead == pytest.approx(delay, abs=OWN)
    assert joint.shifted == pytest.approx(run(early(joint.lead)), abs=1e-12)
    for lead in (joint.lead - OWN / 4.0, joint.lead + OWN / 4.0):
        assert rms(joint.errors["shifted"]) < rms(run(early(lead)) - path)


def test_the_expected_error_holds_that_of_the_model():
    seen = Evidence(0.01, speed=0.2)
    (joint,) = replay(recorded(), SERVO.with_evidence(seen)).joints
    assert joint.expected == pytest.approx(np.hypot(joint.inversion.rms, 0.01))
    assert joint.untested == ("speed",)


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


def test_a_replay_can_be_sent_to_another_process():
    made = replay([recorded("elbow"), recorded("gripper")], SERVO)
    again = pickle.loads(pickle.dumps(made))
    assert np.array_equal(again.requests, made.requests)
    assert again.summary() == made.summary()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"speed": 1e4}, "1 request remains"),
        ({"rate": 1e-9}, "got a request every 1e+09 s, expected one every 1e-05 to 5 s"),
        ({"rate": 1e9}, "got a request every 1e-09 s, expected one every 1e-05 to 5 s"),
        ({"begin": 2.0, "end": 1.0}, "expected an end after the begin"),
        ({"rate": -1.0}, "expected more than 0 requests a second"),
    ],
)
def test_what_cannot_be_replayed_is_refused(arguments, message):
    recorded_path(recorded(), SERVO, begin=-5e-10, end=2.98 + 5e-10)  # by rounding alone
    with pytest.raises(InvalidInput) as refusal:
        replay(recorded(), SERVO, **arguments)
    assert message in str(refusal.value)


def test_two_logs_of_one_joint_are_two_recordings():
    with pytest.raises(InvalidInput, match="2 logs of joint 'elbow'"):
        replay([recorded(), recorded()], SERVO)


def test_under_a_load_of_the_pose_no_plan_made_before_is_kept():
    loaded = replace(SERVO, compliance=0.05)
    path = recorded_path([recorded("elbow"), recorded("wrist")], loaded)
    moments = path.moments(1.0)
    before = replay_at(path, moments)
    known = {"elbow": before.joints[0].inversion}
    assert replay_at(path, moments, known=known).joints[0].inversion is known["elbow"]
    made, anew = (
        replay_at(path, moments, load=lambda angles: np.cos(angles[:, ::-1]), known=each)
        for each in (known, None)
    )
    assert np.array_equal(made.requests, anew.requests)
    assert not np.allclose(made.requests, before.requests)


def test_steps_by_joint_may_name_joints_that_are_not_planned():
    path = recorded_path([recorded("elbow"), recorded("wrist")], SERVO)
    steps = {"elbow": 0.03, "wrist": 0.02}
    known = {"elbow": replay_at(path, path.moments(1.0)).joints[0].inversion}
    made = replay_at(path, path.moments(1.0), known=known, max_step=steps)
    assert made.joints[0].inversion is known["elbow"]
    assert made.joints[1].inversion.largest_step <= 0.02 * (1.0 + 1e-12)


def test_at_its_own_speed_a_recording_of_any_length_keeps_its_last_row():
    for count in range(20, 150):
        path = recorded_path([recorded(requests=asked()[:count])], SERVO)
        assert len(path.moments(1.0)) == count


SAGGING = replace(SERVO, compliance=0.05, speed_per_torque=0.5)
"""The servo under loads: it sags by 0.05 rad/(N m)."""


def carried(joint="elbow"):
    """A log of the sagging servo under a torque that grows, which the log has."""
    torques = np.linspace(0.0, 2.0, COUNT)
    angles = simulate(SAGGING, asked(), cyclic=False, load=torques)
    return Log(
        times=OWN * np.arange(COUNT), requests=asked(), angles=angles, joint=joint, load=torques
    )


def test_the_torque_of_a_log_acts_at_the_moments_of_the_replay_on_all_kinds_of_requests():
    log = carried()
    (joint,) = replay(log, SAGGING, speed=2.0, smoothness=0.0).joints
    torques = np.interp(joint.moments, log.times, log.load)
    np.testing.assert_allclose(joint.inversion.load, torques)
    assert recorded_path(log, SERVO).joints[0].load is None  # which this model does not feel
    (own,) = replay(log, SAGGING, smoothness=0.0).joints
    start = float(own.desired[0])
    for requests, angles in (
        (own.requests, own.predicted),
        (np.append(own.requests[0], own.desired[1:]), own.direct),
        (np.append(own.requests[0], log.requests[1:]), own.resent),
    ):
        expected = simulate(SAGGING, requests, cyclic=False, start=start, load=log.load)
        np.testing.assert_allclose(angles, expected, rtol=0.0, atol=1e-12)
    assert rms(own.errors["resent"]) < 1e-9  # what was sent makes what was done


def test_a_replay_holds_the_joint_where_the_recording_is_when_it_begins():
    (joint,) = replay(recorded(), SERVO, begin=1.0).joints
    assert joint.desired[0] > 0.3
    assert joint.inversion.start == joint.desired[0]
    assert joint.direct[0] == joint.resent[0] == joint.shifted[0] == joint.desired[0]
    assert joint.resent == pytest.approx(
        simulate(
            SERVO,
            np.append(joint.requests[0], joint.recorded_requests[1:]),
            cyclic=False,
            start=float(joint.desired[0]),
        )
    )


def test_a_part_that_is_too_fast_up_to_the_end_ends_with_the_recording():
    requests = np.concatenate([np.zeros(60), 0.1 * np.arange(1.0, 31.0)])  # 5 rad/s
    times = OWN * np.arange(90)
    log = Log(times=times, requests=requests, angles=requests, joint="elbow")
    (joint,) = replay(log, SERVO, track="action", smoothness=0.0).joints
    (span,) = joint.too_fast
    assert span == pytest.approx((59 * OWN, 89 * OWN))


def test_the_summary_of_a_replay_has_the_figures_of_its_joints():
    logs = [recorded("elbow", requests=asked(1.5)), recorded("wrist", requests=asked(0.3))]
    known = SERVO.with_evidence(Evidence(0.01, speed=0.2))
    made = replay(logs, {"elbow": SERVO, "wrist": known}, speed=2.0)
    told = made.summary()
    lines = [line.split() for line in repr(made).splitlines()]
    assert " ".join(lines[0]) == (
        "Replay at 2 times the speed: 75 requests to 2 joints, one every 20 ms"
    )
    for joint, line in zip(made.joints, lines[2:], strict=True):
        plan = joint.inversion
        assert line == [joint.name, f"{plan.rms:.4g}", f"{plan.max_error:.4g}", "rad"]
        assert plan.max_error > 1.2 * plan.rms
    assert "of its range" in repr(replay(recorded("jaw", unit="1"), SERVO, speed=4.0))
    assert (told["track"], told["speed"], told["requests"]) == ("state", 2.0, 75)
    assert told["period_s"] == pytest.approx(OWN)
    assert told["duration_s"] == pytest.approx(74 * OWN)
    for joint in made.joints:
        figures = told["joints"][joint.name]
        for kind, errors in joint.errors.items():
            largest = float(np.max(np.abs(errors)))
            assert figures["errors"][kind] == pytest.approx({"rms": rms(errors), "max": largest})
        assert figures["lead_s"] == joint.lead
        assert figures["lower_bound"] == joint.inversion.lower_bound
        assert figures["largest_step"] == joint.inversion.largest_step
        assert figures["norm"] == "rms"
        assert figures["untested"] == (["speed"] if joint.name == "wrist" else [])
        assert figures["too_fast_s"] == [list(span) for span in joint.too_fast]
        assert figures["recorded_rms"] == rms(joint.recorded_errors)
        off = joint.path.requests - joint.path.angles
        assert figures["recorded_rms"] == pytest.approx(rms(off))
    assert told["joints"]["elbow"]["expected_rms"] is None
    assert told["joints"]["wrist"]["expected_rms"] == pytest.approx(
        math.hypot(made.joints[1].inversion.rms, 0.01)
    )
    errors = [float(np.max(np.abs(each.errors["planned"]))) for each in made.joints]
    assert made.max_error == pytest.approx(max(errors))
    assert max(errors) > 2.0 * min(errors)


def test_the_bound_of_each_joint_of_a_replay_is_its_own_and_of_the_rms_whatever_the_norm():
    logs = [recorded("elbow", requests=asked(3.0)), recorded("wrist", requests=asked(2.5))]
    largest, mean = (replay(logs, SERVO, speed=2.0, norm=norm).joints for norm in ("max", "rms"))
    assert [each.lower_bound for each in largest] == pytest.approx(
        [each.lower_bound for each in mean]
    )
    assert mean[0].lower_bound > 1.1 * mean[1].lower_bound > 0.0
    assert largest[0].lower_bound < largest[0].inversion.lower_bound
    pose = replay(logs[0], replace(SERVO, compliance=0.01), load=np.cos)
    assert math.isnan(pose.joints[0].lower_bound)


def test_limits_by_joint_are_those_of_that_joint():
    logs = [recorded("elbow"), recorded("wrist")]
    limits = {"wrist": (-0.01, 0.62)}
    elbow, wrist = replay(logs, SERVO, speed=2.0, limits=limits).joints
    assert (elbow.inversion.limits, wrist.inversion.limits) == (None, (-0.01, 0.62))


def test_what_a_speed_is_called_follows_from_the_moments():
    path = recorded_path([recorded()], SERVO)
    moments = 1.5 * OWN * np.arange(40)
    assert replay_at(path, moments).speed == pytest.approx(1.5)
    assert replay_at(path, moments.copy(), speed=3.0).speed == 3.0


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
    for angles in (joint.predicted, joint.direct, joint.resent, joint.shifted):
        assert angles[0] == joint.desired[0]
    sent = np.append(joint.requests[:1], joint.desired[1:])
    start = float(joint.desired[0])
    np.testing.assert_array_equal(joint.direct, simulate(sticky, sent, cyclic=False, start=start))
