"""Angles of joints in messages of ROS, and the topics of a bag that hold them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from planner.exceptions import InvalidFile, nearest
from planner.files.logs.options import ALL_JOINTS, LogOptions

LATEST = 2**63
"""Stamps from here on [ns] are invalid."""

CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
NUMBERS = "std_msgs/msg/Float64MultiArray"
NUMBER = "std_msgs/msg/Float64"

ACTUAL_TYPES = (CONTROLLER_STATE, JOINT_STATE)
"""Types with actual angles."""

REQUEST_TYPES = (CONTROLLER_STATE, TRAJECTORY, NUMBERS, NUMBER, JOINT_STATE)
"""Types with requested angles."""


def _layout(points: str, multi_dof_points: str = "") -> str:
    lines = ["std_msgs/Header header", "string[] joint_names"]
    lines += [f"trajectory_msgs/JointTrajectoryPoint {name}" for name in points.split()]
    if multi_dof_points:
        lines.append("string[] multi_dof_joint_names")
    lines += [
        f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}"
        for name in multi_dof_points.split()
    ]
    return "\n".join(lines)


LAYOUTS = (
    _layout("desired actual error"),
    _layout(*("reference feedback error output desired actual",) * 2),
    _layout(*("reference feedback error output",) * 2),
)
"""Layouts of a controller's state: up to Galactic, in Humble, and since Iron.

A bag without definitions of its types, as ROS 2 wrote them before Iron, does not say which one it
holds. Only the right one explains all the bytes of a message.
"""


class MessageAngles(NamedTuple):
    """The angles in one message.

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


def choose_topics(path: Path, kinds: Mapping[str, str], options: LogOptions) -> tuple[str, str]:
    """The topics of actual and of requested angles, which may be the same one.

    They are those that the options name, or the only ones that their types allow.

    Raises:
        InvalidFile: No topic, or several, are possible; the message lists them.
    """
    requested = options.command_topic
    if requested is not None:
        _check(path, kinds, requested, REQUEST_TYPES, "--command-topic")
    actual = options.topic
    if actual is not None:
        _check(path, kinds, actual, ACTUAL_TYPES, "--topic")
    else:
        actual = _actual(path, kinds, requested)
    if requested is None:
        own = kinds[actual] == CONTROLLER_STATE
        requested = actual if own else _requested(path, kinds, actual, options.joint)
    if requested == actual and kinds[actual] != CONTROLLER_STATE:
        raise InvalidFile(
            path,
            f"topic {actual} holds one angle of each joint, expected another topic for the "
            "requested angles; name it with --command-topic",
        )
    return actual, requested


def _actual(path: Path, kinds: Mapping[str, str], command_topic: str | None) -> str:
    states = [topic for topic, kind in kinds.items() if kind == JOINT_STATE]
    controllers = [topic for topic, kind in kinds.items() if kind == CONTROLLER_STATE]
    if command_topic is not None and kinds[command_topic] != CONTROLLER_STATE:
        controllers = [] if set(states) - {command_topic} else controllers
    topics = controllers or [topic for topic in states if topic != command_topic]
    if len(topics) != 1:
        what = "several topics hold" if topics else "no topic holds"
        raise InvalidFile(
            path,
            f"{what} actual angles; topics: {_listed(kinds, topics)}; "
            + ("choose one with --topic" if topics else f"expected {' or '.join(ACTUAL_TYPES)}"),
        )
    return topics[0]


def _requested(path: Path, kinds: Mapping[str, str], actual: str, joint: str | None) -> str:
    topics = [topic for topic, kind in kinds.items() if kind in REQUEST_TYPES and topic != actual]
    if len(topics) > 1 and joint not in (None, ALL_JOINTS):
        topics = [topic for topic in topics if joint in topic] or topics
    if len(topics) != 1:
        what = "several topics may hold" if topics else "no topic holds"
        raise InvalidFile(
            path,
            f"{what} the requested angles; topics: {_listed(kinds, topics)}; "
            + (
                "choose one with --command-topic"
                if topics
                else "record the topic of the commands too, or a controller's state"
            ),
        )
    return topics[0]


def _check(
    path: Path, kinds: Mapping[str, str], topic: str, expected: tuple[str, ...], option: str
) -> None:
    if topic not in kinds:
        raise InvalidFile(
            path,
            f"{option}: no topic '{topic}'{nearest(topic, list(kinds))}; topics: {_listed(kinds)}",
        )
    if kinds[topic] not in expected:
        raise InvalidFile(
            path,
            f"{option}: topic {topic} holds {kinds[topic]}, expected one of {', '.join(expected)}",
        )


def _listed(kinds: Mapping[str, str], topics: list[str] | None = None) -> str:
    names = sorted(topics or kinds)
    return ", ".join(f"{name} ({kinds[name]})" for name in names[:20]) or "none"


def requested_angles(kind: str, content: Any) -> MessageAngles:
    """The requested angles of a message; none where it holds none, such as an empty trajectory."""
    if kind == CONTROLLER_STATE:
        return _controller(content)[0]
    if kind == JOINT_STATE:
        return _angles_of(content, content.name, content.position, "position")
    if kind == TRAJECTORY:
        if not content.points:
            return _angles_of(content, (), (), "points")
        return _angles_of(content, content.joint_names, content.points[0].positions, "points")
    angles = content.data if kind == NUMBERS else (content.data,)
    return MessageAngles(0, None, tuple(map(float, angles)), "data")


def actual_angles(kind: str, content: Any) -> MessageAngles:
    """The actual angles of a message; none where a state has speeds only."""
    if kind == CONTROLLER_STATE:
        return _controller(content)[1]
    names = content.name if len(content.position) else ()
    return _angles_of(content, names, content.position, "position")


def _controller(content: Any) -> tuple[MessageAngles, MessageAngles]:
    """Requested and actual angles of a controller's state, by the names that its layout has."""
    pairs = (("reference", "feedback"), ("desired", "actual"))
    layouts = [pair for pair in pairs if all(hasattr(content, name) for name in pair)]
    filled = [pair for pair in layouts if len(getattr(content, pair[1]).positions)]
    requested, actual = (
        _angles_of(content, content.joint_names, getattr(content, name).positions, name)
        for name in (filled or layouts)[0]
    )
    return requested, actual


def _angles_of(content: Any, joints: Any, angles: Any, field: str) -> MessageAngles:
    stamp = content.header.stamp
    nanoseconds = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    return MessageAngles(
        nanoseconds if 0 < nanoseconds < LATEST else 0,
        tuple(map(str, joints)),
        tuple(map(float, angles)),
        field,
    )
