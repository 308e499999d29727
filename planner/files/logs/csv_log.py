"""Logs in tables: columns of times, requested and actual angles, and perhaps of the torque.

CSV files are such tables, and so are the entries of BAM's JSON.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array, Mask, as_number
from planner.exceptions import InvalidFile, nearest
from planner.files.columns import (
    ANGLE_NAMES,
    LARGEST,
    SECONDS,
    TIME,
    Pair,
    Scale,
    check_radians,
    clock_of,
    meaning,
    pairs,
    read_clock,
    scale,
    split_name,
)
from planner.files.logs.rows import ALL_JOINTS, ROLES, LogOptions, Recorded, Rows
from planner.files.paths import LOAD
from planner.files.table import Table, read_table
from planner.files.text import read_json

TORQUES = ("torque_on", "torque_enable", "torque_enabled")  # names for whether the torque is on
SWITCH = {"0": False, "1": True, "0.0": False, "1.0": True, "false": False, "true": True}

# Keys of an entry of BAM that are read; an entry may leave the torque's out.
BAM_KEYS = ("timestamp", "goal_position", "position", "torque_enable")


def read_csv_log(path: Path | str, options: LogOptions) -> Iterator[Recorded]:
    """Read the recording in a CSV file, or in standard input for ``-``."""
    yield _recorded(read_table(path), options)


def read_bam(path: Path | str, options: LogOptions) -> Iterator[Recorded]:
    """Read the recording in a BAM file: angles in radians, and the load of its pendulum."""
    content = read_json(path, what="a log")
    entries = content.get("entries") if isinstance(content, dict) else None
    unit, problem = options.unit_of(""), ""
    if not isinstance(entries, list):
        keys = ", ".join(map(repr, list(content)[:8])) if isinstance(content, dict) else ""
        problem = (
            f"got {'the keys ' + keys if keys else 'no entries'}, expected BAM's object with a "
            "list 'entries'; give another format as CSV"
        )
    elif unit not in (None, "rad"):
        words = "angles of BAM are in rad by definition"
        problem = f"{words}, but --unit says {unit}; leave the option out"
    if problem or not isinstance(entries, list):
        raise InvalidFile(path, problem)
    moment, rows = _moment(path, content), list[list[str]]()
    names = (*BAM_KEYS[:-1], *["load_Nm"] * (moment is not None), BAM_KEYS[-1])
    table = Table(path=path, row="entry", names=names, rows=rows)
    for k, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise table.fault(f"got {type(entry).__name__}, expected an object with keys", k)
        if missing := [key for key in BAM_KEYS[:-1] if key not in entry]:
            hint = nearest(missing[0], list(entry))
            raise table.fault(f"no '{missing[0]}'{hint}; keys: {', '.join(entry)}", k)
        values = (entry.get(key) for key in BAM_KEYS)
        cells = ["" if value is None else json.dumps(value) for value in values]
        if cells[1] in ("", "NaN") and SWITCH.get(cells[3]) is False:
            cells[1] = cells[2]  # a servo that is switched off may have no goal
        if moment is not None:
            cells.insert(3, repr(-moment * math.sin(as_number(entry["position"]))))
        rows.append(cells)
    if not any(cells[-1] for cells in rows):
        table = replace(table, names=names[:-1])
    options = replace(options, time=f"{BAM_KEYS[0]}:s", unit="rad")
    note = () if moment is None else (f"load of a pendulum, {moment:.3g} N m where it is level",)
    yield _recorded(table, options, units="BAM defines them", notes=note)


def _moment(path: Path | str, content: Mapping[str, Any]) -> float | None:
    """Largest torque of the pendulum's weight [N m], (m + m_arm / 2) g l; None without one."""
    if "mass" not in content or "length" not in content:
        return None
    values = {key: content.get(key, 0.0) for key in ("mass", "arm_mass", "length")}
    for key, value in values.items():
        if not 0.0 <= as_number(value) < LARGEST:
            raise InvalidFile(path, f"'{key}': got {value!r:.20}, expected a number, 0 or more")
    mass, arm_mass, length = values.values()
    return float((mass + arm_mass / 2.0) * 9.80665 * length)  # [m/s^2]


def _recorded(
    table: Table, options: LogOptions, *, units: str = "", notes: tuple[str, ...] = ()
) -> Recorded:
    """The recording in a table; ``units`` says in words what defines the units of all angles."""
    joints = {pair.joint: pair for pair in _pairs(table, options)}

    @cache
    def shared() -> tuple[Array, str, str, Mask | None]:  # names of joints need no times
        times, clock = read_clock(table, *_clock(table, options), missing=True)
        return times, clock, *_read_torque(table, options)

    def rows_of(joint: str) -> Rows:
        pair = joints[joint]
        for role in ROLES:
            table.only(getattr(pair, role), f"be the {role} angle", f"name one with --{role}")
        columns = [pair.requested[0], pair.actual[0]]
        user_units = [options.unit_of(joint, role) for role in ROLES]
        scales = _scales(table, columns, user_units, options)
        times, clock, torque, switch = shared()
        numbers = table.numbers(columns, missing=True)
        if scales[0].name == "rad" and not units:  # requests only: angles may have glitches
            advice = (
                "name the columns so or give --unit deg; a joint that turns further is read in "
                "degrees or turns"
            )
            check_radians(table, columns[0], numbers[:, 0], advice)
        load = f"{joint}{LOAD}" if joint else LOAD.removeprefix("_")
        both = " and ".join(dict.fromkeys(each.name for each in scales))
        said = "the columns said" if user_units[1] is None else "--unit said"
        return Rows(
            source=table,
            joint=joint,
            times=times,
            requests=numbers[:, 0],
            angles=numbers[:, 1],
            scales=scales,
            torque_on=switch,
            load=table.numbers([load], missing=True)[:, 0] if load in table.names else None,
            requested=columns[0],
            notes=(
                f"{clock}, requested from '{columns[0]}', actual from '{columns[1]}'{torque}",
                f"angles in {both}, as {units or said}",
                *notes,
            ),
        )

    return {joint: partial(rows_of, joint) for joint in joints}


