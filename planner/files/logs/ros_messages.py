"""What single messages tell: of which joints, when, and which angles."""

from __future__ import annotations

from typing import Any, NamedTuple

from planner.files.logs.bag_file import LATEST
from planner.files.logs.controller_state import CONTROLLER_STATE

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
NUMBERS = "std_msgs/msg/Float64MultiArray"
NUMBER = "std_msgs/msg/Float64"

ACTUAL_TYPES = (CONTROLLER_STATE, JOINT_STATE)
"""Types that tell actual angles."""

REQUEST_TYPES = (CONTROLLER_STATE, TRAJECTORY, NUMBERS, NUMBER, JOINT_STATE)
"""Types that tell requested angles."""


class Told(NamedTuple):
    """What one message tells.

    Attributes:
        stamp: The stamp of its header [ns]; 0 where it has none.
        joints: The joints; None where it names none.
        angles: An angle for each.
        field: The field that holds them.
    """

    stamp: int
    joints: tuple[str, ...] | None
    angles: tuple[float, ...]
    field: str


def requested_angles(kind: str, content: Any) -> Told:
    """The requested angles of a message; none where it holds none, such as an empty trajectory."""
    if kind == CONTROLLER_STATE:
        return _controller(content)[0]
    if kind == JOINT_STATE:
        return _told(content, content.name, content.position, "position")
    if kind == TRAJECTORY:
        if not content.points:
            return _told(content, (), (), "points")
        return _told(content, content.joint_names, content.points[0].positions, "points")
    angles = content.data if kind == NUMBERS else (content.data,)
    return Told(0, None, tuple(map(float, angles)), "data")


def actual_angles(kind: str, content: Any) -> Told:
    """The actual angles of a message; none where a state tells of speeds only."""
    if kind == CONTROLLER_STATE:
        return _controller(content)[1]
    names = content.name if len(content.position) else ()
    return _told(content, names, content.position, "position")


def _controller(content: Any) -> tuple[Told, Told]:
    """Requested and actual angles of a controller's state, by the names that its layout has."""
    pairs = (("reference", "feedback"), ("desired", "actual"))
    known = [pair for pair in pairs if all(hasattr(content, name) for name in pair)]
    filled = [pair for pair in known if len(getattr(content, pair[1]).positions)]
    requested, actual = (
        _told(content, content.joint_names, getattr(content, name).positions, name)
        for name in (filled or known)[0]
    )
    return requested, actual


def _told(content: Any, joints: Any, angles: Any, field: str) -> Told:
    stamp = content.header.stamp
    nanoseconds = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    return Told(
        nanoseconds if 0 < nanoseconds < LATEST else 0,
        tuple(map(str, joints)),
        tuple(map(float, angles)),
        field,
    )
