"""How fast a recording can be replayed: witnesses, proofs, and factors that vary along it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from planner import InvalidInput, JointModel, Log, fastest, replay, simulate
from planner.exceptions import Infeasible
from planner.gait.half_ellipse import reference_walk
from planner.model.evidence import Evidence
from planner.recording.recorded_path import recorded_path
from planner.recording.replaying import replay_at
from planner.recording.retiming import Search
from tests.instances import SERVO, joint_of

PERIOD = SERVO.period
TOLERANCE = 0.02
ROWS = 1601


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


def test_the_replay_keeps_the_tolerance_and_a_little_more_speed_is_proved_impossible(constant):
    (joint,) = constant.replay.joints
    assert np.max(np.abs(joint.errors["planned"])) <= TOLERANCE
    assert constant.speed == constant.constant
    assert constant.factors[:-1] == pytest.approx(constant.speed)
    assert constant.speed < constant.impossible.speed < 1.1 * constant.speed
    assert constant.impossible.bound > 1.0
    made = replay(log(swing(0.8, 150)), SERVO, speed=constant.impossible.speed, norm="max")
    assert made.max_error > TOLERANCE
    for each in constant.curve:
        assert each.bound <= each.planned * (1.0 + 1e-6)
    kept = [each.planned <= 1.0 for each in constant.curve]
    assert kept == sorted(kept, reverse=True)
    assert constant.speed in [each.speed for each in constant.curve]
    assert constant.curve[0].direct > 1.0


def test_a_bound_by_a_top_speed_that_was_never_seen_holds_for_the_model_only(constant):
    model = SERVO.with_evidence(Evidence(0.01))
    found = fastest(log(swing(0.8, 150)), model, tolerance=TOLERANCE)
    assert found.impossible.of_model_only
    assert not constant.impossible.of_model_only


def test_a_speed_at_which_requests_are_too_far_apart_for_the_path_is_too_high():
    """A joint that follows anything: samples on the path are no proof that it is followed."""
    quick = joint_of(500.0, 6.0, 0.0, 0.005, tick=0.005, hold=4)
    rows = np.arange(1000)
    angles = 0.3 * np.minimum(rows / 400, 1.0) ** 3 * np.sin(np.pi * 0.02 * rows) ** 2
    recorded = Log(times=0.02 * rows, requests=angles, angles=0.999 * angles)
    found = fastest(recorded, quick, tolerance=TOLERANCE)
    (joint,) = found.replay.joints
    lines = np.interp(recorded.times, found.replay.moments, joint.desired)
    inside = recorded.times <= found.replay.moments[-1]
    assert np.max(np.abs(joint.errors["planned"])) < 0.1 * TOLERANCE
    assert 0.9 < np.max(np.abs(lines - recorded.angles)[inside]) / TOLERANCE <= 1.0
    assert 8.0 < found.speed < 9.0
    assert not found.replay.path.remarks
    remarks = replay(recorded, quick, speed=25.0).path.remarks
    assert "at this speed a request every 20 ms loses 17 % of the motion of" in remarks[-1]


def test_of_two_joints_the_one_that_is_farther_off_decides(constant):
    logs = [log(swing(0.8, 150)), log(swing(0.1, 150), "wrist")]
    calm = SERVO.with_evidence(Evidence(0.01))  # its top speed was never seen
    found = fastest(logs, {"elbow": SERVO, "wrist": calm}, tolerance=TOLERANCE)
    assert found.speed == pytest.approx(constant.speed, rel=0.02)
    assert (found.impossible.joint, found.impossible.of_model_only) == ("elbow", False)
    for each, alone in zip(found.curve, constant.curve, strict=True):
        assert each.bound == pytest.approx(alone.bound, rel=0.2)
        assert each.direct == pytest.approx(alone.direct, rel=0.2)


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
    assert np.max(bends) == pytest.approx(2.0 * found.constant, rel=0.05)  # in half a second to it
    assert found.retime == "varying"


def test_a_recording_that_its_model_refutes_at_its_own_speed_proves_no_limit():
    joint = JointModel.ers210a().requested_every(0.04)
    slow = replace(joint, v_max=0.3 * joint.v_max, theta_0=0.3 * joint.theta_0)
    times = joint.period * np.arange(20)
    asked = 0.4 - 0.4 * np.cos(2.0 * np.pi * times)
    log = Log(times=times, requests=asked, angles=simulate(joint, asked, cyclic=False))
    found = fastest(log, slow, tolerance=np.radians(2.0))
    assert found.speed < 1.0
    assert (found.contradicted, found.impossible) == (("joint",), None)


class MadeUp:
    """A joint whose plans err by a known multiple of the tolerance at each speed.

    Attributes:
        best: Highest factor at which the plan of least rms error keeps the tolerance.
        largest: The same of the plan for the largest error.
        proved: Lowest factor that the bound refutes.
        tried: Each factor that was planned, with the norm.
    """

    def __init__(self, monkeypatch, *, best, largest=0.0, proved=np.inf):
        self.best, self.largest, self.proved, self.tried = best, largest, proved, []
        monkeypatch.setattr("planner.recording.retiming.replay_at", self.replay_at)
        monkeypatch.setattr("planner.recording.retiming.lower_bound", self.lower_bound)

    def error(self, speed, norm):
        kept = self.largest if norm == "max" else self.best
        return TOLERANCE * speed / kept if kept else np.inf

    def replay_at(self, path, moments, *, speed=None, norm="rms", **_):
        if speed is None:
            speed = (moments[-1] - moments[0]) / ((len(moments) - 1) * path.period)
        if path.duration > 2.0:  # not of the hardest second alone
            self.tried.append((speed, norm))
        size = self.error(speed, norm)
        errors = size * np.resize([1.0, 0.5, -1.0], len(moments))
        factors = {"direct": 5.0, "shifted": 2.0, "planned": 1.0, "resent": 5.0}
        joints = tuple(
            SimpleNamespace(
                name=each.name,
                path=each,
                desired=each.at(moments, each.followed),
                inversion=SimpleNamespace(max_error=size),
                error_of=lambda kind: factors[kind] * errors,
                between=np.zeros(1),
            )
            for each in path.planned
        )
        return SimpleNamespace(
            planned=joints,
            joints=joints,
            speed=speed,
            moments=moments,
            path=path,
            period=path.period,
        )

    def lower_bound(self, _, desired, **options):
        assert (options["cyclic"], options["norm"]) == (False, "max")
        assert options["start"] == desired[0]
        self.fewest = len(desired)
        return TOLERANCE * (ROWS - 1) / (len(desired) - 1) / self.proved


def found_for(_, rows=ROWS):
    """The fastest replay of a long, slow swing by a made-up joint."""
    return fastest(log(0.2 + swing(0.5, rows)), SERVO, tolerance=TOLERANCE)


@pytest.mark.parametrize("best", [0.07, 0.3, 0.99, 1.0, 1.3, 2.0, 5.0, 63.0])
def test_the_largest_factor_is_found_to_a_hundredth_and_keeps_the_tolerance(best, monkeypatch):
    made_up = MadeUp(monkeypatch, best=best)
    found = found_for(made_up)
    assert best / 1.0101 <= found.constant <= best
    assert found.replay.speed == found.speed == found.constant
    assert np.max(np.abs(found.replay.joints[0].error_of("planned"))) <= TOLERANCE
    speeds = [speed for speed, norm in made_up.tried if norm == "rms"]
    assert len(set(speeds)) == len(speeds)  # each speed is planned once


def test_no_replay_is_slower_than_a_sixteenth_nor_faster_than_eight_periods_or_64_times(
    monkeypatch,
):
    for rows, most in ((ROWS, 64.0), (161, 16.0), (257, 32.0), (256, 16.0)):
        assert found_for(MadeUp(monkeypatch, best=1e9), rows).constant == most
    with pytest.raises(Infeasible, match=r"at 0\.0625 times the speed the plan still is 1\.25 tim"):
        found_for(MadeUp(monkeypatch, best=0.05))
    assert found_for(MadeUp(monkeypatch, best=1.0 / 16.0)).constant == 1.0 / 16.0


def test_a_tolerance_that_no_speed_keeps_is_refused_by_the_hardest_second():
    tried = []
    requests = np.concatenate([np.zeros(50), swing(0.8, 3000)])
    with pytest.raises(Infeasible, match=r"at 0\.0625 times the speed the plan near .* still is"):
        fastest(log(requests), SERVO, tolerance=1e-8, progress=tried.append)
    planned = [each for each in tried if not each.startswith("elbow: the lower bound")]
    assert len(planned) == 2  # the recorded speed, and the slowest


@pytest.mark.parametrize("proved", [1.31, 1.9, 2.7, 9.0])
def test_the_lowest_speed_that_is_proved_too_high_is_found_to_a_hundredth(proved, monkeypatch):
    found = found_for(MadeUp(monkeypatch, best=1.3, proved=proved))
    impossible = found.impossible
    rounding = 1.0 + proved / (ROWS - 1)  # in whole requests
    assert proved / rounding <= impossible.speed <= 1.0101 * proved * rounding
    assert impossible.bound > 1.0
    assert impossible.joint == "elbow"
    assert [each.speed for each in found.curve][-1] == pytest.approx(1.15 * impossible.speed)


def test_a_tolerance_for_the_foot_counts_its_distance_in_the_order_of_the_legs_joints():
    walk = reference_walk()
    leg, names = walk.leg, ("knee", "rotator", "abductor")
    columns = dict(zip(leg.joint_names, walk.desired.T, strict=True))
    logs = [log(np.resize(columns[name], 200), name) for name in names]
    logs.insert(0, log(swing(0.5, 200), "gripper"))  # which is not planned
    path = recorded_path(logs, SERVO)
    made = replay_at(path, path.moments(1.0), smoothness=0.1)
    found = Search(path, None, 0.004, leg)
    by_name = {each.name: each for each in made.planned}
    desired = np.column_stack([by_name[name].desired for name in leg.joint_names])
    for kind in ("planned", "direct"):
        off = np.column_stack([by_name[name].error_of(kind) for name in leg.joint_names])
        away = leg.foot_positions(desired + off) - leg.foot_positions(desired)
        expected = np.linalg.norm(away, axis=1) / 0.004
        np.testing.assert_allclose(found.errors(made, kind), expected)
    assert [each.name for each in found.late(made)] == [each.name for each in made.planned]
    with pytest.raises(InvalidInput, match="leg: its joint 'knee' is not planned"):
        Search(recorded_path(logs[2:], SERVO), None, 0.004, leg)
