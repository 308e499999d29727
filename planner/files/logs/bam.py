"""JSON logs of BAM (Better Actuator Models): one entry a sample, in radians by definition."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.exceptions import InvalidFile
from planner.files.logs.joints import choose_joints
from planner.files.logs.options import LogOptions
from planner.files.logs.rows import Columns, Source, Switch, make_log
from planner.files.logs.units import scale
from planner.files.table import nearest
from planner.files.text import read_text
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.identification.log import Log

TIME, REQUESTED, ACTUAL, TORQUE = "timestamp", "goal_position", "position", "torque_enable"
"""Keys of an entry that are read; an entry may leave the torque's out."""

UNIT = "rad"
"""The unit of the angles, by the format's definition."""


def read_bam(path: Path | str, options: LogOptions) -> tuple[Log, ...]:
    """Read the one log of a BAM file.

    Raises:
        InvalidFile: The file is no such log; the message says where and why.
    """
    entries = _entries(path)
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
        unasked = np.isnan(requests) & ~torque_on
        requests[unasked] = angles[unasked]
    radians = scale(UNIT, None)
    columns = Columns(
        times=_numbers(source, entries, TIME),
        requests=requests,
        angles=angles,
        request_scale=radians,
        angle_scale=radians,
        torque_on=torque_on,
    )
    torque = "" if torque_on is None else f", torque from '{TORQUE}'"
    notes = (
        f"time from '{TIME}', requested from '{REQUESTED}', actual from '{ACTUAL}'{torque}",
        f"angles in {UNIT}, as BAM defines them",
    )
    return (make_log(source, columns, joint="", notes=notes),)


def bam_joints(path: Path | str, options: LogOptions) -> tuple[str, ...]:  # noqa: ARG001
    """The one joint of a BAM file, which has no name."""
    _entries(path)
    return ("",)


def parse_json(path: Path | str) -> Any:
    """What a JSON file holds; NaN and infinities are read too, as Python writes them.

    Raises:
        InvalidFile: There is no such file, or it is not JSON.
    """
    text = read_text(path)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InvalidFile(
            path, f"not JSON ({error.msg}); is the file cut short?", line=error.lineno
        ) from error
    except RecursionError as error:
        raise InvalidFile(path, "not JSON of a log: nested too deeply") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InvalidFile(path, "not JSON of a log: a number is too long") from error


def _entries(path: Path | str) -> Sequence[Mapping[str, Any]]:
    content = parse_json(path)
    entries = content.get("entries") if isinstance(content, dict) else None
    if not isinstance(entries, list):
        found = ", ".join(map(repr, list(content)[:8])) if isinstance(content, dict) else ""
        raise InvalidFile(
            path,
            f"got {'the keys ' + found if found else 'no entries'}, expected BAM's object with a "
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
