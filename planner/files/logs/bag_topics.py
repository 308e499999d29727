"""Which of a bag's topics tell the actual and the requested angles."""

from __future__ import annotations

from typing import NamedTuple

from planner.exceptions import InvalidFile
from planner.files.logs.bag_file import Bag
from planner.files.logs.controller_state import CONTROLLER_STATE
from planner.files.logs.options import ALL_JOINTS, LogOptions
from planner.files.logs.ros_messages import ACTUAL_TYPES, JOINT_STATE, REQUEST_TYPES
from planner.files.table import nearest


class Topics(NamedTuple):
    """Where a bag tells what.

    Attributes:
        actual: Topic of the actual angles.
        requested: Topic of the requested angles; the same where it tells both.
    """

    actual: str
    requested: str


def choose_topics(bag: Bag, options: LogOptions) -> Topics:
    """The topics that the options name, or the only ones that their types allow.

    Raises:
        InvalidFile: No topic, or several, could be meant; the message lists them.
    """
    wanted = options.command_topic
    if wanted is not None:
        _check(bag, wanted, REQUEST_TYPES, "--command-topic")
    actual = options.topic
    if actual is not None:
        _check(bag, actual, ACTUAL_TYPES, "--topic")
    else:
        actual = _actual(bag, wanted)
    if wanted is None:
        own = bag.topics[actual] == CONTROLLER_STATE
        wanted = actual if own else _requested(bag, actual, options.joint)
    if wanted == actual and bag.topics[actual] != CONTROLLER_STATE:
        raise InvalidFile(
            bag.path,
            f"topic {actual} tells one angle of each joint, expected another topic for the "
            "requested angles; name it with --command-topic",
        )
    return Topics(actual, wanted)


def _actual(bag: Bag, command_topic: str | None) -> str:
    states = [topic for topic, kind in bag.topics.items() if kind == JOINT_STATE]
    controllers = [topic for topic, kind in bag.topics.items() if kind == CONTROLLER_STATE]
    if command_topic is not None and bag.topics[command_topic] != CONTROLLER_STATE:
        controllers = [] if set(states) - {command_topic} else controllers
    found = controllers or [topic for topic in states if topic != command_topic]
    if len(found) != 1:
        what = "several topics tell" if found else "no topic tells"
        raise InvalidFile(
            bag.path,
            f"{what} actual angles; topics: {_listed(bag, found)}; "
            + ("choose one with --topic" if found else f"expected {' or '.join(ACTUAL_TYPES)}"),
        )
    return found[0]


def _requested(bag: Bag, actual: str, joint: str | None) -> str:
    found = [
        topic for topic, kind in bag.topics.items() if kind in REQUEST_TYPES and topic != actual
    ]
    if len(found) > 1 and joint not in (None, ALL_JOINTS):
        found = [topic for topic in found if joint in topic] or found
    if len(found) != 1:
        what = "several topics may tell" if found else "no topic tells"
        raise InvalidFile(
            bag.path,
            f"{what} the requested angles; topics: {_listed(bag, found)}; "
            + (
                "choose one with --command-topic"
                if found
                else "record the topic of the commands too, or a controller's state"
            ),
        )
    return found[0]


def _check(bag: Bag, topic: str, kinds: tuple[str, ...], option: str) -> None:
    if topic not in bag.topics:
        raise InvalidFile(
            bag.path,
            f"{option}: no topic '{topic}'{nearest(topic, list(bag.topics))}; topics: "
            f"{_listed(bag)}",
        )
    if bag.topics[topic] not in kinds:
        raise InvalidFile(
            bag.path,
            f"{option}: topic {topic} holds {bag.topics[topic]}, expected one of "
            f"{', '.join(kinds)}",
        )


def _listed(bag: Bag, topics: list[str] | None = None) -> str:
    names = sorted(topics or bag.topics)
    return ", ".join(f"{name} ({bag.topics[name]})" for name in names[:20]) or "none"