def _pairs(table: Table, options: LogOptions) -> list[Pair]:
    """Columns of both angles of each joint; of two, one that the options leave out is guessed."""
    candidates, every = pairs(table.names), f"columns: {', '.join(table.names)}"
    named = {role: column for role in ROLES if (column := getattr(options, role)) is not None}
    if not named:
        if complete := [pair for pair in candidates if pair.requested and pair.actual]:
            return complete
        half = next((pair for pair in candidates if pair.requested or pair.actual), None)
        words = "no column names a requested or an actual angle"
        advice = "them with --requested and --actual"
        if half is not None:
            there, other = ROLES if half.requested else ROLES[::-1]
            column, advice = (half.requested or half.actual)[0], f"it with --{other}"
            words = f"'{column}' is the {there} angle, but no column names the {other} one"
        raise table.fault(f"{words}; {every}; name {advice}")
    for column in named.values():
        table.cells(column)
    first = next(iter(named.values()))
    _, joint = meaning(first) or ("", "")
    joint = options.joint if options.joint not in (None, ALL_JOINTS) else joint
    columns = {role: (column,) for role, column in named.items()}
    for role in [role for role in ROLES if role not in named]:
        guesses = {pair.joint: own for pair in candidates if (own := getattr(pair, role))}
        if joint not in guesses and len(guesses) != 1:
            words = f"no column is clearly the {role} angle; {every}; name it with --{role}"
            raise table.fault(words)
        columns[role] = guesses.get(joint) or next(iter(guesses.values()))
    if columns["requested"] == columns["actual"]:
        words = "cannot be both the requested and the actual angle; name the other one too"
        raise table.fault(f"column '{first}' {words}")
    return [Pair(joint, **columns)]


def _scales(
    table: Table, columns: list[str], user_units: list[str | None], options: LogOptions
) -> tuple[Scale, Scale]:
    """The scales of requested and actual angles; what has no unit, times too, is said at once."""
    own = [split_name(column, ANGLE_NAMES)[1] for column in columns]
    for column, column_unit, user_unit in zip(columns, own, user_units, strict=True):
        if None not in (column_unit, user_unit) and column_unit != user_unit:
            raise table.fault(
                f"column '{column}' says {column_unit}, but --unit says {user_unit}; rename the "
                "column or leave the option out"
            )
    units = [named or by_user for named, by_user in zip(own, user_units, strict=True)]
    time, time_unit = _clock(table, options)
    angles = [column for column, unit in zip(columns, units, strict=True) if unit is None]
    times = [time] if time_unit is None else []
    if bare := times + angles:
        advice = [f"--time {time}:s (or one of {', '.join(SECONDS)})"] if times else []
        advice += ["--unit rad (or deg, ticks, turns, range, percent)"] if angles else []
        endings = [f"{each}_s" for each in times] + [f"{each}_rad" for each in angles]
        plural, has, it = ("", "has", "it") if len(bare) == 1 else ("s", "have", "them")
        raise table.fault(
            f"column{plural} {', '.join(map(repr, bare))} {has} no unit; give "
            f"{' and '.join(advice)}, or rename {it} {', '.join(endings)}"
        )
    requested, actual = (scale(unit, options.ticks_per_turn, table.fault) for unit in units if unit)
    return requested, actual


def _clock(table: Table, options: LogOptions) -> tuple[str, str | None]:
    """The column of times, and its unit if it is known."""
    if clock := clock_of(table, options.time):
        return clock
    columns = f"columns: {', '.join(table.names)}; name it with --time, or rename it {TIME}"
    raise table.fault(f"no column is the time; {columns}")


def _read_torque(table: Table, options: LogOptions) -> tuple[str, Mask | None]:
    """The origin of the torque's switch in words, and the switch, shape (n,), if there is one."""
    columns = [name for name in table.names if name.lower() in TORQUES]
    meant = "say whether the torque is on"
    column = options.torque or table.only(columns, meant, "name one with --torque")
    if column is None:
        return "", None
    cells = [cell.lower() for cell in table.cells(column)]
    for k in [k for k, cell in enumerate(cells) if cell not in SWITCH]:
        got = f"got '{cells[k][:20]}', expected 0, 1, true or false"
        raise table.fault(f"column '{column}': {got}", k)
    return f", torque from '{column}'", np.array([SWITCH[cell] for cell in cells])
