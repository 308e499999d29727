"""Logs from bags: a controller's state, or joint states with the commands before them."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidFile, InvalidInput, nearest
from planner.files.columns import scale
from planner.files.logs.bag_file import CONTROLLER_STATE, LATEST, Bag, open_bag
from planner.files.logs.make_log import (
    ALL_JOINTS,
    Columns,
    LogOptions,
    Source,
    choose_joints,
    make_log,
)
from planner.identification.log import Log
from planner.trajectory import Array

Stamps = npt.NDArray[np.int64]
"""Times [ns], shape (n,)."""

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
NUMBERS = "std_msgs/msg/Float64MultiArray"
ACTUAL_TYPES = (CONTROLLER_STATE, JOINT_STATE)
"""Types with actual angles."""

REQUEST_TYPES = (CONTROLLER_STATE, TRAJECTORY, NUMBERS, "std_msgs/msg/Float64", JOINT_STATE)
"""Types with requested angles."""

APART = 1_000_000_000
"""Stamps that are further from the receipt than this [ns] come from another clock."""

MOST_COMPARED = 1000
"""Messages of which the stamps are compared with the receipt."""


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return (path / "metadata.yaml").is_file()


def read_bag(path: Path | str, options: LogOptions) -> tuple[Log, ...]:
    """Read the chosen joints of a bag."""
    actual, requested, notes = _tracks(path, options)
    names = _on_both(actual, requested)
    chosen = choose_joints(path, names, options.joint)
    logs = [_log(path, actual, requested, names[k], options, notes) for k in chosen]
    origin = min(first for first, _ in logs)  # joints whose requests begin later keep their time
    return tuple(
        replace(log, times=log.times + (first - origin) * 1e-9) if first > origin else log
        for first, log in logs
    )


def bag_joints(path: Path | str, options: LogOptions) -> tuple[str, ...]:
    """Names of the joints of which a bag holds requested and actual angles."""
    return _on_both(*_tracks(path, options)[:2])


def _on_both(actual: Track, requested: Track) -> tuple[str, ...]:
    """The joints of which both angles are known."""
    return tuple(name for name in actual.joints if name in requested.joints)


def _log(
    path: Path | str,
    actual: Track,
    requested: Track,
    joint: str,
    options: LogOptions,
    notes: Sequence[str],
) -> tuple[int, Log]:
    """Stamp of the first row [ns], and the log with times since then."""
    stamps, angles = actual.series(joint)
    sent, requests = requested.series(joint)
    fresh = np.ones(len(stamps), dtype=bool)  # repeated rows are kept once
    fresh[1:] = (np.diff(stamps) != 0) | (angles[1:] != angles[:-1])
    stamps, angles = stamps[fresh], angles[fresh]
    last = np.searchsorted(sent, stamps, side="right") - 1  # request that holds at each stamp
    begun = last >= 0
    source = Source(path=path, part=f"joint {joint}" if joint else "", row="state")
    if not begun.any():
        raise InvalidFile(
            source.name,
            f"no request before the last state: {len(sent)} requests on topic "
            f"{requested.topic}; expected the same clock and time in both topics",
        )
    stamps, angles, requests = stamps[begun], angles[begun], requests[last[begun]]
    try:
        angle_scale = options.scale_of(joint) or scale("rad", None)
    except InvalidInput as error:
        raise InvalidFile(path, str(error)) from error
    columns = Columns(
        times=(stamps - stamps[0]) * 1e-9,
        requests=requests,
        angles=angles,
        request_scale=angle_scale,
        angle_scale=angle_scale,
    )
    repeated, before = int((~fresh).sum()), int((~begun).sum())
    said = "--unit said" if options.unit_of(joint) else "is the custom of ROS (REP 103)"
    notes = (
        *notes,
        *[f"{repeated} repeated states left out"] * (repeated > 0),
        *[f"{before} states before the first request left out"] * (before > 0),
        f"angles in {angle_scale.name}, as {said}",
    )
    return int(stamps[0]), make_log(source, columns, joint=joint, notes=notes)


@dataclass
class Track:
    """The angles of the joints on one topic, as they are gathered.

    Of every message about a joint there are the receipt [ns], the stamp [ns] and the angle.
    """

    topic: str

    # whether every message had a stamp; at the end, whether its times are the stamps
    stamped: bool = True
    _by_joint: dict[str, tuple[array[int], array[int], array[float]]] = field(default_factory=dict)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints, in the order in which they appeared."""
        return tuple(self._by_joint)

    def add(
        self, received: int, stamp: int, joints: Sequence[str], angles: Iterable[float]
    ) -> None:
        """Add a message that was received and stamped [ns]; 0 is no stamp."""
        self.stamped = self.stamped and stamp > 0
        for joint, angle in zip(joints, angles, strict=True):
            rows = self._by_joint.setdefault(joint, (array("q"), array("q"), array("d")))
            rows[0].append(received)
            rows[1].append(stamp)
            rows[2].append(angle)

    def lead(self) -> float:
        """How far the stamps are ahead of the receipt [ns], in the median."""
        leads = [
            own - receipt
            for received, stamps, _ in self._by_joint.values()
            for receipt, own in zip(received[:MOST_COMPARED], stamps[:MOST_COMPARED], strict=True)
        ]
        return float(np.median(leads)) if leads else 0.0

    def series(self, joint: str) -> tuple[Stamps, Array]:
        """Times [ns] and angles of a joint, by the stamps or by the receipt, in order of time."""
        received, own, values = self._by_joint[joint]
        stamps = np.array(own if self.stamped else received, dtype=np.int64)
        order = np.argsort(stamps, kind="stable")
        return stamps[order], np.array(values)[order]


