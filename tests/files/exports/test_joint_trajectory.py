"""The ROS message, as YAML and in bags, read back by the libraries that ROS people use."""

from __future__ import annotations

import numpy as np
import pytest

from planner.files.exports import TOPIC, TYPE, joint_trajectory, write_bag, write_trajectory_yaml
from planner.files.staging import list_files
from planner.robot.schedule import Schedule

ROUNDING = 1e-12
"""Twelve decimals are written [rad]."""


def _nanoseconds(duration):
    return duration["sec"] * 10**9 + duration["nanosec"]


def test_every_request_is_a_point_at_its_nanosecond(schedule):
    message = joint_trajectory(schedule)
    assert message["joint_names"] == ["hip", "on", "knee"]
    times = [_nanoseconds(point["time_from_start"]) for point in message["points"]]
    assert times == [8_000_000 * k for k in range(64)]
    positions = np.array([point["positions"] for point in message["points"]])
    assert np.max(np.abs(positions - schedule.requests)) <= ROUNDING
    assert "velocities" not in message["points"][0]
    assert message["header"]["stamp"] == {"sec": 0, "nanosec": 0}


def test_times_carry_over_into_seconds_and_do_not_drift():
    third = Schedule(("knee",), np.zeros((4000, 1)), 1.0 / 30.0)
    points = joint_trajectory(third, lead=1.5)["points"]
    assert points[0]["time_from_start"] == {"sec": 1, "nanosec": 500_000_000}
    assert points[3000]["time_from_start"] == {"sec": 101, "nanosec": 500_000_000}
    assert points[1]["time_from_start"] == {"sec": 1, "nanosec": 533_333_333}


def test_velocities_are_those_of_the_requests_and_end_at_rest(schedule):
    points = joint_trajectory(schedule, velocities=True)["points"]
    velocities = np.array([point["velocities"] for point in points])
    phase = 2.0 * np.pi * np.arange(64) / 64
    exact = 0.4 * np.cos(phase) * 2.0 * np.pi / (64 * 0.008)
    assert (
        np.max(np.abs(velocities[1:-1, 0] - exact[1:-1])) < 0.01
    )  # h² / 6 of the third derivative
    assert velocities[-1].tolist() == [0.0, 0.0, 0.0]


def test_yaml_is_read_back_by_the_parser_of_ros(schedule, tmp_path):
    yaml = pytest.importorskip("yaml", reason="needs the extra yaml")
    message = joint_trajectory(schedule, velocities=True)
    file = tmp_path / "trajectory.yaml"
    write_trajectory_yaml(file, message)
    assert yaml.safe_load(file.read_text()) == message
    lines = file.read_text().splitlines()
    assert lines[:2] == ["header:", "  stamp: {sec: 0, nanosec: 0}"]
    assert "joint_names: [hip, 'on', knee]" in lines  # bare, YAML 1.1 takes it for true
    assert "  time_from_start: {sec: 0, nanosec: 8000000}" in lines


def test_small_numbers_stay_numbers_in_yaml(tmp_path):
    yaml = pytest.importorskip("yaml", reason="needs the extra yaml")
    rows = np.array([[1e-7], [-3e-12], [-1e-14], [-1e-14]])
    tiny = joint_trajectory(Schedule(("knee",), rows, 0.1), velocities=True)
    write_trajectory_yaml(tmp_path / "tiny.yaml", tiny)
    text = (tmp_path / "tiny.yaml").read_text()
    assert yaml.safe_load(text) == tiny
    assert "-0.0]" not in text


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_bag_is_read_back(schedule, tmp_path, storage):
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra bags")
    from rosbags.typesys import Stores, get_typestore

    out = tmp_path / "walk"
    points = joint_trajectory(schedule, lead=2.0, velocities=storage == "mcap")
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
    for point, given in zip(message.points, points["points"], strict=True):
        assert point.velocities.tolist() == given.get("velocities", [])
