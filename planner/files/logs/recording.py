"""What the topics of a bag tell of its joints, and by which clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from planner.exceptions import InvalidFile
from planner.files.logs.bag_file import Bag
from planner.files.logs.bag_topics import Topics
from planner.files.logs.options import ALL_JOINTS
from planner.files.logs.ros_messages import Told, actual_angles, requested_angles
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
    if topics.actual == topics.requested:
        _read_both(bag, actual, requested)
    else:
        _read_actual(bag, actual)
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


def _read_both(bag: Bag, actual: Track, requested: Track) -> None:
    """Gather the angles of a topic that tells actual and requested ones."""
    kind = bag.topics[actual.topic]
    for k, (received, content) in enumerate(bag.messages(actual.topic)):
        for understand, track in ((requested_angles, requested), (actual_angles, actual)):
            told = _understood(bag, track.topic, k, understand, kind, content)
            _add(bag, track, k, received, told, told.joints or ())


def _read_actual(bag: Bag, actual: Track) -> None:
    """Gather the angles of a topic of states."""
    kind = bag.topics[actual.topic]
    for k, (received, content) in enumerate(bag.messages(actual.topic)):
        told = _understood(bag, actual.topic, k, actual_angles, kind, content)
        _add(bag, actual, k, received, told, told.joints or ())


def _read_requested(
    bag: Bag, requested: Track, names: tuple[str, ...], joint: str | None
) -> tuple[str, ...]:
    """Gather the angles of a topic of commands; what was guessed, in words."""
    topic, kind = requested.topic, bag.topics[requested.topic]
    notes: tuple[str, ...] = ()
    for k, (received, content) in enumerate(bag.messages(topic)):
        told = _understood(bag, topic, k, requested_angles, kind, content)
        joints = told.joints
        if joints is None:
            joints = _order(bag, topic, names, joint, len(told.angles))
            notes = (f"numbers of {topic} taken for {', '.join(joints)}",)
        _add(bag, requested, k, received, told, joints)
    return notes


def _understood(
    bag: Bag, topic: str, k: int, understand: Callable[[str, Any], Told], kind: str, content: Any
) -> Told:
    """What a message tells, by a definition of its type that may be anything."""
    try:
        return understand(kind, content)
    except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise InvalidFile(
            bag.path,
            f"topic {topic}, message {k + 1}: fields are not those of {kind} ({error}); is the bag "
            "damaged?",
        ) from error


def _add(
    bag: Bag, track: Track, k: int, received: int, told: Told, joints: tuple[str, ...]
) -> None:
    if len(joints) != len(told.angles) or len(set(joints)) != len(joints):
        raise InvalidFile(
            bag.path,
            f"topic {track.topic}, message {k + 1}: got {len(told.angles)} in '{told.field}', "
            f"expected an angle for each of {len(joints)} joints ({', '.join(joints[:20])})",
        )
    if joints:
        track.add(received, told.stamp, joints, told.angles)


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


def _listed(track: Track) -> str:
    return ", ".join(track.joints[:20]) or "none"
