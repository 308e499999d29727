"""Commands that move servos, on the virtual bus: from nothing to a plan that was played."""

import json
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from types import SimpleNamespace

import click
import numpy as np
import pytest

from planner import BusError, JointModel, Log, Playback, read_logs, read_models, simulate
from planner.cli import servos
from planner.files.joint_model import read_servos
from planner.files.table import write_table
from planner.model.evidence import Evidence
from planner.robot import calibration
from planner.robot.arm import Arm
from planner.virtual import servo_bus
from planner.virtual.servo_bus import KINDS, Faults, VirtualPort, VirtualServos
from tests.report.test_made_up_pages import calibrated as made_up

CALIBRATE = import_module("planner.cli.calibrate")
BRIEF = ("--bus", "virtual", "--duration-s", "12", "--reach-deg", "30", "--yes")

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
    write_table(file, ["t_s", "joint_1_deg"], np.column_stack([time, angles]))
    return file


def test_requests_in_shares_of_a_range_are_played_logged_and_counted_in_percent(
    run, tmp_path, arm, requests
):
    """Of -0.7 to 0.7 rad 20 degrees about the middle are 24.9 percent about 50."""
    shown = "joint_1: 0 to 100 % of its range are -40.11 to 40.11 deg"
    share = np.degrees(1.4) / 100.0
    time, angles = np.loadtxt(requests, delimiter=",", skiprows=1, unpack=True)
    rows = np.column_stack([time, 50.0 + angles / share])
    names = ["t_s", "joint_1_percent"]
    write_table(tmp_path / "jaw.csv", names, rows)
    played = {}
    for name in ("jaw.csv", "requests.csv"):
        files = ("--measured", f"measured_{name}", "-o", f"log_{name}")
        result = run("play", name, "--bus", "virtual", "--model", arm, *files)
        assert result.exit_code == 0, result.stderr
        assert (shown in result.stderr) == (name == "jaw.csv")
        played[name] = np.loadtxt(f"measured_{name}", delimiter=",", skiprows=1)[:, 1]
        ticks = ("--format", "csv", "--unit", "ticks", "--model", arm, "-o", f"ticks_{name}")
        assert run("export", name, *ticks).exit_code == 0
    read = {name: (tmp_path / name).read_text() for name in ("measured_jaw.csv", "log_jaw.csv")}
    assert read["measured_jaw.csv"].startswith("t_s,joint_1_percent\n")
    assert read["log_jaw.csv"].startswith("t_s,joint_1_requested_percent,joint_1_actual_percent\n")
    assert 50.0 + played["requests.csv"] / share == pytest.approx(played["jaw.csv"], abs=1e-3)
    counts = [(tmp_path / f"ticks_{name}").read_text() for name in ("jaw.csv", "requests.csv")]
    assert counts[0] == counts[1]
    rows[:, 1] += 100.0 - np.max(rows[:, 1]) + 4.5
    write_table(tmp_path / "jaw.csv", names, rows)
    result = run("export", "jaw.csv", *ticks[:-1], "-")
    assert "its servo; requests beyond, by up to 4.5 %, are clipped" in result.stderr
    assert max(int(row.split(",")[1]) for row in result.stdout.split()[1:]) == 2048 + 456
    rows[7, 1] = 105.1
    write_table(tmp_path / "jaw.csv", names, rows)
    result = run("play", "jaw.csv", "--bus", "virtual", "--model", arm)
    assert result.exit_code == 2
    assert "joint_1: request 7 is 105.1 percent, expected 0 to 100 percent" in result.stderr


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
    assert "joint_1: The function f" in page
    assert "best shift" in page


def test_a_second_run_can_take_the_logs_as_they_are(calibrated, command_line, monkeypatch):
    taken = []

    def identify(log):
        taken.append(log.angles)
        raise BusError("enough")

    monkeypatch.chdir(calibrated[0])
    monkeypatch.setattr(calibration, "growing_log", None)  # nothing is measured
    monkeypatch.setattr(calibration, "identify", identify)
    again = command_line("calibrate", *BRIEF, "--ids", "1", "--resume", "-o", "arm.toml")
    assert again.stderr.splitlines()[-1].startswith("request-planner: enough; what was")
    (kept,) = read_logs(["arm_logs/joint_1.csv"])
    assert np.array_equal(taken, [kept.angles])


