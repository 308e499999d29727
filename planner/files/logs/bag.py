"""Logs from bags: a controller's state, or joint states with the commands before them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidFile, nearest
from planner.files.columns import scale
from planner.files.logs.bag_file import CONTROLLER_STATE, LATEST, Bag, open_bag
from planner.files.logs.rows import ALL_JOINTS, LogOptions, Recorded, Rows
from planner.files.table import Source
from planner.trajectory import Array, Indices

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
NUMBER, NUMBERS = "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray"
ACTUAL_TYPES = (CONTROLLER_STATE, JOINT_STATE)  # types with actual angles
REQUEST_TYPES = (CONTROLLER_STATE, TRAJECTORY, NUMBERS, NUMBER, JOINT_STATE)
"""Types with requested angles."""

APART = 1_000_000_000
"""Stamps that are further from the receipt than this [ns] come from another clock."""


def read_bag(path: Path | str, options: LogOptions) -> Iterator[Recorded]:
    """Read a bag; the times of its joints have one origin."""
    with open_bag(path) as bag:
        topics = choose_topics(bag.path, bag.topics, options)
        notes = [f"actual from {topics[0]}, requested from {topics[1]}"]
        actual, requested = tracks = Track(), Track()
        if topics[0] == topics[1]:
            _gather(bag, topics[0], {"requested": requested, "actual": actual})
        else:
            _gather(bag, topics[0], {"actual": actual})
            notes += _gather(bag, topics[1], {"requested": requested}, actual, options.joint)
    joints = tuple(name for name in actual if name in requested)
    if not joints:
        there = [", ".join([*track][:20]) or "none" for track in tracks]
        raise InvalidFile(
            path,
            f"no joint is on both topics: {topics[0]} has {there[0]}, {topics[1]} has {there[1]}",
        )
    stamped = _stamped(actual, requested)
    words = ["its header" if each else "receipt" for each in stamped]
    alike = words[0] == words[1]
    also = "" if alike else f", of the requested ones from {words[1]}"
    notes.append(f"time{'' if alike else ' of the actual angles'} from {words[0]}{also}")
    # joints whose requests begin later keep their time
    read = [options.joint] if options.joint in joints else joints
    states = {joint: _states(actual[joint], requested[joint], stamped) for joint in read}
    origin = min((int(stamps[0]) for stamps, *_ in states.values() if len(stamps)), default=0)

    def rows_of(joint: str) -> Rows:
        stamps, angles, requests, repeated, early = states[joint]
        source = Source(path=path, part=f"joint {joint}" if joint else "", row="state")
        if not len(stamps):
            raise InvalidFile(
                source.name,
                f"no request before the last state: {len(requested[joint][0])} requests on "
                f"topic {topics[1]}; expected the same clock and time in both topics",
            )
        unit = options.unit_of(joint)
        own = scale(unit or "rad", options.ticks_per_turn, partial(InvalidFile, path))
        said = "--unit said" if unit else "is the custom of ROS (REP 103)"
        return Rows(
            source=source,
            joint=joint,
            times=1e-9 * (stamps - origin).astype(np.float64),
            requests=requests,
            angles=angles,
            request_scale=own,
            angle_scale=own,
            notes=(
                *notes,
                *[f"{repeated} repeated states left out"] * (repeated > 0),
                *[f"{early} states before the first request left out"] * (early > 0),
                f"angles in {own.name}, as {said}",
            ),
        )

    yield {joint: partial(rows_of, joint) for joint in joints}


Series = tuple["array[int]", "array[int]", "array[float]"]
"""Of every message about a joint: receipt [ns], stamp [ns], 0 for none, and angle."""

Track = dict[str, Series]
"""The messages on one topic by joint, in the order in which the joints appeared."""


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
    """Times [ns] of a joint's states, their angles and the requests that hold at each, (n,) each.

    Left out, and counted, are states that repeat the one before, and those before any request.
    """
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
    bag: Bag,
    topic: str,
    tracks: Mapping[str, Track],
    names: Iterable[str] = (),
    joint: str | None = None,
) -> tuple[str, ...]:
    """Add the messages on a topic to tracks, by role, and return guesses, in words.

    Angles without names are of ``names``, in order, or a single one of the ``joint`` chosen.
    """
    kind, names = bag.topics[topic], tuple(names)
    notes: tuple[str, ...] = ()
    for k, (received, content) in enumerate(bag.messages(topic)):
        place = f"topic {topic}, message {k + 1}"
        for role, track in tracks.items():
            try:
                joints, angles, field = _angles_in(content, kind, role)
                values, stamp = tuple(map(float, angles)), 0
                if hasattr(content, "header"):
                    own = content.header.stamp
                    stamp = int(own.sec) * 1_000_000_000 + int(own.nanosec)
                    stamp = stamp if 0 < stamp < LATEST else 0
            except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
                raise InvalidFile(  # the bag's definition of the type may be anything
                    bag.path,
                    f"{place}: fields are not those of {kind} ({error}); is the bag damaged?",
                ) from error
            if joints is None:
                one = len(values) == 1 and joint in names
                joints = (str(joint),) if one and len(names) > 1 else names
                if len(joints) != len(values):
                    advice = "choose a topic with names by --command-topic"
                    advice = "choose the joint with --joint" if len(values) == 1 else advice
                    raise InvalidFile(
                        bag.path,
                        f"topic {topic}: got {len(values)} without names, expected a number for "
                        f"each of {len(names)} joints ({', '.join(names)}); {advice}",
                    )
                notes = (f"numbers of {topic} taken for {', '.join(joints)}",)
            if len(joints) != len(values) or len(set(joints)) != len(joints):
                raise InvalidFile(
                    bag.path,
                    f"{place}: got {len(values)} in '{field}', expected an angle for each of "
                    f"{len(joints)} joints ({', '.join(joints[:20])})",
                )
            for name, value in zip(joints, values, strict=True):
                series = track.setdefault(name, (array("q"), array("q"), array("d")))
                series[0].append(received)
                series[1].append(stamp)
                series[2].append(value)
    return notes


def _angles_in(content: Any, kind: str, role: str) -> tuple[tuple[str, ...] | None, Any, str]:
    """Joints, None where they have no names, their angles in a message, and the field of these.

    There are none in an empty trajectory, nor actual ones in a state that has speeds only.
    """
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
        layouts = [
            pair
            for pair in (("reference", "feedback"), ("desired", "actual"))
            if all(hasattr(content, name) for name in pair)
        ]
        filled = [pair for pair in layouts if len(getattr(content, pair[1]).positions)]
        field = (filled or layouts)[0][role == "actual"]
        joints, angles = content.joint_names, getattr(content, field).positions
    return tuple(map(str, joints)), angles, field


def choose_topics(path: Path, kinds: Mapping[str, str], options: LogOptions) -> tuple[str, str]:
    """The topics of actual and of requested angles, which may be the same one.

    They are those that the options name, or the only ones that their types allow.
    """

    def listed(topics: Iterable[str]) -> str:
        return ", ".join(f"{name} ({kinds[name]})" for name in sorted(topics)[:20]) or "none"

    def chosen(
        role: str, named: str | None, types: Sequence[str], topics: Sequence[str], advice: str
    ) -> str:
        option = "--topic" if role == "actual" else "--command-topic"
        if named is None and len(topics) == 1:
            return topics[0]
        if named is None and topics:
            several = f"several topics with {role} angles; topics: {listed(topics)}"
            raise InvalidFile(path, f"{several}; choose one with {option}")
        if named is None:
            none = f"no topic with {role} angles; topics: {listed(kinds)}"
            raise InvalidFile(path, f"{none}; {advice}")
        if named not in kinds:
            hint = nearest(named, list(kinds))
            problem = f"no topic '{named}'{hint}; topics: {listed(kinds)}"
            raise InvalidFile(path, f"{option}: {problem}")
        if kinds[named] not in types:
            problem = f"topic {named} holds {kinds[named]}, expected one of {', '.join(types)}"
            raise InvalidFile(path, f"{option}: {problem}")
        return named

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
        raise InvalidFile(
            path,
            f"topic {actual} holds one angle of each joint, expected another topic for the "
            "requested angles; name it with --command-topic",
        )
    return actual, requested
