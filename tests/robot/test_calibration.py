"""Calibration: what is read before anything moves, and which way to move a servo is recommended."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from planner import BusError, JointModel, Log, invert_optimal, simulate
from planner.files.joint_model import read_model_file
from planner.identification.excitation import excite
from planner.model.evidence import Evidence
from planner.report.calibration_text import WORDS, recheck_answer
from planner.report.wording import table
from planner.robot import calibration
from planner.robot.arm import Arm, Servo
from planner.robot.bus import Bus
from planner.robot.calibration import (
    check,
    move,
    ranges_by_hand,
    servo_ranges,
    with_ranges,
)
from planner.robot.protocols import FEETECH
from planner.virtual.servo_bus import KINDS, VirtualPort, VirtualServos
from tests.instances import joint_of

TICK = 2.0 * math.pi / 4096
LIMITS = (-0.7, 0.7)
INTERVALS = {"v_max": (4.9, 5.1), "dead_band": (0.008, 0.012), "v_offset": (0.01, 0.03)}


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("kind", ["sts3215", "xl430"])
def test_a_range_is_that_of_the_servos_limits_and_of_the_reach(kind, direction):
    bus = Bus(VirtualPort(VirtualServos(2, KINDS[kind])), KINDS[kind].protocol)
    servos = {f"joint_{k}": Servo(id=k, zero_tick=1900, direction=direction) for k in (1, 2)}
    bus.write(1, "least_position", 1800)
    bus.write(1, "largest_position", 3900)
    angles = check(Arm(bus, servos)).angles
    assert bus.read(2, "least_position") == 0
    bus.write(2, "largest_position", 0)  # no limits are set
    ranges = servo_ranges(Arm(bus, servos), angles, 0.5)
    here = direction * 148 * TICK
    limited = np.array([-248 * TICK, 0.5])[::direction] * direction  # around where it is
    assert ranges["joint_1"] - here == pytest.approx(limited, abs=2.0 * TICK)
    assert ranges["joint_2"] - here == pytest.approx([-0.5, 0.5], abs=2.0 * TICK)


def test_a_range_by_hand_is_from_the_least_to_the_largest_angle_that_was_shown():
    shown = iter([[0.2, 0.0], [-0.4, np.nan], [0.1, 0.2]])
    arm = SimpleNamespace(
        names=("hip", "knee"),
        angles=lambda: np.array([0.25, 0.1]),
        measure=lambda: SimpleNamespace(angles=np.array(next(shown))),
        bus=SimpleNamespace(port=SimpleNamespace(sleep=lambda _: None)),
    )
    ends = iter([False, False, False, True])
    found = ranges_by_hand(arm, lambda: next(ends), 0.02)
    assert {name: each.tolist() for name, each in found.items()} == {
        "hip": [-0.4, 0.25],  # where it was at first
        "knee": [0.0, 0.2],
    }


def test_the_limits_of_a_joint_are_its_range_less_a_margin():
    arm = Arm(Bus(VirtualPort(VirtualServos(1)), FEETECH), {"joint": Servo(id=1)})
    ends = np.radians([-20.0, -9.0])
    limits = with_ranges(arm, {"joint": ends}).servos["joint"].limits
    assert np.degrees(limits) == pytest.approx([-20.0 + 0.55, -9.0 - 0.55], abs=1e-4)


def test_a_servo_that_reports_a_fault_is_named_before_anything_moves():
    servos = VirtualServos(2)
    servos.motors.temperatures[1] = 90.0
    arm = Arm(Bus(VirtualPort(servos), FEETECH), {f"joint_{k}": Servo(id=k) for k in (1, 2)})
    with pytest.raises(BusError, match=r"joint_2: the servo reports .*; switch it off"):
        check(arm)


@pytest.mark.parametrize("limits", [(0.05, 1.0), (-1.0, -0.05)])
def test_joints_that_rest_beyond_their_range_stay_at_its_end(limits, tmp_path):
    bus = Bus(VirtualPort(VirtualServos(2)), FEETECH)
    other = Servo(id=2, zero_tick=2048, limits=limits)
    arm = Arm(bus, {"moved": Servo(id=1, zero_tick=2048), "other": other})
    with arm.powered():
        move(arm, "moved", np.full(50, 0.1), period=0.02, log=tmp_path / "log.csv")
        _, angle = arm.angles()
    assert angle == pytest.approx(min(limits, key=abs), abs=0.02)


EVIDENCE = Evidence(
    error=0.002,
    intervals=INTERVALS,
    correlations=tuple(map(tuple, np.eye(3).tolist())),
    by_acceleration=((1.0, 0.001), (2.0, 0.003)),
    spread=(0.5, 1.5),
)
MODEL = joint_of(5.0, 0.5, 0.01, 0.02, tick=0.001, hold=10, dead_band=0.01, v_offset=0.02)
MODEL = MODEL.with_evidence(EVIDENCE)


@pytest.mark.parametrize("best", ["direct", "shift", "closed_form", "optimal", "optimal_friction"])
def test_the_model_of_any_recommended_way_can_be_kept_and_read_again(best, tmp_path):
    desired = calibration.test_motion(MODEL, LIMITS)

    def measured(way, _):
        return desired + (0.001 if way == best else 0.01)

    found = calibration.compare(SimpleNamespace(model=MODEL), LIMITS, measured)
    assert found.recommended.way == best
    marked = [
        row
        for row in table("candidates", joints={"knee": found}, ways_in_words=WORDS)
        .text()
        .splitlines()
        if "recommended" in row
    ]
    assert len(marked) == 1
    assert WORDS[best] in marked[0]
    found.model.to_toml(tmp_path / "arm.toml")
    kept = read_model_file(tmp_path / "arm.toml").one()
    plain = best == "optimal"
    assert (kept.dead_band, kept.v_offset) == ((0.0, 0.0) if plain else (0.01, 0.02))
    assert set(kept.evidence.intervals) == ({"v_max"} if plain else set(INTERVALS))
    assert kept.evidence.error == pytest.approx(0.001 if plain else 0.002)
    assert kept.evidence.spread == (Evidence().spread if plain else (0.5, 1.5))
    for each in (kept.evidence.by_acceleration, kept.evidence.correlations):
        assert bool(each) != plain
    assert kept.evidence.refused == (best in ("direct", "shift"))
    if kept.evidence.refused:
        assert kept.evidence.reason.endswith(f"its calibration '{WORDS[best]}' was closer")


def test_candidates_have_the_figures_of_what_was_played_after_the_run_in(monkeypatch):
    desired = calibration.test_motion(MODEL, LIMITS)
    skipped = round(0.5 / MODEL.period)
    played, plans = {}, []

    def inverted(*given, **options):
        plans.append(invert_optimal(*given, **options))
        return plans[-1]

    def measured(way, requests):
        played[way] = requests
        error = np.full(len(desired), 0.02)
        error[:skipped] = 5.0  # of the run-in
        error[-1] = -0.06
        return desired + error

    monkeypatch.setattr(calibration, "invert_optimal", inverted)
    found = calibration.compare(SimpleNamespace(model=MODEL), LIMITS, measured)
    assert [each.plan.task.limits[0] for each in plans] == [LIMITS, LIMITS]
    count = len(desired) - skipped
    for each in found.candidates:
        assert each.error == pytest.approx(np.sqrt((0.02**2 * (count - 1) + 0.06**2) / count))
        assert each.max_error == pytest.approx(0.06)
        assert each.largest_step == np.max(np.abs(np.diff(played[each.way])))
        assert np.all((played[each.way] >= LIMITS[0]) & (played[each.way] <= LIMITS[1]))
        # Nothing was tested of the model without friction and load.
        assert np.isfinite(each.expected) == (each.way in ("closed_form", "optimal_friction"))
    assert found.recommended is found.named("direct")  # all are as good: the simplest


def test_the_simplest_of_ways_that_are_about_as_good_is_recommended():
    desired = calibration.test_motion(MODEL, LIMITS)
    errors = {"shift": 1.05e-3, "closed_form": 1.01e-3, "optimal": 1.0e-3}
    found = calibration.compare(
        SimpleNamespace(model=MODEL), LIMITS, lambda way, _: desired + errors.get(way, 0.01)
    )
    assert found.recommended.way == "closed_form"
    free = replace(MODEL, dead_band=0.0, v_offset=0.0)
    found = calibration.compare(SimpleNamespace(model=free), LIMITS, lambda *_: desired)
    assert [each.way for each in found.candidates] == list(WORDS)[:4]


@pytest.mark.parametrize(("most", "verdict"), [(math.inf, True), (1.5, False)])
def test_a_model_holds_up_to_the_largest_error_of_its_test_and_else_the_changes_have_units(
    most, verdict
):
    """By a spread that is not known it holds up to twice the error that is expected."""
    was = JointModel(v_max=3.0, theta_0=0.2, lag=0.03, acceleration_time=0.03, tick=0.01)
    requests = excite("combined", limits=(-1.0, 1.0), period=0.01, duration=20.0).requests
    angles = simulate(replace(was, v_max=2.0), requests, cyclic=False, start=requests[0])
    log = Log(times=0.01 * np.arange(len(requests)), requests=requests, angles=angles)
    error, *_ = calibration.errors(was, log)
    tested = was.with_evidence(Evidence(error=error / 1.8, spread=(0.5, most)))
    result = calibration.recheck(tested, log)
    assert result.holds is verdict
    words = recheck_answer("hip", result, {}, {})[1]
    assert ("top speed v_max is 114.59 deg/s, and was 171.89" in words) == (not verdict)


CHECKED = (
    # before, now, by a new model [deg], share beyond the tested motion; whether it holds
    (1.0, 1.9, 0.1, 0.0, True),
    (1.0, 2.1, 0.1, 0.0, False),
    (0.1, 0.29, 0.1, 0.0, True),  # small
    (0.1, 0.31, 0.16, 0.0, None),  # hard for any model
    (0.1, 0.31, 0.1, 0.9, False),
    (0.1, 0.31, 0.16, 1.0, None),
    (0.1, 0.31, 0.1, 1.0, None),
)


def test_a_model_holds_within_twice_its_error_or_a_small_one_unless_a_new_one_misses_it_too(
    monkeypatch, snapshot
):
    model, lines = replace(MODEL, lag=0.02), []  # without evidence
    monkeypatch.setattr(calibration, "changes", lambda *_: {})
    monkeypatch.setattr("planner.report.calibration_text.parameters", lambda _: [])
    for before, now, other, beyond, holds in CHECKED:
        tested = Evidence(error=np.radians(before)).compared(np.zeros(9), period=0.01)
        errors = np.radians(now), *tested[1:], beyond
        found = SimpleNamespace(model=None, rms=np.radians(other))
        monkeypatch.setattr(calibration, "errors", lambda *_, errors=errors: errors)
        monkeypatch.setattr(calibration, "identify", lambda _, found=found: found)
        result = calibration.recheck(model, None)
        assert result.holds is holds
        lines.append(recheck_answer("hip", result, {}, {})[1])
    snapshot.check("checked", "\n".join(lines) + "\n")
