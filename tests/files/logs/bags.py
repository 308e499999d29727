"""Bags as robots write them: ROS 2 (sqlite3, MCAP) and ROS 1, with their own definitions."""

from __future__ import annotations

import sqlite3

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from planner.files.logs.bag_file import CONTROLLER_STATE, LAYOUTS

START = 1_732_104_192_123_456_789
"""Time of the first message since the epoch [ns]; no float64 holds it."""

PERIOD = 10_000_000
"""Time between messages [ns]."""

JOINTS = ("hip", "knee")

OLD, HUMBLE, NEW = LAYOUTS
"""Layouts of a controller's state: up to Galactic, Humble, since Iron."""


def store(layout=NEW, *, ros1=False):
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(layout, CONTROLLER_STATE))
    return types


def angles(count=50):
    """Requested and actual angles of both joints, shape (count, 2) each."""
    k = np.arange(count)[:, None]
    requested = np.sin(0.2 * k + np.array([0.0, 1.0]))
    return requested, 0.9 * requested - 0.01


class Kit:
    """Builds messages of one store."""

    def __init__(self, types):
        self.types = types
        self.t = types.types

    def stamp(self, nanoseconds):
        sec, nanosec = divmod(nanoseconds, 1_000_000_000)
        return self.t["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)

    def header(self, nanoseconds):
        extra = {"seq": 0} if "seq" in _fields(self.t["std_msgs/msg/Header"]) else {}
        return self.t["std_msgs/msg/Header"](stamp=self.stamp(nanoseconds), frame_id="", **extra)

    def point(self, values):
        return self.t["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=np.array(values, dtype=np.float64),
            velocities=np.array([]),
            accelerations=np.array([]),
            effort=np.array([]),
            time_from_start=self.t["builtin_interfaces/msg/Duration"](sec=0, nanosec=0),
        )

    def state(self, nanoseconds, requested, actual, joints=JOINTS):
        """A controller's state, whatever its layout."""
        known = {"reference": requested, "desired": requested, "feedback": actual, "actual": actual}
        content = {"header": self.header(nanoseconds), "joint_names": list(joints)}
        for name in _fields(self.t[CONTROLLER_STATE]):
            if name in ("error", "output", *known):
                content[name] = self.point(known.get(name, [0.0] * len(joints)))
            elif name == "multi_dof_joint_names":
                content[name] = []
            elif name.startswith("multi_dof"):
                content[name] = self.t["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"](
                    transforms=[],
                    velocities=[],
                    accelerations=[],
                    time_from_start=self.t["builtin_interfaces/msg/Duration"](sec=0, nanosec=0),
                )
        return self.t[CONTROLLER_STATE](**content)

    def joint_state(self, nanoseconds, values, joints=JOINTS):
        return self.t["sensor_msgs/msg/JointState"](
            header=self.header(nanoseconds),
            name=list(joints),
            position=np.array(values, dtype=np.float64),
            velocity=np.array([]),
            effort=np.array([]),
        )

    def trajectory(self, nanoseconds, values, joints=JOINTS):
        return self.t["trajectory_msgs/msg/JointTrajectory"](
            header=self.header(nanoseconds),
            joint_names=list(joints),
            points=[self.point(values), self.point([9.0] * len(values))],
        )

    def numbers(self, values):
        layout = self.t["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        return self.t["std_msgs/msg/Float64MultiArray"](
            layout=layout, data=np.array(values, dtype=np.float64)
        )

    def number(self, value):
        return self.t["std_msgs/msg/Float64"](data=float(value))


def write(path, types, messages, *, storage="sqlite3", compression=None):
    """Write ``(topic, time of receipt, message)`` to a bag; the path to read."""
    if storage == "ros1":
        bag = rosbag1.Writer(path)
    else:
        bag = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage.upper()])
    if compression is not None:
        bag.set_compression(*compression)
    with bag:
        connections = {}
        for topic, received, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=types)
            serialize = types.serialize_ros1 if storage == "ros1" else types.serialize_cdr
            bag.write(connections[topic], received, serialize(message, kind))
    return path


def only_file(folder, ending):
    """The one file of a bag's folder that holds its messages."""
    (file,) = folder.glob(f"*{ending}")
    return file


def forget_definitions(file):
    """Leave out of a .db3 what bags before ROS 2 Iron did not have."""
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM message_definitions")
    database.close()


def _fields(kind):
    return tuple(kind.__dataclass_fields__)
