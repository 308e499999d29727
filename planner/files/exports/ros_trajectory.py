"""Requests for ROS 2: a ``trajectory_msgs/JointTrajectory``, as YAML or as a bag.

The YAML is input for ``ros2 topic pub``; the bag, in SQLite or MCAP, is for ``ros2 bag play``.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from planner.exceptions import InvalidInput, importing
from planner.files.staging import cannot_write, output_folder
from planner.files.table import DECIMALS
from planner.files.text import write_text
from planner.robot.schedule import NANOSECONDS, Schedule
from planner.trajectory import Array

TYPE = "trajectory_msgs/msg/JointTrajectory"
"""The message's type in ROS 2."""

LONGEST = 2**31 - 1
"""Latest time that ``builtin_interfaces/Duration`` holds [s]."""

Storage = Literal["sqlite3", "mcap"]
"""How a bag keeps its messages."""

TOPIC = "/joint_trajectory_controller/joint_trajectory"
"""Where ros2_control's joint trajectory controller listens by default."""

VERSION: Literal[8] = 8
"""Version of the bag's metadata; ROS 2 before Jazzy does not read the next one."""


def joint_trajectory(
    schedule: Schedule, *, lead: float = 0.0, velocities: bool = False
) -> dict[str, Any]:
    """The message: a point per request, at its time after the lead.

    With a stamp of zero controllers begin when the message arrives.

    Args:
        schedule: The requests.
        lead: Time of the first point [s], in which a controller leads the joints there.
        velocities: Whether points carry velocities; a controller then follows cubic splines.

    Returns:
        The message's fields, with points that carry positions [rad], times, and perhaps velocities.

    Raises:
        InvalidInput: A lead below 0, points within a nanosecond, or one too late for a duration
            of ROS.
    """
    check_times(schedule, lead)
    times = schedule.nanoseconds + round(lead * NANOSECONDS)
    positions = np.round(schedule.requests, DECIMALS) + 0.0  # no negative zero
    points = [
        {
            "positions": row,
            "time_from_start": {"sec": time // NANOSECONDS, "nanosec": time % NANOSECONDS},
        }
        for row, time in zip(positions.tolist(), times.tolist(), strict=True)
    ]
    if velocities:
        for point, row in zip(points, _velocities(schedule).tolist(), strict=True):
            point["velocities"] = row
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(schedule.names),
        "points": points,
    }


def check_times(schedule: Schedule, lead: float) -> None:
    """Make sure that ROS can represent the times of the points.

    Raises:
        InvalidInput: As :func:`joint_trajectory` does.
    """
    if not 0.0 <= lead < math.inf:
        raise InvalidInput(f"lead: got {lead:g} s, expected 0 or more")
    if schedule.duration + lead >= LONGEST or schedule.period * NANOSECONDS < 1.0:
        raise InvalidInput(
            f"a request every {schedule.period:g} s until {schedule.duration + lead:g} s: ROS has "
            f"whole nanoseconds up to {LONGEST} s; export fewer cycles, or at another rate"
        )


def write_trajectory_yaml(path: Path | str, message: Mapping[str, Any]) -> None:
    """Write the message of :func:`joint_trajectory` to a file, or to standard output for ``-``.

    Raises:
        MissingExtra: PyYAML is not installed.
        InvalidFile: The file cannot be written.
    """
    write_text(path, trajectory_yaml(message))


def trajectory_yaml(message: Mapping[str, Any]) -> str:
    """The message's text, by PyYAML, with which ROS reads it.

    Names such as ``on``, which YAML 1.1 would read as other types, are quoted.
    """
    with importing("a trajectory as YAML", "yaml"):
        import yaml
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # in C where there is one
    text: str = yaml.dump(
        dict(message),
        Dumper=dumper,
        default_flow_style=None,  # a line for a row of numbers
        sort_keys=False,
        allow_unicode=True,
        width=10**6,
    )
    return text


def write_bag(
    path: Path | str,
    message: Mapping[str, Any],
    *,
    storage: Storage = "sqlite3",
    topic: str = TOPIC,
) -> None:
    """Write the message of :func:`joint_trajectory` as a folder for ``ros2 bag play``, at time 0.

    Raises:
        MissingExtra: rosbags is not installed.
        InvalidInput: A topic without a name.
        InvalidFile: The folder holds something else, or cannot be written.
    """
    with importing("a ROS 2 bag", "bags"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    check_topic(topic)
    types = get_typestore(Stores.ROS2_HUMBLE)
    content = types.serialize_cdr(_as_message(types.types, message), TYPE)
    plugin = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
    with output_folder(path, export=f"ROS 2 bag ({storage})") as folder:
        inner = folder / Path(path).resolve().name  # the writer names its files after its folder
        try:
            with Writer(inner, version=VERSION, storage_plugin=plugin) as writer:
                connection = writer.add_connection(topic, TYPE, typestore=types)
                writer.write(connection, 0, content)
        except sqlite3.Error as error:  # such as where the disk is full
            raise cannot_write(path, error) from error
        for file in list(inner.iterdir()):
            file.rename(folder / file.name)
        inner.rmdir()


def check_topic(topic: str) -> None:
    """Make sure that a topic has a name.

    Raises:
        InvalidInput: The topic has no name.
    """
    if not topic.strip("/") or any(character.isspace() for character in topic):
        raise InvalidInput(f"topic: got '{topic}', expected a name such as {TOPIC}")


def _velocities(schedule: Schedule) -> Array:
    """Central differences [rad/s]; the joints stand at the last point, or controllers refuse it."""
    velocities = np.zeros_like(schedule.requests)
    if len(velocities) > 1:
        velocities[:-1] = np.gradient(schedule.requests, schedule.period, axis=0)[:-1]
    return np.asarray(np.round(velocities, DECIMALS) + 0.0, dtype=np.float64)


def _as_message(types: Any, message: Mapping[str, Any]) -> Any:
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    duration = types["builtin_interfaces/msg/Duration"]
    time = types["builtin_interfaces/msg/Time"]
    nothing = np.zeros(0)
    return types[TYPE](
        header=types["std_msgs/msg/Header"](
            stamp=time(**message["header"]["stamp"]), frame_id=message["header"]["frame_id"]
        ),
        joint_names=message["joint_names"],
        points=[
            point(
                positions=np.array(each["positions"]),
                velocities=np.array(each.get("velocities", nothing), dtype=np.float64),
                accelerations=nothing,
                effort=nothing,
                time_from_start=duration(**each["time_from_start"]),
            )
            for each in message["points"]
        ],
    )
