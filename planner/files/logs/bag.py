"""Logs from ROS bags and MCAP files: controllers' states, or joint states and commands.

They are read by rosbags' own readers, one topic at a time, and a damaged file is one error. Its
``AnyReader`` is not used: it refuses a bag for an unreadable definition of a type on any topic, or
one with another hash.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from planner.arrays import Array, Indices
from planner.exceptions import InvalidFile, PlannerError, importing, nearest
from planner.files.columns import scale
from planner.files.logs.rows import ALL_JOINTS, LogOptions, Recorded, Rows
from planner.files.table import Source

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
NUMBER, NUMBERS = "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray"
ACTUAL_TYPES = (CONTROLLER_STATE, JOINT_STATE)  # types with actual angles
REQUEST_TYPES = (CONTROLLER_STATE, TRAJECTORY, NUMBERS, NUMBER, JOINT_STATE)  # with requested ones

APART = 1_000_000_000  # stamps further from the receipt than this [ns] come from another clock

# A controller's state in Humble, whose bags do not define their types.
STATE_IN_HUMBLE = "std_msgs/Header header\nstring[] joint_names\nstring[] multi_dof_joint_names\n"
STATE_IN_HUMBLE += "".join(
    f"trajectory_msgs/{kind}Point {prefix}{name}\n"
    for kind, prefix in (("JointTrajectory", ""), ("MultiDOFJointTrajectory", "multi_dof_"))
    for name in ("reference", "feedback", "error", "output", "desired", "actual")
)


def read_bag(path: Path | str, options: LogOptions) -> Iterator[Recorded]:
    """Read a bag; the times of its joints have one origin."""
    with _opened(path) as (kinds, messages):
        topics = _choose_topics(path, kinds, options)
        notes = [f"actual from {topics[0]}, requested from {topics[1]}"]
        tracks = {"actual": Track(), "requested": Track()}
        for topic in dict.fromkeys(topics):  # one may hold both
            roles = [role for role, own in zip(tracks, topics, strict=True) if own == topic]
            content = messages(topic)
            notes += _gather(path, topic, kinds[topic], content, tracks, roles, options.joint)
    actual, requested = tracks.values()
    joints = tuple(name for name in actual if name in requested)
    if not joints:
        there = [", ".join([*track][:20]) or "none" for track in tracks.values()]
        found = f"{topics[0]} has {there[0]}, {topics[1]} has {there[1]}"
        raise InvalidFile(path, f"no joint is on both topics: {found}")
    stamped = _stamped(actual, requested)
    one, other = ("its header" if each else "receipt" for each in stamped)
    both = f"time of the actual angles from {one}, of the requested ones from {other}"
    notes.append(f"time from {one}" if one == other else both)
    # joints whose requests begin later keep their time
    read = [options.joint] if options.joint in joints else joints
    states = {joint: _states(actual[joint], requested[joint], stamped) for joint in read}
    origin = min((int(stamps[0]) for stamps, *_ in states.values() if len(stamps)), default=0)

    def rows_of(joint: str) -> Rows:
        stamps, angles, requests, repeated, early = states[joint]
        source = Source(path=path, part=f"joint {joint}" if joint else "", row="state")
        if not len(stamps):
            problem = f"no request before the last state: {len(requested[joint][0])} requests on"
            expected = "expected the same clock and time in both topics"
            raise InvalidFile(source.name, f"{problem} topic {topics[1]}; {expected}")
        unit = options.unit_of(joint)
        own = scale(unit or "rad", options.ticks_per_turn, partial(InvalidFile, path))
        said = "--unit said" if unit else "is the custom of ROS (REP 103)"
        return Rows(
            source=source,
            joint=joint,
            times=1e-9 * (stamps - origin).astype(np.float64),
            requests=requests,
            angles=angles,
            scales=(own, own),
            notes=(
                *notes,
                *[f"{repeated} repeated states left out"] * (repeated > 0),
                *[f"{early} states before the first request left out"] * (early > 0),
                f"angles in {own.name}, as {said}",
            ),
        )

    yield {joint: partial(rows_of, joint) for joint in joints}


# Receipt [ns], stamp [ns], 0 for none, and angle, of every message about a joint; and those of
# the joints on one topic, in the order in which they appeared.
Series = tuple["array[int]", "array[int]", "array[float]"]
Track = dict[str, Series]


def _stamped(*tracks: Track) -> list[bool]:
    """Whether the times of a track are the stamps, else the receipt.

    The receipt counts where a message has no stamp, or where the stamps come from another clock
    than the recorder's (simulated time, another computer), unless those of all tracks do.
    """
    stamped = [all(min(stamps) > 0 for _, stamps, _ in track.values()) for track in tracks]
    leads = [  # how far stamps are ahead of the receipt, in the median of many messages
        np.median(np.concatenate([np.subtract(b[:1000], a[:1000]) for a, b, _ in track.values()]))
        for track in tracks
    ]
    if all(stamped) and abs(leads[0] - leads[1]) <= APART:
        return stamped
    return [each and abs(lead) <= APART for each, lead in zip(stamped, leads, strict=True)]


def _states(
    actual: Series, requested: Series, stamped: Sequence[bool]
) -> tuple[Indices, Array, Array, int, int]:
    """Times [ns] of states, angles, requests in force, (n,); how many repeated, or came early."""
    ordered = []
    for (received, own, values), by_stamp in zip((actual, requested), stamped, strict=True):
        times = np.array(own if by_stamp else received, dtype=np.int64)
        order = np.argsort(times, kind="stable")
        ordered += [times[order], np.array(values)[order]]
    stamps, angles, sent, requests = ordered
    fresh = np.ones(len(stamps), dtype=bool)
    fresh[1:] = (np.diff(stamps) != 0) | (angles[1:] != angles[:-1])
    last = np.searchsorted(sent, stamps, side="right") - 1
    begun = fresh & (last >= 0)
    repeated, early = int(np.sum(~fresh)), int(np.sum(fresh & ~begun))
    return stamps[begun], angles[begun], requests[last[begun]], repeated, early


def _gather(
    path: Path | str,
    topic: str,
    kind: str,
    messages: Iterable[tuple[int, Any]],
    tracks: Mapping[str, Track],
    roles: Sequence[str],
    joint: str | None,
) -> tuple[str, ...]:
    """Add messages to tracks, by role; numbers without names are of the actual joints, or one."""
    names, notes = tuple(tracks["actual"]), tuple[str, ...]()
    for k, (received, content) in enumerate(messages):
        place = f"topic {topic}, message {k + 1}"
        for role in roles:
            track = tracks[role]
            try:
                joints, angles, field = _angles_in(content, kind, role)
                values, stamp = tuple(map(float, angles)), 0
                if hasattr(content, "header"):
                    own = content.header.stamp
                    stamp = max(0, int(own.sec) * 1_000_000_000 + int(own.nanosec))
            except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
                raise InvalidFile(  # the bag's definition of the type may be anything
                    path,
                    f"{place}: fields are not those of {kind} ({error}); is the bag damaged?",
                ) from error
            if joints is None:
                one = len(values) == 1 and joint in names
                joints = (str(joint),) if one and len(names) > 1 else names
                if len(joints) != len(values):
                    advice = "choose a topic with names by --command-topic"
                    advice = "choose the joint with --joint" if len(values) == 1 else advice
                    each = f"a number for each of {len(names)} joints ({', '.join(names)})"
                    got = f"topic {topic}: got {len(values)} without names"
                    raise InvalidFile(path, f"{got}, expected {each}; {advice}")
                notes = (f"numbers of {topic} taken for {', '.join(joints)}",)
            if len(joints) != len(values) or len(set(joints)) != len(joints):
                each = f"an angle for each of {len(joints)} joints ({', '.join(joints[:20])})"
                raise InvalidFile(path, f"{place}: got {len(values)} in '{field}', expected {each}")
            for name, value in zip(joints, values, strict=True):
                series = track.setdefault(name, (array("q"), array("q"), array("d")))
                series[0].append(received)
                series[1].append(stamp)
                series[2].append(value)
    return notes


def _angles_in(content: Any, kind: str, role: str) -> tuple[tuple[str, ...] | None, Any, str]:
    """Joints, None without names, their angles in a message, if any, and the field of these."""
    if kind in (NUMBERS, NUMBER):
        return None, content.data if kind == NUMBERS else (content.data,), "data"
    if kind == JOINT_STATE:
        joints, angles, field = content.name, content.position, "position"
        if role == "actual" and not len(angles):
            joints = ()
    elif kind == TRAJECTORY:
        points, field = content.points[:1], "points"
        joints, angles = (content.joint_names, points[0].positions) if points else ((), ())
    else:  # a controller's state, by the names that its layout has
        layouts = [("reference", "feedback"), ("desired", "actual")]
        layouts = [pair for pair in layouts if all(hasattr(content, name) for name in pair)]
        filled = [pair for pair in layouts if len(getattr(content, pair[1]).positions)]
        field = (filled or layouts)[0][role == "actual"]
        joints, angles = content.joint_names, getattr(content, field).positions
    return tuple(map(str, joints)), angles, field


def _choose_topics(
    path: Path | str, kinds: Mapping[str, str], options: LogOptions
) -> tuple[str, str]:
    """The topics of actual and of requested angles: named, or the only ones of their types."""

    def listed(topics: Iterable[str]) -> str:
        return ", ".join(f"{name} ({kinds[name]})" for name in sorted(topics)[:20]) or "none"

    def chosen(
        role: str, named: str | None, types: Sequence[str], topics: Sequence[str], advice: str
    ) -> str:
        option = "--topic" if role == "actual" else "--command-topic"
        if named is None:
            if len(topics) == 1:
                return topics[0]
            count, advice = ("several", f"choose one with {option}") if topics else ("no", advice)
            those = f"topic{'s' * (len(topics) > 1)} with {role} angles"
            problem = f"{count} {those}; topics: {listed(topics or kinds)}; {advice}"
        elif named not in kinds:
            hint = nearest(named, list(kinds))
            problem = f"{option}: no topic '{named}'{hint}; topics: {listed(kinds)}"
        elif kinds[named] not in types:
            expected = f"expected one of {', '.join(types)}"
            problem = f"{option}: topic {named} holds {kinds[named]}, {expected}"
        else:
            return named
        raise InvalidFile(path, problem)

    command = options.command_topic
    states = [name for name, kind in kinds.items() if kind == JOINT_STATE and name != command]
    controllers = [name for name, kind in kinds.items() if kind == CONTROLLER_STATE]
    if command is not None and kinds.get(command) != CONTROLLER_STATE and states:
        controllers = []
    advice = f"expected {' or '.join(ACTUAL_TYPES)}"
    actual = chosen("actual", options.topic, ACTUAL_TYPES, controllers or states, advice)
    topics = [name for name, kind in kinds.items() if kind in REQUEST_TYPES and name != actual]
    if kinds[actual] == CONTROLLER_STATE:
        topics = [actual]
    elif len(topics) > 1 and options.joint not in (None, ALL_JOINTS):
        topics = [topic for topic in topics if options.joint in topic] or topics
    advice = "record the topic of the commands too, or a controller's state"
    requested = chosen("requested", command, REQUEST_TYPES, topics, advice)
    if requested == actual and kinds[actual] != CONTROLLER_STATE:
        expected = "another topic for the requested angles; name it with --command-topic"
        words = f"topic {actual} holds one angle of each joint, expected {expected}"
        raise InvalidFile(path, words)
    return actual, requested


# The file.


# By topic, the messages in order of receipt: the time of it [ns], and the fields.
Messages = Callable[[str], Iterator[tuple[int, Any]]]


@contextmanager
def _opened(path: Path | str) -> Iterator[tuple[dict[str, str], Messages]]:
    """Open a bag of ROS 1, of ROS 2 (folder or a single file of it), or an MCAP file.

    In the block stand the type of every topic, and its messages.
    """
    with importing("reading bags", "bags"):
        from rosbags import rosbag1, rosbag2
    place = Path(path)
    ros1 = place.suffix.lower() == ".bag"
    try:
        of_format: Any = (rosbag1 if ros1 else rosbag2).Reader
        with of_format(place) as reader:
            topics = {connection.topic: connection.msgtype for connection in reader.connections}
            yield topics, partial(_messages, path, reader, "ros1" if ros1 else "cdr")
    except PlannerError:
        raise
    except Exception as error:  # of rosbags, SQLite, YAML or a decoder
        words = f"not a bag that can be read ({_words(error)}); is it cut short?"
        raise InvalidFile(path, words) from error


def _messages(
    path: Path | str, reader: Any, form: Literal["ros1", "cdr"], topic: str
) -> Iterator[tuple[int, Any]]:
    connections = [each for each in reader.connections if each.topic == topic]
    kind, deserialize = connections[0].msgtype, getattr(_store(connections), f"deserialize_{form}")
    for k, (_, when, data) in enumerate(reader.messages(connections=connections)):
        try:
            yield when, deserialize(data, kind)
        except Exception as error:
            words = f"message {k + 1}: no {kind} ({_words(error)}); is the bag damaged?"
            raise InvalidFile(path, f"topic {topic}, {words}") from error


def _store(connections: Sequence[Connection]) -> Typestore:
    """The bag's own types, or the default ones."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    own: dict[str, Any] = {}
    for connection in connections:  # those in IDL are not needed: the default ones are alike
        if connection.msgdef.format == MessageDefinitionFormat.MSG:
            own.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
    store = get_typestore(Stores.EMPTY if own else Stores.LATEST)
    store.register(own or get_types_from_msg(STATE_IN_HUMBLE, CONTROLLER_STATE))
    return store


def _words(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
