"""The robot in a model file, beside its models: legs, the bus, the servos."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from planner.exceptions import InvalidFile, InvalidInput, nearest
from planner.files.text import Toml, key_name, read_toml, toml_value
from planner.validation import as_number, as_whole, shown

if TYPE_CHECKING:
    from planner.robot.arm import Servo

LEG, SERVO = "leg", "servo"
"""Keys of the tables ``[leg.<name>]`` and ``[<joint>.servo]``."""

BUS = {"bus": str, "port": str, "baud_rate": int}
"""Keys above all tables for the place and the type of the servos."""

Kinds = Mapping[str, tuple[Callable[[Any], bool], str]]
"""By key, whether a value is one, and what is expected."""


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and value != ""


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(as_number(value))


def _is_pose(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_is_number, value.values()))


LEG_KEYS: Kinds = {
    "urdf": (_is_text, "the description of the robot, a file beside this one"),
    "base": (_is_text, "the frame at the leg's upper end"),
    "foot": (_is_text, "the frame at its lower end"),
    "near_deg": (_is_pose, "a table of angles of the standing pose [deg]"),
    "lock_deg": (_is_pose, "a table of joints that are held, with their angles [deg]"),
}


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
    legs = {}
    for name, table in _leg_tables(file).items():
        _check(file, (LEG, name), table, LEG_KEYS, ("urdf", "base", "foot"))
        locked, near = (
            {joint: math.radians(angle) for joint, angle in table.get(key, {}).items()}
            for key in ("lock_deg", "near_deg")
        )
        urdf = str(Path(file.path).parent / table["urdf"])
        pose = near if "near_deg" in table else None
        legs[name] = LegPlace(urdf, table["base"], table["foot"], locked, pose)
    return legs


def legs_text(path: Path | str) -> str:
    """The tables of the legs of a model file as TOML, as they are, but for comments."""
    tables = _leg_tables(read_toml(path, example='urdf = "robot.urdf"'))
    return "".join(
        f"\n[{LEG}.{key_name((name,))}]\n"
        + "".join(f"{key} = {toml_value(value)}\n" for key, value in table.items())
        for name, table in tables.items()
    )


def _leg_tables(file: Toml) -> dict[str, dict[str, Any]]:
    tables: dict[str, Any] = file.content.get(LEG, {})
    return tables if is_of_robot(LEG, tables) else {}


def read_bus(path: Path | str) -> dict[str, Any]:
    """Bus, port and baud rate of a model file, where it has them."""
    file = read_toml(path, example='bus = "feetech"')
    settings = {
        key: value
        for key, value in file.content.items()
        if key in BUS and not isinstance(value, dict)
    }
    for key, value in settings.items():
        if not is_of_robot(key, value):
            expected = "a text in quotes" if BUS[key] is str else "a whole number"
            raise file.fault(f"{key}: got {shown(value)}, expected {expected}", (key,))
        if "\0" in str(value):
            raise file.fault(f"{key}: got {shown(value)}, expected no null character", (key,))
    return settings


def read_servos(
    path: Path | str, joints: Sequence[str] | None = None, *, optional: bool = False
) -> dict[str, Servo]:
    """The servos of a model file, of these joints or of all: its tables ``[<joint>.servo]``.

    There may be none only if they are ``optional``.
    """
    from planner.robot.arm import SETTINGS, Servo  # imports the drivers of the buses

    def is_whole(value: Any) -> bool:
        return as_whole(value) is not None

    whole = (is_whole, "a whole number")
    keys: Kinds = dict.fromkeys(("zero_tick", "direction", *SETTINGS), whole) | {
        "id": (is_whole, "a whole number, the servo's identifier on the bus"),
        "ticks_per_turn": (_is_number, "a number"),
        "limits": (
            lambda value: isinstance(value, list) and [*map(_is_number, value)] == [True, True],
            "two angles [rad]",
        ),
    }
    file = read_toml(path, example="id = 1")
    servos = {}
    for joint, own in file.content.items():
        table = own.get(SERVO) if isinstance(own, dict) else None
        if not isinstance(table, dict):
            continue
        _check(file, (joint, SERVO), table, keys, ("id",))
        arguments = {key: value for key, value in table.items() if key not in SETTINGS}
        if "limits" in arguments:
            arguments["limits"] = tuple(map(float, arguments["limits"]))
        settings = {key: value for key, value in table.items() if key in SETTINGS}
        try:
            servos[joint] = Servo(**arguments, settings=settings)
        except InvalidInput as error:
            raise InvalidFile(file.path, f"[{joint}.{SERVO}]: {error}") from error
    if not servos and not optional:
        raise InvalidFile(
            file.path,
            "no table of a servo; expected tables such as [knee.servo] with id, zero_tick and "
            "direction, as calibrate writes them",
        )
    if missing := [name for name in joints or () if name not in servos]:
        raise InvalidFile(
            file.path,
            f"no servo of {', '.join(missing)}; servos are of {', '.join(servos)}: calibrate it, "
            "or name the columns alike",
        )
    return servos if joints is None else {name: servos[name] for name in joints}


def servo_lines(joint: str, servo: Servo) -> list[str]:
    """The table of a joint's servo as TOML."""
    return [
        "",
        f"[{key_name((joint,))}.{SERVO}]",
        f"id = {servo.id}",
        f"zero_tick = {servo.zero_tick}  # count at angle 0",
        f"direction = {servo.direction}  # -1 where the servo is mounted the other way round",
        f"ticks_per_turn = {servo.ticks_per_turn}",
        f"limits = {list(servo.limits)}  # [rad] least and largest request",
        *(f"{name} = {value}" for name, value in servo.settings.items()),
    ]


def _check(
    file: Toml, place: Sequence[str], table: Mapping[str, Any], kinds: Kinds, needed: Sequence[str]
) -> None:
    """Refuse unknown keys of a table, values that are not of their kind, and missing keys."""
    name = ".".join(place)
    for key, value in table.items():
        words = ""
        if key not in kinds:
            words = f"unknown key '{key}'{nearest(key, [*kinds])}; keys: {', '.join(kinds)}"
        elif not kinds[key][0](value):
            words = f"{key}: got {shown(value)}, expected {kinds[key][1]}"
        if words:
            raise file.fault(f"[{name}]: {words}", (*place, key))
    if missing := [key for key in needed if key not in table]:
        meanings = "; ".join(f"{key} is {kinds[key][1]}" for key in missing)
        raise file.fault(f"[{name}] has no {', '.join(missing)}; {meanings}", place)
