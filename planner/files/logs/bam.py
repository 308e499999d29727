"""JSON logs of BAM (Better Actuator Models): one entry a sample, in radians by definition."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidFile, nearest
from planner.files.logs.make_log import Columns, Source, Switch, make_log
from planner.files.logs.options import LogOptions, choose_joints
from planner.files.logs.units import scale
from planner.files.text import read_json
from planner.files.units import LARGEST
from planner.identification.log import Log
from planner.trajectory import Array

TIME, REQUESTED, ACTUAL, TORQUE = "timestamp", "goal_position", "position", "torque_enable"
"""Keys of an entry that are read; an entry may leave the torque's out."""

MASS, LENGTH, ARM_MASS = "mass", "length", "arm_mass"
"""Keys beside the entries: of the pendulum on the servo [kg, m, kg], the last of a few files."""

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

UNIT = "rad"
"""The unit of the angles, by the format's definition."""


def read_bam(path: Path | str, options: LogOptions) -> tuple[Log, ...]:
    """Read the one log of a BAM file.

    Raises:
        InvalidFile: The file is no such log; the message says where and why.
    """
    content = read_json(path, what="a log")
    entries = _entries(path, content)
    choose_joints(path, [""], options.joint)
    if options.unit_of("") not in (None, UNIT):
        raise InvalidFile(
            path,
            f"angles of BAM are in {UNIT} by definition, but --unit says {options.unit_of('')}; "
            "leave the option out",
        )
    source = Source(path=path, row="entry")
    torque_on = _torque(source, entries)
    angles = _numbers(source, entries, ACTUAL)
    requests = _numbers(source, entries, REQUESTED)
    if torque_on is not None:  # a servo that is switched off may have no goal
        no_goal = np.isnan(requests) & ~torque_on
        requests[no_goal] = angles[no_goal]
    moment = _moment(path, content)
    load = None if moment is None else -moment * np.sin(angles)
    radians = scale(UNIT, None)
    columns = Columns(
        times=_numbers(source, entries, TIME),
        requests=requests,
        angles=angles,
        request_scale=radians,
        angle_scale=radians,
        torque_on=torque_on,
        load=load,
    )
    torque = "" if torque_on is None else f", torque from '{TORQUE}'"
    notes = (
        f"time from '{TIME}', requested from '{REQUESTED}', actual from '{ACTUAL}'{torque}",
        f"angles in {UNIT}, as BAM defines them",
        *(() if moment is None else (f"load of a pendulum, {moment:.3g} N m where it is level",)),
    )
    return (make_log(source, columns, joint="", notes=notes),)


def bam_joints(path: Path | str, options: LogOptions) -> tuple[str, ...]:  # noqa: ARG001
    """The one joint of a BAM file, which has no name."""
    _entries(path, read_json(path, what="a log"))
    return ("",)


def _moment(path: Path | str, content: Mapping[str, Any]) -> float | None:
    """Largest torque of the pendulum's weight [N m], (m + m_arm / 2) g l; None without one.

    The pendulum hangs at 0 and is ``length`` long, its arm of one thickness.
    """
    if MASS not in content or LENGTH not in content:
        return None
    values = {}
    for key in (MASS, LENGTH, ARM_MASS):
        value = values[key] = content.get(key, 0.0)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and 0.0 <= value < LARGEST):
            raise InvalidFile(path, f"'{key}': got {value!r:.20}, expected a number, 0 or more")
    return float((values[MASS] + values[ARM_MASS] / 2.0) * GRAVITY * values[LENGTH])


def _entries(path: Path | str, content: Any) -> Sequence[Mapping[str, Any]]:
    entries = content.get("entries") if isinstance(content, dict) else None
    if not isinstance(entries, list):
        keys = ", ".join(map(repr, list(content)[:8])) if isinstance(content, dict) else ""
        raise InvalidFile(
            path,
            f"got {'the keys ' + keys if keys else 'no entries'}, expected BAM's object with a "
            "list 'entries'; give another format as CSV",
        )
    source = Source(path=path, row="entry")
    for k, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise source.fault(f"got {type(entry).__name__}, expected an object with keys", k)
    return entries


def _numbers(source: Source, entries: Sequence[Mapping[str, Any]], key: str) -> Array:
    values = np.empty(len(entries))
    for k, entry in enumerate(entries):
        if key not in entry:
            raise source.fault(
                f"no '{key}'{nearest(key, list(entry))}; keys: {', '.join(entry)}", k
            )
        number = entry[key]
        if number is None:
            number = math.nan
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise source.fault(f"'{key}': got {type(number).__name__}, expected a number", k)
        values[k] = number if abs(number) < 1e300 or number != number else math.inf
    return values


def _torque(source: Source, entries: Sequence[Mapping[str, Any]]) -> Switch | None:
    if not any(TORQUE in entry for entry in entries):
        return None
    switch = np.empty(len(entries), dtype=bool)
    for k, entry in enumerate(entries):
        value = entry.get(TORQUE)
        if value not in (0, 1):  # False and True among them
            raise source.fault(f"'{TORQUE}': got {value!r:.20}, expected true or false", k)
        switch[k] = bool(value)
    return switch
