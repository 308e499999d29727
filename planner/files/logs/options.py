"""Options for logs: joint, columns or topics, units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from planner.exceptions import InvalidFile, InvalidInput, nearest
from planner.files.columns import ANGLE_NAMES, ANGLE_UNITS, Scale, scale
from planner.validation import as_positive, shown

ALL_JOINTS = "all"
"""The key of all joints of a log."""

ROLES = ("requested", "actual")
"""Columns of a joint that may have units of their own."""

MOST_EPISODES = 1_000_000
"""Most episodes in a range; a longer one is a typing error."""


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """Choices that a log may leave open; None leaves one to the log.

    Attributes:
        joint: The joint to read, or "all".
        time: CSV: the column of times; ``clock:ms`` says that column ``clock`` is in milliseconds.
        requested: CSV: the column of requested angles.
        actual: CSV: the column of actual angles.
        torque: CSV: the column that says whether the torque is on.
        unit: The unit of the angles: rad, deg, ticks, us (pulses of a hobby servo), counts (of a
            sensor whose scale is fitted), turns, range (a share 0..1 of the joint's range), percent
            (0..100 of it) or range_m100_100 (-100..100). Where joints differ, ``rad,Jaw=range``;
            where the columns do, ``requested=us,actual=counts``.
        ticks_per_turn: Steps of the sensor in one turn, for angles in ticks; for pulses the
            microseconds of a turn, by default 4000.
        topic: Bags: the topic of actual angles.
        command_topic: Bags: the topic of requested angles.
        episodes: LeRobot: the episodes to read, such as ``0-3,7``.
    """

    joint: str | None = None
    time: str | None = None
    requested: str | None = None
    actual: str | None = None
    torque: str | None = None
    unit: str | None = None
    ticks_per_turn: float | None = None
    topic: str | None = None
    command_topic: str | None = None
    episodes: str | None = None

    def __post_init__(self) -> None:
        """Check the values that need no log.

        Raises:
            InvalidInput: A value that is no text, an unknown unit, ticks that are no number, or an
                invalid list of episodes.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "ticks_per_turn" and not isinstance(value, str | None):
                raise InvalidInput(f"{field.name}: got {shown(value)}, expected text")
        _units(self.unit)
        if self.ticks_per_turn is not None:
            as_positive("ticks per turn", self.ticks_per_turn, "more than 0, such as 4096")
        self.episode_numbers()

    def unit_of(self, joint: str, role: str = "") -> str | None:
        """The unit that the user gives for a joint's angles; None leaves it to the log.

        Args:
            joint: Name of the joint.
            role: "requested" or "actual", where their columns may differ.
        """
        units = _units(self.unit)
        return next((units[name] for name in (joint, role, "") if name in units), None)

    def joints_with_units(self) -> tuple[str, ...]:
        """The joints whose units the user gives by name."""
        return tuple(joint for joint in _units(self.unit) if joint not in ("", *ROLES))

    def scale_of(self, joint: str) -> Scale | None:
        """The scale of :meth:`unit_of`.

        Raises:
            InvalidInput: Ticks without their number in a turn.
        """
        unit = self.unit_of(joint)
        return None if unit is None else scale(unit, self.ticks_per_turn)

    def episode_numbers(self) -> frozenset[int] | None:
        """The episodes to read; None for all.

        Raises:
            InvalidInput: Not a list of numbers and ranges.
        """
        if self.episodes is None:
            return None
        chosen: set[int] = set()
        for part in self.episodes.split(","):
            match = re.fullmatch(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?", part, re.ASCII)
            first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
            if last < first or last - first >= MOST_EPISODES:
                raise InvalidInput(
                    f"episodes: got {shown(self.episodes)}, "
                    "expected numbers and ranges such as 0-3,7"
                )
            chosen.update(range(first, last + 1))
        return frozenset(chosen)


def choose_joints(path: Path | str, joints: Sequence[str], joint: str | None) -> tuple[int, ...]:
    """Places of the joints to read among ``joints``.

    Args:
        path: The file, for the error.
        joints: Names of its joints; "" where it names none.
        joint: The name to read, "all", or None where there is only one to choose.

    Raises:
        InvalidFile: No joint of this name, or several without a choice.
    """
    if joint == ALL_JOINTS and joint not in joints:
        return tuple(range(len(joints)))
    names = ", ".join(each or "(one without a name)" for each in joints)
    if joint is None:
        if len(joints) == 1:
            return (0,)
        raise InvalidFile(
            path, f"{len(joints)} joints ({names}); choose one with --joint NAME, or --joint all"
        )
    if joint not in joints:
        raise InvalidFile(path, f"no joint '{joint}'{nearest(joint, joints)}; joints: {names}")
    return (list(joints).index(joint),)


def _units(text: str | None) -> dict[str, str]:
    """Unit by joint; the key "" holds the default."""
    units: dict[str, str] = {}
    for part in text.split(",") if text is not None else ():
        joint, _, word = part.rpartition("=")
        unit = ANGLE_NAMES.get(word.strip().lower())
        if unit is None:
            raise InvalidInput(
                f"unit '{word.strip()}' is unknown{nearest(word.strip(), ANGLE_UNITS)}; expected "
                f"one of {', '.join(ANGLE_UNITS)}, or rad,Jaw=range where joints differ, or "
                "requested=us,actual=counts where columns do"
            )
        units[joint.strip()] = unit
    return units
