"""What the topics of a bag tell of its joints, and by which clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from planner.exceptions import InvalidFile
from planner.files.logs.bag_file import Bag
from planner.files.logs.bag_topics import JOINT_STATE, NUMBERS, TRAJECTORY, Topics
from planner.files.logs.controller_state import CONTROLLER_STATE
from planner.files.logs.options import ALL_JOINTS
from planner.files.logs.series import Series, Track

APART = 1_000_000_000
"""Stamps that are further from the receipt than this [ns] come from another clock."""


@dataclass(frozen=True)
class Recording:
    """What a bag tells of its joints.

    Attributes:
        topics: Where it tells it.
        notes: What was guessed, in words.
    """

    topics: Topics
    notes: tuple[str, ...]
    _actual: Track
    _requested: Track
    _stamped: tuple[bool, bool]

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints of which both angles are known."""
        return tuple(name for name in self._actual.joints if name in self._requested.joints)

    def of(self, joint: str) -> tuple[Series, Series]:
        """A joint's actual and its requested angles."""
        return (
            self._actual.series(joint, stamped=self._stamped[0]),
            self._requested.series(joint, stamped=self._stamped[1]),
        )


def read_recording(bag: Bag, topics: Topics, joint: str | None) -> Recording:
    """Read the messages of the topics.

    Args:
        bag: The bag.
        topics: The topics.
        joint: The joint that commands without a name are for, if the user chose one.

    Raises:
        InvalidFile: A message cannot be understood, or no joint is in both topics.
    """
    chosen = None if joint in (None, ALL_JOINTS) else joint
    actual, requested = Track(topics.actual), Track(topics.requested)
    notes = [f"actual from {topics.actual}, requested from {topics.requested}"]
    _read_actual(bag, actual, requested if topics.actual == topics.requested else None)
    if topics.actual != topics.requested:
        notes += _read_requested(bag, requested, actual.joints, chosen)
    if not set(actual.joints) & set(requested.joints):
        raise InvalidFile(
            bag.path,
            f"no joint is on both topics: {topics.actual} has {_listed(actual)}, "
            f"{topics.requested} has {_listed(requested)}",
        )
    stamped = _clocks(actual, requested)
    words = ["its header" if own else "receipt" for own in stamped]
    notes.append(
        f"time from {words[0]}"
        if words[0] == words[1]
        else f"time of the actual angles from {words[0]}, of the requested ones from {words[1]}"
    )
    return Recording(topics, tuple(notes), actual, requested, stamped)


def _clocks(actual: Track, requested: Track) -> tuple[bool, bool]:
    """Whether to take either topic's stamps.

    Not where a message has none. And not where they are of another clock than the recorder's
    (simulated time, another computer), unless those of both topics are.
    """
    stamped = (actual.stamped, requested.stamped)
    if all(stamped) and abs(actual.lead() - requested.lead()) <= APART:
        return stamped
    return (
        stamped[0] and abs(actual.lead()) <= APART,
        stamped[1] and abs(requested.lead()) <= APART,
    )


def _read_actual(bag: Bag, actual: Track, requested: Track | None) -> None:
    """Gather actual angles, and the requested ones where a controller's state tells both."""
    kind = bag.topics[actual.topic]
    for k, (received, content) in enumerate(bag.messages(actual.topic)):
        stamp = _stamp(content)
        if kind == JOINT_STATE:
            if len(content.position):  # a state may tell of speeds only
                _check(bag, actual.topic, k, "position", content.name, content.position)
                actual.add(received, stamp, content.name, content.position)
            continue
        for track, (name, angles) in zip((requested, actual), _controller(content), strict=True):
            if track is not None:
                _check(bag, actual.topic, k, name, content.joint_names, angles)
                track.add(received, stamp, content.joint_names, angles)


def _read_requested(
    bag: Bag, requested: Track, names: tuple[str, ...], joint: str | None
) -> tuple[str, ...]:
    """Gather the requested angles of a topic of commands; what was guessed, in words."""
    topic, kind = requested.topic, bag.topics[requested.topic]
    notes: tuple[str, ...] = ()
    for k, (received, content) in enumerate(bag.messages(topic)):
        stamp = _stamp(content) if kind in (JOINT_STATE, TRAJECTORY, CONTROLLER_STATE) else 0
        if kind == CONTROLLER_STATE:
            who, angles = content.joint_names, _controller(content)[0][1]
        elif kind == JOINT_STATE:
            who, angles = content.name, content.position
        elif kind == TRAJECTORY:
            if not content.points:
                continue
            who, angles = content.joint_names, content.points[0].positions
        elif kind == NUMBERS:
            angles = content.data
            who = _order(bag, topic, names, joint, len(angles))
            notes = (f"numbers of {topic} taken for {', '.join(who)}",)
        else:
            angles = [content.data]
            who = _order(bag, topic, names, joint, 1)
            notes = (f"the number of {topic} taken for {who[0]}",)
        _check(bag, topic, k, kind, who, angles)
        requested.add(received, stamp, who, angles)
    return notes


def _order(
    bag: Bag, topic: str, names: tuple[str, ...], joint: str | None, count: int
) -> tuple[str, ...]:
    """Whom commands without names are for: all joints in their order, or the chosen one."""
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


def _controller(content: Any) -> tuple[tuple[str, Any], tuple[str, Any]]:
    """Requested and actual angles of a controller's state, each after the field's name."""
    pairs = (("reference", "feedback"), ("desired", "actual"))
    known = [pair for pair in pairs if all(hasattr(content, name) for name in pair)]
    filled = [pair for pair in known if len(getattr(content, pair[1]).positions)]
    requested, actual = (filled or known)[0]
    return (
        (requested, getattr(content, requested).positions),
        (actual, getattr(content, actual).positions),
    )


def _stamp(content: Any) -> int:
    """The stamp of a message's header [ns]."""
    stamp = content.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _check(bag: Bag, topic: str, k: int, what: str, names: Any, angles: Any) -> None:
    if len(names) != len(angles) or len(set(names)) != len(names):
        raise InvalidFile(
            bag.path,
            f"topic {topic}, message {k + 1}: got {len(angles)} in '{what}', expected an angle for "
            f"each of {len(names)} joints ({', '.join(map(str, names[:20]))})",
        )


def _listed(track: Track) -> str:
    return ", ".join(track.joints[:20]) or "none"