def test_logs_of_an_earlier_calibration_are_told_and_not_taken_for_another_range(
    calibrated, command_line, monkeypatch
):
    monkeypatch.chdir(calibrated[0])
    line = ("calibrate", *BRIEF, "--ids", "1", "--dry-run", "-o")
    told = "arm_logs has logs of joint_1 by an earlier calibration, which new ones replace"
    assert told in command_line(*line, "arm.toml").stderr
    assert told not in command_line(*line, "arm.toml", "--resume").stderr
    assert "earlier" not in command_line(*line, "new.toml").stderr
    monkeypatch.setattr(calibration, "growing_log", None)  # nothing is measured
    other = ("--reach-deg", "25", "--ids", "1", "--resume", "-o", "arm.toml")
    again = command_line("calibrate", *BRIEF, *other)
    assert again.exit_code == 2
    assert "holds another motion than would be played now" in again.stderr


def test_at_most_two_questions_are_asked_no_is_an_answer_and_none_names_the_option(run, tmp_path):
    result = run("calibrate", *BRIEF[:-1], "--ids", "1", stdin="\nn\n")
    assert result.exit_code == 130
    assert result.stderr.count("?") + result.stderr.count("Enter to keep") == 2
    assert list(tmp_path.iterdir()) == []
    result = run("calibrate", *BRIEF[:-1], "--ids", "1", stdin="")
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-1].endswith("no answer; --yes asks no questions")


def test_a_fault_ends_it_in_one_line_and_keeps_every_row(run, faulty, tmp_path):
    faulty(stall={1: 8.0})
    result = run("-q", "calibrate", *BRIEF, "--ids", "1-2")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert "joint_1: does not follow" in line
    assert line.endswith("what was measured is in arm_logs; go on with --resume")
    rows = (tmp_path / "arm_logs" / "joint_1.csv.part").read_text().splitlines()
    assert len(rows) > 500
    assert rows[0] == "t_s,joint_1_requested_deg,joint_1_actual_deg"
    assert not (tmp_path / "arm.toml").exists()


@pytest.fixture
def interrupted(monkeypatch):
    """Press Ctrl-C after so many packets."""
    feed, fed = VirtualServos.feed, []

    def interrupted(after):
        def counted(self, content):
            fed.append(content)
            if len(fed) == after:
                raise KeyboardInterrupt
            return feed(self, content)

        monkeypatch.setattr(VirtualServos, "feed", counted)

    return interrupted


def test_an_angle_that_was_not_read_is_warned_of_though_every_request_was_sent(
    run, arm, requests, monkeypatch
):
    def perform(_, rows, *, period, cycles, keep):
        for number, row in enumerate(np.tile(rows, (cycles, 1))):
            keep(period * number, row, row + (np.nan if number == 0 else 0.0))
        return Playback(sent=len(rows))

    monkeypatch.setattr(Arm, "perform", perform)
    said = run("play", requests, "--bus", "virtual", "--model", arm).stderr
    assert "0 of 150 requests were not sent in time and 1 of 150 angles were not read" in said


def test_a_log_tells_what_was_requested_from_what_was_measured(run, arm, tmp_path, monkeypatch):
    monkeypatch.setattr(Arm, "goals", lambda _: np.array([0.5]))
    asked = ("--bus", "virtual", "--model", arm, "--duration-s", "0.2")
    assert run("record", *asked, "-o", "log.csv").exit_code == 0
    (log,) = read_logs([str(tmp_path / "log.csv")])
    assert log.requests == pytest.approx(0.5)
    assert np.max(np.abs(log.angles)) < 0.1


def test_another_gain_is_noticed_and_said_to_be_the_reason(run, arm, monkeypatch):
    arm.write_text(ARM.replace("[joint_1.servo]", "expected_error = 0.01\n\n[joint_1.servo]"))
    monkeypatch.setitem(servo_bus.KINDS["sts3215"].registers, "p_gain", 6)
    gone = run("check", "--bus", "virtual", "--model", arm, "--duration-s", "8")
    assert gone.exit_code == 1
    assert "joint_1: the model no longer holds" in gone.stderr
    assert "P is 6, and was 16" in gone.stderr
    assert gone.stderr.endswith("calibrate joint_1 again\n")


