"""Bags as robots write them: ROS 2 (sqlite3, MCAP) and ROS 1, with their own definitions."""

import sqlite3

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from planner.files.logs.bag import CONTROLLER_STATE, STATE_IN_HUMBLE

START = 1_732_104_192_123_456_789
"""Time of the first message since the epoch [ns]; no float64 holds it."""

PERIOD = 10_000_000  # time between messages [ns]
JOINTS = ("hip", "knee")

HEAD = "std_msgs/Header header\nstring[] joint_names\n"
POINTS = {
    "old": ("desired", "actual", "error"),
    "new": ("reference", "feedback", "error", "output"),
}
OLD, NEW = (
    HEAD + "".join(f"trajectory_msgs/JointTrajectoryPoint {name}\n" for name in names)
    for names in POINTS.values()
)
LAYOUTS = {"old": OLD, "humble": STATE_IN_HUMBLE, "new": NEW}
"""A controller's state up to Galactic, in Humble, and since Iron (without its last fields)."""


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

    def message(self, kind, **values):
        """A message of zeros and empty lists but for these values."""

        def default(form, of):
            if form == Nodetype.NAME:
                return self.message(of)
            if form == Nodetype.BASE:
                return "" if of[0] == "string" else 0
            return np.array([]) if of[0][1][0] == "float64" else []

        fields = dict(self.types.fielddefs[kind][1])
        own = {name: value for name, value in values.items() if name in fields}
        missing = {name: default(*node) for name, node in fields.items() if name not in own}
        return self.types.types[kind](**own, **missing)

    def header(self, nanoseconds):
        sec, nanosec = divmod(nanoseconds, 1_000_000_000)
        stamp = self.message("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.message("std_msgs/msg/Header", stamp=stamp)

    def point(self, values):
        return self.message(
            "trajectory_msgs/msg/JointTrajectoryPoint", positions=np.array(values, dtype=float)
        )

    def state(self, nanoseconds, requested, actual, joints=JOINTS):
        """A controller's state, whatever its layout."""
        request, angle = self.point(requested), self.point(actual)
        points = {"reference": request, "desired": request, "feedback": angle, "actual": angle}
        names = {"header": self.header(nanoseconds), "joint_names": list(joints)}
        return self.message(CONTROLLER_STATE, **names, **points)

    def joint_state(self, nanoseconds, values, joints=JOINTS):
        header, angles = self.header(nanoseconds), np.array(values, dtype=float)
        return self.message(
            "sensor_msgs/msg/JointState", header=header, name=list(joints), position=angles
        )

    def trajectory(self, nanoseconds, values, joints=JOINTS):
        points = [self.point(values), self.point([9.0] * len(values))]
        header, names = self.header(nanoseconds), list(joints)
        return self.message(
            "trajectory_msgs/msg/JointTrajectory", header=header, joint_names=names, points=points
        )

    def numbers(self, values):
        return self.message("std_msgs/msg/Float64MultiArray", data=np.array(values, dtype=float))

    def number(self, value):
        return self.message("std_msgs/msg/Float64", data=float(value))


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
