"""The robot in a model file, beside its models: legs, the bus, the servos' port."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from planner.exceptions import nearest
from planner.files.text import Toml, key_name, read_toml, toml_value
from planner.validation import shown

LEG = "leg"
"""Key of the tables ``[leg.<name>]``."""

BUS = {"bus": str, "port": str, "baud_rate": int}
"""Keys above all tables for the place and the type of the servos."""

KEYS = {
    "urdf": "the description of the robot, a file beside this one",
    "base": "the frame at the leg's upper end",
    "foot": "the frame at its lower end",
    "near_deg": "a table of angles of the standing pose [deg]",
    "lock_deg": "a table of joints that are held, with their angles [deg]",
}
"""Keys of a leg, and their meanings."""


class LegPlace(NamedTuple):
    """A leg in the file that describes it: the frames at its ends, and locked joints [rad or m].

    Paths start near the pose ``near`` [rad]; None is any.
    """

    urdf: str
    base: str
    foot: str
    locked: Mapping[str, float] = {}
    near: Mapping[str, float] | None = None


def is_of_robot(key: str, value: Any) -> bool:
    """Whether a key of a model file is about the robot, and no parameter and no joint."""
    if key == LEG:
        return isinstance(value, dict) and all(isinstance(each, dict) for each in value.values())
    return type(value) is BUS.get(key)


def read_legs(path: Path | str) -> dict[str, LegPlace]:
    """The legs of a model file, by name: its tables ``[leg.<name>]``; none where it has none."""
    file = read_toml(path, example='urdf = "robot.urdf"')
    tables = file.content.get(LEG, {})
    if not is_of_robot(LEG, tables):
        return {}
    return {name: _leg(file, name, table) for name, table in tables.items()}


def read_bus(path: Path | str) -> dict[str, Any]:
    """Bus, port and baud rate of a model file, where it has them."""
    file = read_toml(path, example='bus = "feetech"')
    content = {key: value for key, value in file.content.items() if not isinstance(value, dict)}
    settings = {key: content[key] for key in BUS if key in content}
    for key, value in settings.items():
        if not is_of_robot(key, value):
            expected = "a text in quotes" if BUS[key] is str else "a whole number"
            raise file.fault(f"{key}: got {shown(value)}, expected {expected}", (key,))
    return settings


def legs_text(path: Path | str) -> str:
    """The tables of the legs of a model file as TOML, as they are, but for comments."""
    tables = read_toml(path, example='urdf = "robot.urdf"').content.get(LEG, {})
    if not is_of_robot(LEG, tables):
        return ""
    blocks = [
        "\n".join(
            [
                f"\n[{LEG}.{key_name((name,))}]",
                *(f"{key} = {toml_value(each[key])}" for key in each),
            ]
        )
        for name, each in tables.items()
    ]
    return "\n".join(blocks) + "\n" if blocks else ""


def _leg(file: Toml, name: str, table: Mapping[str, Any]) -> LegPlace:
    place = (LEG, name)
    for key, value in table.items():
        words = ""
        if key not in KEYS:
            words = f"unknown key '{key}'{nearest(key, list(KEYS))}; keys: {', '.join(KEYS)}"
        elif key.endswith("_deg"):
            if not isinstance(value, dict) or not all(map(_is_number, value.values())):
                words = f"{key}: got {shown(value)}, expected {KEYS[key]}"
        elif not isinstance(value, str) or not value:
            words = f"{key}: got {shown(value)}, expected {KEYS[key]}"
        if words:
            raise file.fault(f"[{LEG}.{name}]: {words}", (*place, key))
    if missing := [key for key in ("urdf", "base", "foot") if key not in table]:
        meanings = "; ".join(f"{key} is {KEYS[key]}" for key in missing)
        words = f"[{LEG}.{name}] has no {', '.join(missing)}; {meanings}"
        raise file.fault(words, place)
    locked, near = (
        {joint: math.radians(angle) for joint, angle in table.get(key, {}).items()}
        for key in ("lock_deg", "near_deg")
    )
    urdf = str(Path(file.path).parent / table["urdf"])
    return LegPlace(
        urdf, table["base"], table["foot"], locked, near if "near_deg" in table else None
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