def test_a_model_in_shares_is_checked_in_percent_of_what_its_servo_takes(run, arm):
    values = {"v_max": 5.02, "theta_0": 0.5665, "max_acceleration": 69.3, "dead_band": 0.0134}
    text = ARM.replace("[joint_1.servo]", 'angle_unit = "range"\n[joint_1.servo]')
    text = text.replace("[joint_1.servo]", "expected_error = 0.02\n\n[joint_1.servo]")
    for key, value in values.items():
        text = text.replace(f"{key} = {value}", f"{key} = {value / 1.4}")
    arm.write_text(text)
    result = run("check", "--bus", "virtual", "--model", arm, "--duration-s", "8")
    assert "joint_1: the model holds: misses" in result.stderr
    assert "% of range rms, expected 2.00 and at most 4.00 by its test" in result.stderr


def test_a_servo_that_falls_silent_ends_a_record(run, arm, faulty, tmp_path):
    faulty(power_off=0.5)
    result = run("-q", "record", "--bus", "virtual", "--model", arm, "--duration-s", "5")
    assert result.exit_code == 1
    assert "joint_1: the servo has stopped answering" in result.stderr
    assert 25 < len((tmp_path / "log.csv.part").read_text().splitlines()) < 60


@pytest.fixture
def fake_calibration(monkeypatch):
    """Joints whose calibration is made up; the one called broken ends it."""
    found = {}

    def one(arm, joint, **_):  # noqa: ARG001
        if joint == "broken":
            raise BusError("broken: does not follow")
        return found.setdefault(joint, made_up("optimal" if len(found) else "closed_form"))

    monkeypatch.setattr(calibration, "calibrate", one)
    return found


def test_what_is_answered_is_what_was_measured_in_degrees(run, fake_calibration, tmp_path):
    ids = ("--ids", "a=1,b=2,c=3", "--joint", "a", "--joint", "c")
    result = run("calibrate", *BRIEF, *ids, "--json", "--report", "page.html")
    assert result.exit_code == 0, result.stderr
    told = "each of a, c will move within its range, one after the other, for 1.5 min"
    assert told in result.stderr
    document = json.loads(result.stdout)
    assert 1e-4 < document["tick_s"] < 5e-3
    assert list(document["joints"]) == ["a", "c"]
    for name, servo in (("a", 1), ("c", 3)):
        joint, found = document["joints"][name], fake_calibration[name]
        assert (joint["id"], joint["recommended"]) == (servo, found.recommended.way)
        assert joint["identification"]["verdict"] == "holds"
        assert joint["limits_deg"] == pytest.approx([-27.0, 27.0], abs=0.1)
        for each in found.candidates:
            expected = None if np.isnan(each.expected) else np.degrees(each.expected)
            assert joint["candidates"][each.way] == pytest.approx(
                {
                    "rms_deg": np.degrees(each.error),
                    "max_deg": np.degrees(each.max_error),
                    "largest_step_deg": np.degrees(each.largest_step),
                    "expected_rms_deg": expected,
                }
            )
    assert "a: The function f" in (tmp_path / "page.html").read_text("utf-8")


def test_joints_that_are_done_are_in_the_file_where_a_later_one_fails(
    run, fake_calibration, arm, tmp_path
):
    leg = ["[leg.front]", 'urdf = "robot.urdf"', 'base = "body"', 'foot = "toe"']
    kept = ARM.replace("joint_1", "kept").replace("id = 1", "id = 3")
    every = "v_max = 3.5\ntheta_0 = 0.1\nlag = 0.01\nacceleration_time = 0.02\n"
    every += "time_constant = 0.03\n"
    arm.write_text("\n".join([every, kept, ARM, *leg]) + "\n")
    ids = "joint_1=1,done=4,broken=2,later=3"
    result = run("calibrate", *BRIEF, "--ids", ids, "-o", "arm.toml")
    assert result.exit_code == 1
    assert result.stderr.endswith(
        "broken: does not follow; what was measured is in arm_logs; go on with --resume\n"
    )
    assert list(fake_calibration) == ["joint_1", "done"]
    assert list(read_models(arm)) == ["", *read_servos(arm)] == ["", "kept", "joint_1", "done"]
    assert (read_models(arm)[""].v_max, read_models(arm)["done"].time_constant) == (3.5, 0.0)
    for name, found in fake_calibration.items():
        assert read_models(arm)[name].v_max == pytest.approx(found.model.v_max)
        servo = read_servos(arm)[name]
        assert (servo.id, servo.settings["d_gain"]) == ({"joint_1": 1, "done": 4}[name], 32)
        assert np.degrees(servo.limits) == pytest.approx([-27.0, 27.0], abs=0.1)
    text = arm.read_text()
    assert text.splitlines()[2] == 'bus = "virtual"'
    assert text.endswith("\n".join(leg) + "\n")
    assert [file.name for file in tmp_path.iterdir()] == ["arm.toml"]


