"""A ROS 2 bag, in SQLite or MCAP, that holds one JointTrajectory."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from planner.exceptions import InvalidInput, MissingExtra
from planner.files.exports.folder import export_folder
from planner.files.exports.joint_trajectory import TYPE

Storage = Literal["sqlite3", "mcap"]
"""How a bag keeps its messages."""

TOPIC = "/joint_trajectory_controller/joint_trajectory"
"""Where ros2_control's joint trajectory controller listens by default."""

VERSION: Literal[8] = 8
"""Of the bag's metadata; the next one is not read by ROS 2 before Jazzy."""


def write_bag(
    path: Path | str,
    message: Mapping[str, Any],
    *,
    storage: Storage = "sqlite3",
    topic: str = TOPIC,
) -> None:
    """Write what :func:`joint_trajectory` makes as a folder for ``ros2 bag play``, at time 0.

    Raises:
        MissingExtra: rosbags is not installed.
        InvalidInput: A topic without a name.
        InvalidFile: The folder holds something else, or cannot be written.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtra("a ROS 2 bag", "bags") from error
    check_topic(topic)
    types = get_typestore(Stores.ROS2_HUMBLE)
    content = types.serialize_cdr(_as_message(types.types, message), TYPE)
    plugin = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
    with export_folder(path, export=f"ROS 2 bag ({storage})") as folder:
        inner = folder / Path(path).resolve().name  # the writer names its files after its folder
        with Writer(inner, version=VERSION, storage_plugin=plugin) as writer:
            connection = writer.add_connection(topic, TYPE, typestore=types)
            writer.write(connection, 0, content)
        for file in list(inner.iterdir()):
            file.rename(folder / file.name)
        inner.rmdir()


def check_topic(topic: str) -> None:
    """Make sure that a topic has a name.

    Raises:
        InvalidInput: It has none.
    """
    if not topic.strip("/") or any(character.isspace() for character in topic):
        raise InvalidInput(f"topic: got '{topic}', expected a name such as {TOPIC}")


def _as_message(types: Any, message: Mapping[str, Any]) -> Any:
    """The message in the classes that rosbags serialises."""
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
