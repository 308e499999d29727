"""CSV for a controller: held requests at its rate, in its unit."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from planner import InvalidInput, LogOptions, MissingExtra, read_logs
from planner.files.exports import (
    ON_TIME,
    TOPIC,
    TYPE,
    Layout,
    Schedule,
    check_installed,
    joint_trajectory,
    lerobot_dataset,
    resampled,
    write_bag,
    write_controller_csv,
    write_trajectory_yaml,
)
from planner.files.paths import read_joint_path
from planner.files.staging import list_files
from planner.robot.arm import Servo

ROUNDING = 1e-10  # twelve decimals of a degree are written [rad]


def _numbered(rows, period):
    """A joint whose request is the number of the request."""
    return Schedule(("knee",), np.arange(float(rows))[:, None], period)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_what_is_written_is_read_back_as_a_joint_path(schedule, tmp_path, unit):
    file = tmp_path / "requests.csv"
    write_controller_csv(file, schedule, unit=unit)
    assert file.read_text().splitlines()[0] == f"t_s,hip_{unit},on_{unit},knee_{unit}"
    given = read_joint_path(file)
    assert np.max(np.abs(given.values - schedule.requests)) <= ROUNDING
    assert np.max(np.abs(given.times - schedule.times)) <= ROUNDING


def test_a_servo_gets_the_nearest_count_and_cannot_go_beyond_its_turn(tmp_path):
    near = Schedule(("knee",), np.array([[2.6], [-2.6]]) * 2.0 * np.pi / 4096.0, 0.02)
    write_controller_csv(tmp_path / "t.csv", near, unit="ticks", servos={"knee": Servo()})
    assert (tmp_path / "t.csv").read_text().split() == ["t_s,knee_ticks", "0.0,2051", "0.02,2045"]
    schedule = Schedule(("knee",), np.array([[np.pi]]), 0.02)
    with pytest.raises(InvalidInput) as caught:
        write_controller_csv("-", schedule, unit="ticks", servos={"knee": Servo()})
    assert str(caught.value) == (
        "knee: request 0, 180.00 deg, is tick 4096, expected 0 to 4095; check the zero tick, "
        "the ticks per turn and the direction"
    )


def test_at_the_same_rate_but_for_rounding_every_request_is_sent_once():
    for period in (0.033333333334, 0.033333333333):
        same = resampled(_numbered(90, period), 30.0)
        assert same.requests[:, 0].tolist() == list(range(90))


@given(st.integers(1, 60), st.floats(1e-3, 1.0), st.floats(10.0, 2000.0))
def test_a_held_row_is_the_request_of_its_time(rows, period, rate):
    given_rows = _numbered(rows, period)
    try:
        held = resampled(given_rows, rate)
    except InvalidInput:  # some would never be sent
        assume(False)
    numbers = held.requests[:, 0]
    slack = 2.0 * ON_TIME * max(period, 1.0 / rate)
    assert (held.times >= numbers * period - slack).all()
    assert (held.times <= (numbers + 1.0) * period + slack).all()
    assert held.duration - given_rows.duration + slack >= 0.0
    assert held.duration - given_rows.duration <= 1.0 / rate + slack


def test_shares_of_a_range_are_percent_beside_degrees_and_shares_beside_radians(tmp_path):
    file, carried = tmp_path / "out.csv", np.radians([[90.0, 25.0], [0.0, 100.0]])
    schedule = Schedule(("hip", "jaw"), carried, 0.02, ("deg", "percent"))
    write_controller_csv(file, schedule, unit="deg")
    assert file.read_text() == "t_s,hip_deg,jaw_percent\n0.0,90.0,25.0\n0.02,0.0,100.0\n"
    write_controller_csv(file, resampled(schedule, 100.0), unit="rad")
    head, first, *_ = file.read_text().splitlines()
    assert (head, first) == ("t_s,hip_rad,jaw_range", "0.0,1.570796326795,0.25")


def test_hobby_servos_get_pulses_in_microseconds_of_their_own_centre_and_direction(tmp_path):
    file = tmp_path / "pulses.csv"
    quarter = Schedule(("hip", "knee"), np.array([[0.0, 0.0], [0.25, 0.125]]) * 2.0 * np.pi, 0.02)
    hip = Servo(zero_tick=1500, ticks_per_turn=4000)
    servos = {"hip": hip, "knee": replace(hip, zero_tick=1460, direction=-1)}
    write_controller_csv(file, quarter, unit="us", servos=servos)
    assert file.read_text() == "t_s,hip_us,knee_us\n0.0,1500,1460\n0.02,2500,960\n"
    beyond = r"knee: request 1, 45\.00 deg, is a pulse of 2540 us, expected 500 to 2500; check"
    servos = {"hip": hip, "knee": replace(hip, zero_tick=2040)}
    with pytest.raises(InvalidInput, match=beyond):
        write_controller_csv(file, quarter, unit="us", servos=servos)


@pytest.mark.parametrize(
    ("form", "extra"), [("yaml", "yaml"), ("bag", "bags"), ("mcap", "bags"), ("lerobot", "parquet")]
)
def test_a_format_whose_package_is_not_installed_is_refused_at_once(form, extra, monkeypatch):
    monkeypatch.setattr("planner.files.exports.find_spec", lambda _: None)
    check_installed("csv")
    with pytest.raises(MissingExtra, match=rf"request-planner\[{extra}\]"):
        check_installed(form)


@pytest.fixture
def schedule():
    phase = 2.0 * np.pi * np.arange(64) / 64
    rows = np.column_stack([0.4 * np.sin(phase), 0.3 * np.cos(phase), 1.0 + 0.2 * np.sin(phase)])
    return Schedule(("hip", "on", "knee"), rows, 0.008)


def test_times_carry_over_into_seconds_and_do_not_drift():
    third = Schedule(("knee",), np.zeros((4000, 1)), 1.0 / 30.0)
    points = joint_trajectory(third, lead=1.5)["points"]
    assert points[0]["time_from_start"] == {"sec": 1, "nanosec": 500_000_000}
    assert points[3000]["time_from_start"] == {"sec": 101, "nanosec": 500_000_000}
    assert points[1]["time_from_start"] == {"sec": 1, "nanosec": 533_333_333}


def test_yaml_is_read_back_by_the_parser_of_ros_and_small_numbers_stay_numbers(schedule, tmp_path):
    yaml = pytest.importorskip("yaml", reason="needs the extra yaml")
    message = joint_trajectory(schedule)
    file = tmp_path / "trajectory.yaml"
    write_trajectory_yaml(file, message)
    assert yaml.safe_load(file.read_text()) == message
    lines = file.read_text().splitlines()
    assert lines[:2] == ["header:", "  stamp: {sec: 0, nanosec: 0}"]
    assert "joint_names: [hip, 'on', knee]" in lines  # bare, YAML 1.1 takes it for true
    assert "  time_from_start: {sec: 0, nanosec: 8000000}" in lines
    rows = np.array([[1e-7], [-3e-12], [-1e-14], [-1e-14]])
    tiny = joint_trajectory(Schedule(("knee",), rows, 0.1))
    write_trajectory_yaml(tmp_path / "tiny.yaml", tiny)
    text = (tmp_path / "tiny.yaml").read_text()
    assert yaml.safe_load(text) == tiny
    assert "-0.0]" not in text


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_bag_is_read_back(schedule, tmp_path, storage):
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra bags")
    from rosbags.typesys import Stores, get_typestore

    out = tmp_path / "walk"
    points = joint_trajectory(schedule, lead=2.0)
    write_bag(out, points, storage=storage)
    ending = {"sqlite3": "db3", "mcap": "mcap"}[storage]
    assert list_files(out) == ["metadata.yaml", "results.json", f"walk.{ending}"]
    with rosbag2.Reader(out) as reader:
        ((connection, stamp, content),) = reader.messages()
    assert (connection.topic, connection.msgtype, stamp) == (TOPIC, TYPE, 0)
    message = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(content, TYPE)
    assert message.joint_names == ["hip", "on", "knee"]
    positions = np.array([point.positions for point in message.points])
    assert np.max(np.abs(positions - schedule.requests)) <= ROUNDING
    assert [point.time_from_start.nanosec for point in message.points[:2]] == [0, 8_000_000]
    assert message.points[0].time_from_start.sec == 2


@pytest.fixture
def parquet():
    return pytest.importorskip("pyarrow.parquet", reason="needs the extra parquet")


def test_episodes_follow_one_another_and_their_statistics_are_those_of_their_rows(
    tmp_path, parquet, snapshot
):
    rng = np.random.default_rng(2)
    actions = [rng.normal(size=(count, 2)) for count in (4, 5, 3)]
    layout = Layout(features={"action": ("a", "b"), "observation.state": ("a", "b")}, rate=30)
    with lerobot_dataset(tmp_path / "out", layout) as add:
        for number, action in enumerate(actions):
            add({"action": action, "observation.state": -action}, "up" if number > 1 else "down")
    read = read_logs(tmp_path / "out", options=LogOptions(joint="a", unit="rad"))
    for log, action in zip(read, actions, strict=True):
        assert log.requests == pytest.approx(action[:, 0], abs=1e-6)
        assert log.angles == pytest.approx(-action[:, 0], abs=1e-6)
    files = ("data/chunk-000/file-000", "meta/episodes/chunk-000/file-000", "meta/tasks")
    rows = [row for file in files for row in _rows(parquet, tmp_path / "out" / f"{file}.parquet")]
    stats = json.loads((tmp_path / "out" / "meta" / "stats.json").read_text())
    snapshot.check("episodes", "".join(f"{each}\n" for each in (*rows, stats["action"])))


def _rows(parquet, file):
    """The rows of a table, what is the same in all of them left out after the first."""
    before = {}
    for row in parquet.read_table(file).to_pylist():
        yield {name: each for name, each in row.items() if before.get(name) != each}
        before = row