@pytest.mark.parametrize("answer", ["", "h"])
def test_ranges_are_those_of_the_servos_or_those_that_a_hand_shows(run, answer, monkeypatch):
    shown, limits, torques = {"joint_1": np.array([-0.4, 0.6])}, [], []
    own, own_check = calibration.with_ranges, calibration.check

    def by_hand(arm, ended, period):
        torques.append(arm.bus.port.servos.motors.powered.tolist())
        assert 0.0 < period < 0.1
        assert ended()
        return shown

    def with_ranges(arm, ranges):
        limits.append({name: np.degrees(each) for name, each in ranges.items()})
        return own(arm, ranges)

    def check(arm):
        arm.bus.write(1, "torque", 1)
        return own_check(arm)

    monkeypatch.setattr(calibration, "check", check)
    monkeypatch.setattr(calibration, "ranges_by_hand", by_hand)
    monkeypatch.setattr(calibration, "with_ranges", with_ranges)
    always = SimpleNamespace(select=lambda *_: ([1], [], []))
    monkeypatch.setattr(CALIBRATE, "select", always)
    stdin = f"{answer}\n" + "\n" * bool(answer) + "n\n"
    result = run("calibrate", *BRIEF[:-1], "--ids", "1", stdin=stdin)
    assert result.exit_code == 130, result.stderr
    assert "Ranges [deg]: joint_1 -30:30" in result.stderr
    expected = np.degrees(shown["joint_1"]) if answer else [-30.0, 30.0]
    assert limits[0]["joint_1"] == pytest.approx(expected, abs=0.2)
    assert torques == ([[0.0]] if answer else [])


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        ("3", {"joint_3": 3}),
        ("1-3", {"joint_1": 1, "joint_2": 2, "joint_3": 3}),
        (" pan = 7 ,2", {"pan": 7, "joint_2": 2}),
        ("0,252", {"joint_0": 0, "joint_252": 252}),
        *((text, None) for text in ("3-1", "253", "1,1", "a=1,a=2", "", "a=1000", "1;2")),
    ],
)
def test_identifiers_are_numbers_ranges_and_names_each_once(text, ids):
    if ids is None:
        with pytest.raises(click.UsageError, match="expected identifiers of servos, such as 1-6"):
            servos.IDS.convert(text, None, None)
    else:
        assert servos.IDS.convert(text, None, None) == ids


@pytest.fixture
def ports(monkeypatch):
    """Serial ports with a virtual servo, as they were opened."""
    made = []

    class Port(VirtualPort):
        def __init__(self, path, baud_rate=1_000_000):
            super().__init__(VirtualServos(1, servo_bus.KINDS["xl430"]))
            self.given, self.closed = (path, baud_rate), 0
            made.append(self)

        def close(self):
            self.closed += 1

    monkeypatch.setattr("planner.robot.bus.SerialPort", Port)
    return made


def test_the_port_is_that_of_the_command_or_of_the_file_and_is_given_back(run, arm, ports):
    file = 'bus = "dynamixel"\nport = "/dev/file"\n'
    record = ("record", "--model", arm, "--duration-s", "0.1")
    for text in (file, file + "baud_rate = 115200\n"):
        arm.write_text(text + ARM)
        assert run(*record).exit_code == 0
    assert run(*record, "--port", "/dev/b", "--baud-rate", "57600").exit_code == 0
    ports_given = [("/dev/file", 1_000_000), ("/dev/file", 115_200), ("/dev/b", 57_600)]
    assert [port.given for port in ports] == ports_given
    speaking = ("--bus", "feetech", "--port", "/dev/c", "--duration-s", "2")
    assert run(*record, *speaking).exit_code == 1  # the servo speaks another
    assert [port.closed for port in ports] == [1, 1, 1, 1]


def test_a_row_belongs_to_the_request_at_whose_time_it_was_due():
    times = np.array([0.004, 0.021, 0.068, 0.1])  # late; 2 and 4 were not sent
    angles = np.array([[0.0, np.nan], [0.1, 0.5], [0.3, np.nan], [0.5, 0.1]])
    found = calibration.by_request(times, angles, 7, 0.02)
    assert found[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5])
    assert found[:, 1] == pytest.approx([0.5, 0.5, 0.4, 0.3, 0.2, 0.1, 0.1])
    with pytest.raises(BusError, match="a joint was never read; check its cable"):
        calibration.by_request(times, np.column_stack([angles[:, 0], np.full(4, np.nan)]), 7, 0.02)