def _tracks(path: Path | str, options: LogOptions) -> tuple[Track, Track, list[str]]:
    """Actual and requested angles on the topics that the options name, or the only ones; notes."""
    with open_bag(path) as bag:
        actual, requested = map(Track, choose_topics(bag.path, bag.topics, options))
        notes = [f"actual from {actual.topic}, requested from {requested.topic}"]
        if actual.topic == requested.topic:
            _gather(bag, {requested_angles: requested, actual_angles: actual})
        else:
            _gather(bag, {actual_angles: actual})
            notes += _gather(bag, {requested_angles: requested}, actual.joints, options.joint)
    if not _on_both(actual, requested):
        raise InvalidFile(
            bag.path,
            f"no joint is on both topics: {actual.topic} has "
            f"{', '.join(actual.joints[:20]) or 'none'}, {requested.topic} has "
            f"{', '.join(requested.joints[:20]) or 'none'}",
        )
    actual.stamped, requested.stamped = _clocks(actual, requested)
    words = ["its header" if each.stamped else "receipt" for each in (actual, requested)]
    notes.append(
        f"time from {words[0]}"
        if words[0] == words[1]
        else f"time of the actual angles from {words[0]}, of the requested ones from {words[1]}"
    )
    return actual, requested, notes


def _clocks(actual: Track, requested: Track) -> tuple[bool, bool]:
    """Whether to take either topic's stamps.

    Not where a message has no stamp, nor where the stamps come from another clock than the
    recorder's (simulated time, another computer), unless both topics' stamps do.
    """
    stamped = (actual.stamped, requested.stamped)
    if all(stamped) and abs(actual.lead() - requested.lead()) <= APART:
        return stamped
    return (
        stamped[0] and abs(actual.lead()) <= APART,
        stamped[1] and abs(requested.lead()) <= APART,
    )


def _gather(
    bag: Bag,
    tracks: Mapping[Callable[[str, Any], MessageAngles], Track],
    names: tuple[str, ...] = (),
    joint: str | None = None,
) -> tuple[str, ...]:
    """Gather the angles in the messages of one topic, and return guesses, in words.

    Angles without names are of ``names``, in order, or a single one of the ``joint`` chosen.
    """
    (topic,) = {track.topic for track in tracks.values()}
    kind = bag.topics[topic]
    notes: tuple[str, ...] = ()
    for k, (received, content) in enumerate(bag.messages(topic)):
        place = f"topic {topic}, message {k + 1}"
        for extract, track in tracks.items():
            try:
                message = extract(kind, content)
            except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
                raise InvalidFile(  # the bag's definition of the type may be anything
                    bag.path,
                    f"{place}: fields are not those of {kind} ({error}); is the bag damaged?",
                ) from error
            joints = message.joints
            if joints is None:
                joints = _order(bag, topic, names, joint, len(message.angles))
                notes = (f"numbers of {topic} taken for {', '.join(joints)}",)
            if len(joints) != len(message.angles) or len(set(joints)) != len(joints):
                raise InvalidFile(
                    bag.path,
                    f"{place}: got {len(message.angles)} in '{message.field}', expected an angle "
                    f"for each of {len(joints)} joints ({', '.join(joints[:20])})",
                )
            if joints:
                track.add(received, message.stamp, joints, message.angles)
    return notes


def _order(
    bag: Bag, topic: str, names: tuple[str, ...], joint: str | None, count: int
) -> tuple[str, ...]:
    """The joints of commands without names: all in their order, or the chosen one."""
    if count == len(names):
        return names
    if count == 1 and joint in names:
        return (joint,)
    raise InvalidFile(
        bag.path,
        f"topic {topic}: got {count} without names, expected a number for each of {len(names)} "
        f"joints ({', '.join(names)}); "
        + (
            "choose the joint with --joint"
            if count == 1
            else "choose a topic with names by --command-topic"
        ),
    )


class MessageAngles(NamedTuple):
    """The angles of joints in one field of a message; joints without names are None.

    The stamp of its header [ns] is 0 where it has none.
    """

    stamp: int
    joints: tuple[str, ...] | None
    angles: tuple[float, ...]
    field: str


def choose_topics(path: Path, kinds: Mapping[str, str], options: LogOptions) -> tuple[str, str]:
    """The topics of actual and of requested angles, which may be the same one.

    They are those that the options name, or the only ones that their types allow.
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
    expected = f"expected {' or '.join(ACTUAL_TYPES)}"
    return _only(path, kinds, topics, ("hold", "actual angles", "--topic"), expected)


def _only(
    path: Path, kinds: Mapping[str, str], topics: list[str], words: tuple[str, ...], advice: str
) -> str:
    """The only one of these topics."""
    if len(topics) == 1:
        return topics[0]
    verb, what, option = words
    many = f"several topics {verb}" if topics else "no topic holds"
    raise InvalidFile(
        path,
        f"{many} {what}; topics: {_listed(kinds, topics)}; "
        + (f"choose one with {option}" if topics else advice),
    )


def _requested(path: Path, kinds: Mapping[str, str], actual: str, joint: str | None) -> str:
    topics = [topic for topic, kind in kinds.items() if kind in REQUEST_TYPES and topic != actual]
    if len(topics) > 1 and joint not in (None, ALL_JOINTS):
        topics = [topic for topic in topics if joint in topic] or topics
    words = ("may hold", "the requested angles", "--command-topic")
    advice = "record the topic of the commands too, or a controller's state"
    return _only(path, kinds, topics, words, advice)


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
