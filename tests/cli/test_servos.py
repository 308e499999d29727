"""Commands that move servos, on the virtual bus: from nothing to a plan that was played."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from planner import JointModel
from planner.calibration import measure
from planner.cli import buses
from planner.cli.check import _changes
from planner.files.joint_model import read_models, read_servos
from planner.files.logs.read import read_logs
from planner.files.paths import read_joint_path
from planner.identification.result import Interval
from planner.model.evidence import Evidence
from planner.robot.arm import Arm
from planner.robot.play import Playback
from planner.virtual import servo_bus
from planner.virtual.servo_bus import Faults, VirtualServos

BRIEF = ("--bus", "virtual", "--duration-s", "16", "--reach-deg", "30", "--yes")

ARM = """[joint_1]
v_max = 5.02
theta_0 = 0.5665
lag = 0.0
acceleration_time = 0.0201
tick = 0.001
hold = 10
time_constant = 0.0256
max_acceleration = 69.3
dead_band = 0.0134

[joint_1.servo]
id = 1
zero_tick = 2048
direction = 1
ticks_per_turn = 4096
limits = [-0.7, 0.7]
p_gain = 16
d_gain = 32
"""


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory, request):
    """A folder with one joint calibrated, and what the command said."""
    folder = tmp_path_factory.mktemp("calibrated")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run = request.getfixturevalue("command_line")
        result = run("calibrate", *BRIEF, "--ids", "1", "--report", "page.html", "--json")
    assert result.exit_code == 0, result.stderr
    return folder, json.loads(result.stdout)


@pytest.fixture(scope="module")
def command_line():
    """The command line in the present folder."""
    from click.testing import CliRunner

    from planner.cli import cli

    return lambda *arguments: CliRunner().invoke(cli, [str(each) for each in arguments])


@pytest.fixture
def faulty(monkeypatch):
    """Let the virtual bus of the commands have faults."""

    def faulty(**faults):
        servos = partial(VirtualServos, faults=Faults(**faults))
        monkeypatch.setattr(servo_bus, "VirtualServos", servos)

    return faulty


@pytest.fixture
def arm(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(ARM)
    return file


@pytest.fixture
def requests(tmp_path):
    """A motion of a second and a half about the middle."""
    file = tmp_path / "requests.csv"
    time = 0.01 * np.arange(150)
    angles = 20.0 * np.sin(2.0 * np.pi * time / 1.5)
    rows = [f"{t:.2f},{a:.6f}" for t, a in zip(time, angles, strict=True)]
    file.write_text("\n".join(["t_s,joint_1_deg", *rows]) + "\n")
    return file


def test_one_command_measures_compares_and_recommends(calibrated):
    folder, document = calibrated
    joint = document["joints"]["joint_1"]
    errors = {way: each["rms_deg"] for way, each in joint["candidates"].items()}
    assert list(errors)[:4] == ["direct", "shift", "closed_form", "optimal"]
    assert errors[joint["recommended"]] <= 1.02 * min(errors.values())
    assert errors[joint["recommended"]] < 0.4 * errors["shift"] < 0.4 * errors["direct"]
    assert set(read_models(folder / "arm.toml")) == {"joint_1"}
    servo = read_servos(folder / "arm.toml")["joint_1"]
    assert (servo.id, servo.zero_tick, servo.direction) == (1, 2048, 1)
    assert np.degrees(servo.limits) == pytest.approx([-27.0, 27.0], abs=0.1)
    assert servo.settings["p_gain"] == 16
    page = (folder / "page.html").read_text()
    assert "joint_1: Figure 5 from data" in page
    assert "best shift" in page


def test_the_error_to_expect_is_measured_wherever_friction_held_the_joint_before(calibrated):
    _, document = calibrated
    ways = document["joints"]["joint_1"]["candidates"]
    best = ways["optimal_friction"]
    # A factor of two: what the servo leaves of the expected error differs from motion to motion.
    assert 0.5 < best["rms_deg"] / best["expected_rms_deg"] < 2.0


def test_every_motion_was_kept_as_a_log_that_identify_reads(calibrated):
    folder, document = calibrated
    logs = sorted((folder / "arm_logs").glob("*"))
    ways = document["joints"]["joint_1"]["candidates"]
    assert {log.name for log in logs} == {
        "joint_1.csv",
        *(f"joint_1_{way}.csv" for way in ways),
    }
    (log,) = read_logs([str(folder / "arm_logs" / "joint_1.csv")])
    assert len(log.times) == 1600
    assert np.degrees(np.max(np.abs(log.requests))) <= 27.1


def test_a_second_run_can_take_the_logs_as_they_are(calibrated, command_line, monkeypatch):
    folder, document = calibrated
    monkeypatch.chdir(folder)
    monkeypatch.setattr(measure, "GrowingLog", None)  # nothing is measured
    again = command_line("calibrate", *BRIEF, "--ids", "1", "--resume", "-o", "arm.toml", "--json")
    assert json.loads(again.stdout)["joints"] == document["joints"]


def test_a_chosen_joint_is_calibrated_with_its_options_beside_those_in_the_file(run, arm, tmp_path):
    before = read_servos(arm)["joint_1"], read_models(arm)["joint_1"]
    mounted = ("--zero-tick", "2000", "--zero-tick", "lift=2150", "--reverse", "lift")
    chosen = ("--ids", "pan=1,lift=2", "--joint", "lift", "--rate-hz", "50")
    result = run("calibrate", *BRIEF, *chosen, *mounted, "-o", arm, "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)["joints"]
    assert list(document) == ["lift"]
    assert document["lift"]["id"] == 2
    servos = read_servos(arm)
    assert list(servos) == ["joint_1", "lift"]
    assert (servos["joint_1"], read_models(arm)["joint_1"]) == before
    assert (servos["lift"].id, servos["lift"].zero_tick, servos["lift"].direction) == (2, 2150, -1)
    here = -(2048 - 2150) * 2.0 * np.pi / 4096  # where virtual servos rest
    assert np.mean(servos["lift"].limits) == pytest.approx(here, abs=0.02)
    assert document["lift"]["limits_deg"] == pytest.approx(np.degrees(servos["lift"].limits))
    (log,) = read_logs([str(tmp_path / "arm_logs" / "lift.csv")])
    assert np.median(np.diff(log.times)) == pytest.approx(0.02, abs=1e-3)
    assert read_models(arm)["lift"].period == pytest.approx(0.02)


@pytest.mark.parametrize("kind", buses.KINDS)
def test_every_kind_of_virtual_servo_is_calibrated_from_its_own_middle(run, kind):
    assert set(buses.KINDS) == set(servo_bus.KINDS)
    result = run("calibrate", "--bus", f"virtual:{kind}", "--ids", "1", "--dry-run")
    assert result.exit_code == 0, result.stderr
    assert "joint_1: at 0.0 deg, noise 0.00; P " in result.stderr


@pytest.mark.parametrize("other", [("--rate-hz", "50"), ("--reach-deg", "25")])
def test_logs_of_another_rate_or_range_are_not_taken(calibrated, command_line, monkeypatch, other):
    folder, _ = calibrated
    monkeypatch.chdir(folder)
    monkeypatch.setattr(measure, "GrowingLog", None)  # nothing is measured
    again = command_line("calibrate", *BRIEF, *other, "--ids", "1", "--resume", "-o", "arm.toml")
    assert again.exit_code == 2
    assert "holds another motion than would be played now" in again.stderr


def test_nothing_moves_in_a_dry_run(run, tmp_path, monkeypatch):
    monkeypatch.setattr(measure, "move", None)
    result = run("calibrate", *BRIEF, "--ids", "pan=1,lift=2", "--dry-run")
    assert result.exit_code == 0, result.stderr
    assert "2 servos answer; a tick takes" in result.stderr
    assert "each of pan, lift will move within its range, one after the other" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_at_most_two_questions_are_asked_and_no_is_an_answer(run, tmp_path):
    result = run("calibrate", *BRIEF[:-1], "--ids", "1", stdin="\nn\n")
    assert result.exit_code == 130
    assert result.stderr.count("?") + result.stderr.count("Enter to keep") == 2
    assert list(tmp_path.iterdir()) == []


FAULTS = {
    "stall": ({"stall": {1: 8.0}}, "joint_1: does not follow"),
    "overheat": ({"overheat": {2: 8.0}}, "joint_2: the servo reports overheating"),
    "disconnect": ({"disconnect": 8.0}, "the bus is gone"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_ends_it_in_one_line_and_keeps_every_row(run, faulty, tmp_path, fault):
    faults, message = FAULTS[fault]
    faulty(**faults)
    result = run("-q", "calibrate", *BRIEF, "--ids", "1-2")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert message in line
    assert line.endswith("what was measured is in arm_logs; go on with --resume")
    rows = (tmp_path / "arm_logs" / "joint_1.csv.part").read_text().splitlines()
    assert len(rows) > 500
    assert rows[0] == "t_s,joint_1_requested_deg,joint_1_actual_deg"
    assert not (tmp_path / "arm.toml").exists()


def test_ctrl_c_ends_it_in_one_line_and_keeps_every_row(run, tmp_path, monkeypatch):
    feed, fed = VirtualServos.feed, []

    def interrupted(self, content):
        fed.append(content)
        if len(fed) == 2000:
            raise KeyboardInterrupt
        return feed(self, content)

    monkeypatch.setattr(VirtualServos, "feed", interrupted)
    result = run("-q", "calibrate", *BRIEF, "--ids", "1")
    assert result.exit_code == 130
    assert result.stderr == (
        "request-planner: stopped by Ctrl-C: the joints stay where they are, torque as before; "
        "what was measured is in arm_logs; go on with --resume\n"
    )
    assert len((tmp_path / "arm_logs" / "joint_1.csv.part").read_text().splitlines()) > 500


def test_a_servo_that_does_not_answer_is_named_before_anything_moves(run, faulty):
    faulty(drop=1.0)
    result = run("calibrate", *BRIEF, "--ids", "1")
    assert result.exit_code == 1
    assert "servo 1 does not answer; check its identifier, the baud rate" in result.stderr


def test_requests_are_played_and_every_one_gets_a_measured_row(run, arm, requests, tmp_path):
    twice = ("--cycles", 2, "--measured", "m.csv", "--json")
    result = run("play", requests, "--bus", "virtual", "--model", arm, *twice)
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert (document["rows"], document["skipped"], document["angles_lost"]) == (300, 0, 0)
    measured = read_joint_path(tmp_path / "m.csv")
    assert measured.angles.shape == (300, 1)
    assert np.ptp(np.degrees(measured.angles[150:])) > 30.0
    (log,) = read_logs([str(tmp_path / "log.csv")])
    assert log.angles == pytest.approx(measured.angles[:, 0], abs=1e-6)


def test_what_was_played_is_answered_number_by_number(run, arm, requests, monkeypatch):
    def perform(self, rows, *, period, cycles, keep):
        self.bus.lost = 3
        for number, row in enumerate(np.tile(rows, (cycles, 1))):
            keep(period * number, row, np.full(1, np.nan if number % 2 else 0.1))
        return Playback(sent=120, skipped=5, overruns=2, latest=0.004)

    monkeypatch.setattr(Arm, "perform", perform)
    result = run("play", requests, "--bus", "virtual", "--model", arm, "--json")
    document = json.loads(result.stdout)
    assert document.pop("answers_asked") > 3
    assert document == {
        "rows": 150,
        "requests": 150,
        "skipped": 5,
        "overruns": 2,
        "latest_s": 0.004,
        "angles_lost": 75,
        "answers_lost": 3,
    }


def test_lost_packets_are_counted_and_their_rows_lie_between_their_neighbours(
    run, arm, requests, faulty, tmp_path
):
    faulty(drop=0.05)
    result = run(
        "play", requests, "--bus", "virtual", "--model", arm, "--measured", "m.csv", "--json"
    )
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["angles_lost"] > 0
    assert re.search(r"\d+ of 150 requests were not sent in time and \d+ of", result.stderr)
    angles = np.degrees(read_joint_path(tmp_path / "m.csv").angles[:, 0])
    assert np.max(np.abs(np.diff(angles))) < 4.0


def test_requests_beyond_the_range_are_refused_in_the_unit_of_the_user(run, arm, requests):
    requests.write_text("t_s,joint_1_deg\n0,0\n0.01,60\n")
    result = run("play", requests, "--bus", "virtual", "--model", arm)
    assert result.exit_code == 2
    assert "joint_1: request 1 is 60 deg, expected -40.107 to 40.107 deg, its" in result.stderr


def test_a_hand_shows_a_path_and_a_master_a_log(run, arm, tmp_path):
    asked = ("--bus", "virtual", "--model", arm, "--duration-s", "1")
    result = run("record", *asked, "--by-hand", "-o", "shown.csv")
    assert result.exit_code == 0, result.stderr
    assert read_joint_path(tmp_path / "shown.csv").angles.shape == (50, 1)
    assert run("record", *asked, "-o", "log.csv").exit_code == 0
    header = (tmp_path / "log.csv").read_text().splitlines()[0]
    assert header == "t_s,joint_1_requested_deg,joint_1_actual_deg"


def test_a_log_tells_what_was_requested_from_what_was_measured(run, arm, tmp_path, monkeypatch):
    monkeypatch.setattr(Arm, "goals", lambda _: np.array([0.5]))
    asked = ("--bus", "virtual", "--model", arm, "--duration-s", "0.2")
    assert run("record", *asked, "-o", "log.csv").exit_code == 0
    (log,) = read_logs([str(tmp_path / "log.csv")])
    assert log.requests == pytest.approx(0.5)
    assert np.max(np.abs(log.angles)) < 0.1


def test_a_model_that_holds_is_said_to_hold_and_another_gain_to_be_the_reason(
    run, arm, monkeypatch
):
    arm.write_text(ARM.replace("[joint_1.servo]", "expected_error = 0.01\n\n[joint_1.servo]"))
    asked = ("check", "--bus", "virtual", "--model", arm, "--duration-s", "8")
    holds = run(*asked)
    assert holds.exit_code == 0, holds.stderr
    known = json.loads(run(*asked, "--json").stdout)["joints"]["joint_1"]
    assert known["rms_before_deg"] == pytest.approx(np.degrees(0.01))
    misses = f"misses {known['rms_deg']:.2f} deg rms, {known['rms_before_deg']:.2f} when"
    assert f"joint_1: the model holds: {misses} it was calibrated" in holds.stderr
    monkeypatch.setitem(servo_bus.KINDS["sts3215"].registers, "p_gain", 6)
    gone = run(*asked)
    assert gone.exit_code == 1
    assert "joint_1: the model no longer holds" in gone.stderr
    assert "P is 6, and was 16" in gone.stderr
    assert gone.stderr.endswith("calibrate joint_1 again\n")


def test_a_motion_that_a_new_model_would_miss_as_much_is_no_reason_to_calibrate_again(
    run, arm, monkeypatch
):
    """A tenth of the error of the file would be exceeded on any motion."""
    arm.write_text(ARM.replace("dead_band = 0.0134", "dead_band = 0.03\nexpected_error = 1e-4"))
    checking = ("check", "--bus", "virtual", "--model", arm, "--duration-s", "6", "--json")
    for held_out, holds in ((0.02, True), (1e-3, False)):
        found = SimpleNamespace(model=None, intervals={}, held_out_rms=held_out)
        monkeypatch.setattr("planner.identification.identify.identify", lambda _, each=found: each)
        result = run(*checking)
        assert result.exit_code == (0 if holds else 1)
        assert json.loads(result.stdout)["joints"]["joint_1"]["holds"] == holds


def test_a_servo_that_falls_silent_ends_a_record(run, arm, faulty, tmp_path):
    faulty(power_off=0.5)
    result = run("-q", "record", "--bus", "virtual", "--model", arm, "--duration-s", "5")
    assert result.exit_code == 1
    assert "joint_1: the servo has stopped answering" in result.stderr
    assert 25 < len((tmp_path / "log.csv.part").read_text().splitlines()) < 60


def test_a_model_is_checked_at_another_rate_with_requests_that_are_held(run, arm):
    arm.write_text(ARM.replace("[joint_1.servo]", "expected_error = 0.01\n\n[joint_1.servo]"))
    asked = ("check", "--bus", "virtual", "--model", arm, "--duration-s", "8", "--json")
    errors = [
        json.loads(run(*asked, "--rate-hz", rate).stdout)["joints"]["joint_1"]["rms_deg"]
        for rate in (100, 20)
    ]
    assert errors[1] < 1.5 * errors[0]


def test_a_model_without_a_tested_error_is_refused_before_anything_moves(run, arm):
    result = run("check", "--bus", "virtual", "--model", arm)
    assert result.exit_code == 2
    assert "[joint_1] has no expected_error to compare with; calibrate the joint" in result.stderr


def test_a_servo_0_does_not_answer_on_the_virtual_bus(run):
    result = run("calibrate", "--bus", "virtual", "--ids", "0", "--yes")
    assert result.exit_code == 1
    assert "servo 0 does not answer; check its identifier" in result.stderr


def test_a_rate_too_low_for_the_test_motion_is_refused_before_anything_moves(run):
    result = run("calibrate", "--bus", "virtual", "--ids", "1", "--yes", "--rate-hz", "15")
    assert result.exit_code == 2
    assert "--rate-hz: got 15, expected 16 Hz or more." in result.stderr


def test_a_parameter_has_changed_where_the_intervals_before_and_now_are_apart():
    before = JointModel(v_max=5.0, theta_0=0.5, lag=0.02, acceleration_time=0.02, dead_band=0.02)
    before = before.with_evidence(Evidence(intervals={"v_max": (4.0, 6.0), "lag": (0.01, 0.03)}))
    now = replace(before, v_max=3.0, theta_0=0.6, lag=0.025, dead_band=0.021)
    intervals = {
        "v_max": Interval(2.0, 3.9),
        "theta_0": Interval(0.56, 0.64),  # without an interval before: within a tenth
        "lag": Interval(0.001, 0.04),
        "dead_band": Interval(0.0, 0.023),
    }
    found = SimpleNamespace(model=now, intervals=intervals)
    assert _changes(before, found) == ["v_max is 3, and was 5", "theta_0 is 0.6, and was 0.5"]