@pytest.mark.parametrize("by_hand", [True, False])
def test_the_torque_goes_off_for_a_hand_and_is_left_alone_for_others(
    run, arm, monkeypatch, by_hand
):
    written = []
    monkeypatch.setattr("planner.robot.bus.Bus.write", lambda _, *each: written.append(each))
    asked = ("record", "--bus", "virtual", "--model", arm, "--duration-s", "0.1")
    assert run(*asked, *["--by-hand"] * by_hand).exit_code == 0
    assert written == [(1, "torque", 0)] * by_hand


def test_ctrl_c_stops_a_motion_and_ends_a_record(
    run, arm, requests, monkeypatch, tmp_path, interrupted
):
    interrupted(40)
    result = run("record", "--bus", "virtual", "--model", arm)
    assert result.exit_code == 0
    assert result.stderr == "19 rows of joint_1 in log.csv; 0.0 % of answers lost\n"
    assert len((tmp_path / "log.csv").read_text().splitlines()) == 20

    def perform(self, rows, *, keep, **_):  # noqa: ARG001
        keep(0.0, rows[0], rows[0])
        return Playback(sent=1, interrupted=True)

    monkeypatch.setattr(Arm, "perform", perform)
    result = run("play", requests, "--bus", "virtual", "--model", arm, "-o", "new.csv")
    assert result.exit_code == 130
    assert result.stderr.endswith("torque as before; the log until then is new.csv.part\n")
    assert not (tmp_path / "new.csv").exists()


@pytest.mark.parametrize(("gentle", "beyond"), [(4.0, 0.6), (0.0, 1.0)])
def test_a_check_compares_the_parts_of_a_motion_that_the_logs_of_the_model_tested(gentle, beyond):
    """The predicted motion accelerates fourfold in the second part."""
    model = JointModel(v_max=9.0, theta_0=0.2, lag=0.02, acceleration_time=0.02, tick=0.02)
    model = model.with_evidence(Evidence(0.01, by_acceleration=((0.0, 0.01), (15.0, 0.02))))
    times = 0.02 * np.arange(round((gentle + 6.0) / 0.02))
    slow = times < gentle
    requests = 0.3 * np.sin(np.where(slow, 2.0 * np.pi, 4.0 * np.pi) * times)
    angles = simulate(model, requests, cyclic=False, start=0.0)
    angles = angles + np.where(slow, 0.03, 0.5 * (times > 0.0))
    log = Log(times=times, requests=requests, angles=angles)
    error, expected, most, share = calibration.errors(model, log)
    assert error == pytest.approx(0.03 if gentle else 0.5, rel=0.02)
    assert expected == pytest.approx(0.016 if gentle else 0.04, rel=0.2)
    assert most >= expected
    assert share == pytest.approx(beyond, abs=0.01)


ALL_FAULTS = (
    "--fault drop=1 --fault disconnect=0 --fault power-off=3.5 --fault stall=1@5 --fault "
    "stall=6@0.5 --fault overheat=3@7 --fault saturate=2@1"
)
KNOWN = {"drop": 1.0, "disconnect": 0.0, "power_off": 3.5}
KNOWN |= {"stall": {1: 5.0, 6: 0.5}, "overheat": {3: 7.0}, "saturate": {2: 1.0}}


@pytest.mark.parametrize(
    ("asked", "count", "kind", "faults", "step"),
    [
        (ALL_FAULTS, 6, "sts3215", Faults(**KNOWN), None),
        ("--servos 2 --step-ms 20 --kind mx-64", 2, "mx-64", Faults(), 0.02),
    ],
    ids=["faults", "others"],
)
def test_the_servos_that_are_asked_for_are_served_at_the_port_that_is_printed(
    run, monkeypatch, asked, count, kind, faults, step
):
    made, served = [], []

    def servos(*given, **more):
        made.append((*given, more))
        return SimpleNamespace(run=lambda _: None)

    @contextmanager
    def terminal():
        yield 7, "/dev/pts/9"

    monkeypatch.setattr(servo_bus, "VirtualServos", servos)
    monkeypatch.setattr(servo_bus, "terminal", terminal)
    monkeypatch.setattr(servo_bus, "serve", lambda _, end: served.append(end))
    result = run("virtual-bus", *asked.split())
    assert result.stdout == "/dev/pts/9\n"
    assert served == [7]
    assert made == [(count, KINDS[kind], {"faults": faults, "step": pytest.approx(step)})]
