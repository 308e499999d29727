"""Meaning of a table's columns, guessed from their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from planner.files.logs.units import ANGLE_NAMES, split_name

REQUESTED = frozenset(
    (
        *("requested", "request", "req", "goal", "command", "commanded", "cmd", "target"),
        *("desired", "des", "reference", "ref", "setpoint", "action"),
    )
)
"""Words for a requested angle."""

ACTUAL = frozenset(
    (
        *("actual", "act", "present", "measured", "meas", "measurement", "feedback", "state"),
        *("observed", "observation"),
    )
)
"""Words for an actual angle."""

PLAIN = frozenset(("position", "pos", "angle"))
"""Words for an angle; without a word for its role, it is an actual one."""

OTHER = frozenset(
    (
        *("velocity", "vel", "speed", "effort", "load", "torque", "current", "voltage", "volts"),
        *("temp", "temperature", "acceleration", "acc", "accel", "pwm", "error", "err", "gain"),
        *("limit", "min", "max"),
    )
)
"""Words for quantities that are no angles."""

TORQUES = frozenset(("torque_on", "torque_enable", "torque_enabled"))
"""Names for whether the torque is on."""

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_SET_POINT = re.compile("set[ _.-]?point", re.IGNORECASE)
_SEPARATORS = "_.-/: "


class Pair(NamedTuple):
    """The columns of one joint.

    Attributes:
        joint: Its name; "" where the columns name none.
        requested: The columns that may hold its requested angles.
        actual: The columns that may hold its actual angles.
    """

    joint: str
    requested: tuple[str, ...]
    actual: tuple[str, ...]


def meaning(column: str) -> tuple[str, str] | None:
    """Role and joint ("" for none) of an angle's column; None where the name is unclear.

    The role is requested, actual, or position, which is an actual angle if no column says so.
    """
    stem = _SET_POINT.sub("setpoint", split_name(column, ANGLE_NAMES)[0])
    spans = [word.span() for word in _WORD.finditer(stem)]
    words = [stem[start:end].lower() for start, end in spans]
    if "current" in words and PLAIN & set(words):  # the present position, and no ampere
        words = ["present" if word == "current" else word for word in words]
    if OTHER & set(words):
        return None
    lead = _run(words)
    trail = _run(words[::-1]) if lead < len(words) else 0
    edge = {*words[:lead], *words[len(words) - trail :]}
    roles = [role for role, synonyms in _ROLES if edge & synonyms]
    if len(roles) == 2 and roles[1] == "position":
        roles.pop()
    if len(roles) != 1:
        return None
    first = spans[lead - 1][1] if lead else 0
    last = spans[len(spans) - trail][0] if trail else len(stem)
    return roles[0], stem[first:last].strip(_SEPARATORS)


def pairs(columns: Sequence[str]) -> tuple[Pair, ...]:
    """The columns by joint, in the order in which the joints appear."""
    by_joint: dict[str, dict[str, list[str]]] = {}
    for column in columns:
        if each := meaning(column):
            role, joint = each
            by_joint.setdefault(joint, {}).setdefault(role, []).append(column)
    by_stem: dict[str, list[str]] = {}  # for columns that only name a joint, such as elbow_deg
    for column in columns:
        by_stem.setdefault(split_name(column, ANGLE_NAMES)[0].lower(), []).append(column)
    return tuple(
        Pair(
            joint,
            tuple(by_role.get("requested", ())),
            # a column that only names the joint holds actual angles if no other does
            tuple(by_role.get("actual", by_role.get("position", by_stem.get(joint.lower(), ())))),
        )
        for joint, by_role in by_joint.items()
    )


def torque_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """The columns that may say whether the torque is on."""
    return tuple(name for name in columns if name.lower() in TORQUES)


def _run(words: Sequence[str]) -> int:
    """How many of the first words name a role."""
    role_words = REQUESTED | ACTUAL | PLAIN
    return next((k for k, word in enumerate(words) if word not in role_words), len(words))


_ROLES = (("requested", REQUESTED), ("actual", ACTUAL), ("position", PLAIN))
