"""CSV logs: a column of times, of requested and of actual angles, and perhaps of the torque."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from planner.files.columns import (
    ANGLE_NAMES,
    SECONDS,
    TIME,
    TIME_NAMES,
    TORQUES,
    Pair,
    Scale,
    check_radians,
    meaning,
    pairs,
    read_clock,
    split_name,
    time_column,
)
from planner.files.logs.make_log import (
    ALL_JOINTS,
    ROLES,
    Columns,
    LogOptions,
    Source,
    Switch,
    choose_joints,
    make_log,
)
from planner.files.paths import LOAD
from planner.files.table import Table, read_table
from planner.identification.log import Log
from planner.trajectory import Array

SWITCH = {"0": False, "1": True, "0.0": False, "1.0": True, "false": False, "true": True}
"""Values of a torque column."""


def read_csv_log(path: Path | str, options: LogOptions) -> tuple[Log, ...]:
    """Read the logs of the chosen joints from CSV, or from standard input for ``-``."""
    table = read_table(path)
    times, clock = _read_clock(table, options)
    torque, switch = _read_torque(table, options)
    logs, chosen = [], _choose_pairs(table, options)
    for pair in chosen:
        columns = [each[0] for each in (pair.requested, pair.actual)]
        numbers = table.numbers(columns, missing=True)
        units = [options.unit_of(pair.joint, role) for role in ROLES]
        scales = [
            _scale(table, column, unit, options)
            for column, unit in zip(columns, units, strict=True)
        ]
        if scales[0].name == "rad":  # requests only: angles may have glitches
            advice = (
                "name the columns so or give --unit deg; a joint that turns further is read in "
                "degrees or turns"
            )
            check_radians(table, columns[0], numbers[:, 0], advice)
        load = f"{pair.joint}{LOAD}" if pair.joint else LOAD.removeprefix("_")
        log_columns = Columns(
            times=times,
            requests=numbers[:, 0],
            angles=numbers[:, 1],
            request_scale=scales[0],
            angle_scale=scales[1],
            torque_on=switch,
            load=table.numbers([load], missing=True)[:, 0] if load in table.names else None,
            requested=columns[0],
        )
        names = columns
        if len(chosen) > 1 and pair.joint:  # joints whose columns are alike have one note
            # The joint as a word: `a` of `act_a` is not the first letter.
            word = rf"(?:(?<![^\W_])|(?<=[a-z])(?=[A-Z])){re.escape(pair.joint)}(?![^\W_A-Z])"
            names = [re.sub(word, "<joint>", each) for each in columns]
        both = " and ".join(dict.fromkeys(scale.name for scale in scales))
        notes = (
            f"{clock}, requested from '{names[0]}', actual from '{names[1]}'{torque}",
            f"angles in {both}, as {'the columns' if units[1] is None else '--unit'} said",
        )
        source = Source(path=path, line=lambda k: table.lines[k])
        logs.append(make_log(source, log_columns, joint=pair.joint, notes=notes))
    return tuple(logs)


def csv_joints(path: Path | str, options: LogOptions) -> tuple[str, ...]:  # noqa: ARG001
    """Names of the joints of a CSV log, in the file's order; "" where columns name none."""
    return tuple(pair.joint for pair in _complete(pairs(read_table(path).names)))


def _complete(candidates: tuple[Pair, ...]) -> tuple[Pair, ...]:
    return tuple(pair for pair in candidates if pair.requested and pair.actual)


def _choose_pairs(table: Table, options: LogOptions) -> list[Pair]:
    """One column of requested and one of actual angles for each joint to read.

    Of two columns that the options may name, the one that they leave out is guessed.
    """
    candidates, every = pairs(table.names), f"columns: {', '.join(table.names)}"
    named = {role: column for role in ROLES if (column := getattr(options, role)) is not None}
    if named:
        for column in named.values():
            table.place(column)
        first = next(iter(named.values()))
        _, joint = meaning(first) or ("", "")
        joint = options.joint if options.joint not in (None, ALL_JOINTS) else joint
        columns = {role: (column,) for role, column in named.items()}
        for role in [role for role in ROLES if role not in named]:
            guesses = {pair.joint: own for pair in candidates if (own := getattr(pair, role))}
            if joint not in guesses and len(guesses) != 1:
                raise table.fault(
                    f"no column is clearly the {role} angle; {every}; name it with --{role}"
                )
            columns[role] = guesses.get(joint) or next(iter(guesses.values()))
        if columns["requested"] == columns["actual"]:
            raise table.fault(
                f"column '{first}' cannot be both the requested and the actual angle; name the "
                "other one too"
            )
        chosen = [Pair(joint, **columns)]
    elif complete := _complete(candidates):
        joints = [pair.joint for pair in complete]
        chosen = [complete[k] for k in choose_joints(table.path, joints, options.joint)]
    else:
        half = next((pair for pair in candidates if pair.requested or pair.actual), None)
        if half is None:
            raise table.fault(
                f"no column names a requested or an actual angle; {every}; name them with "
                "--requested and --actual"
            )
        there, other = ROLES if half.requested else ROLES[::-1]
        raise table.fault(
            f"'{(half.requested or half.actual)[0]}' is the {there} angle, but no column names the "
            f"{other} one; {every}; name it with --{other}"
        )
    for role in ROLES:
        for several in (own for pair in chosen if len(own := getattr(pair, role)) > 1):
            raise table.fault(
                f"{len(several)} columns may be the {role} angle ({', '.join(several)}); name one "
                f"with --{role}"
            )
    return chosen


def _scale(table: Table, column: str, user_unit: str | None, options: LogOptions) -> Scale:
    _, column_unit = split_name(column, ANGLE_NAMES)
    if column_unit is not None and user_unit is not None and column_unit != user_unit:
        raise table.fault(
            f"column '{column}' says {column_unit}, but --unit says {user_unit}; rename the column "
            "or leave the option out"
        )
    return options.scale(
        column_unit or user_unit,
        table.fault,
        f"column '{column}' has no unit; give --unit rad (or deg, ticks, turns, range, percent), "
        f"or rename it {column}_rad",
    )


def _read_clock(table: Table, options: LogOptions) -> tuple[Array, str]:
    """Times [s], shape (n,), and where they come from, in words."""
    units = ", ".join(SECONDS)
    name, unit = options.time, None
    if name is None:
        name = time_column(table, advice="name it with --time, or ")
        if name is None:
            raise table.fault(
                f"no column is the time; columns: {', '.join(table.names)}; name it with --time, "
                f"or rename it {TIME}"
            )
    elif name not in table.names:
        stem, _, word = name.rpartition(":")
        if stem in table.names:
            name, unit = stem, TIME_NAMES.get(word)
            if unit is None:
                raise table.fault(f"time in '{word}' is unknown; expected one of {units}")
    advice = f"give --time {name}:s (or one of {units}), or "
    return read_clock(table, name, unit, missing=True, advice=advice)


def _read_torque(table: Table, options: LogOptions) -> tuple[str, Switch | None]:
    """The origin of the torque's switch in words, and the switch, shape (n,), if there is one."""
    if options.torque is not None:
        table.place(options.torque)
    columns: tuple[str, ...] = tuple(name for name in table.names if name.lower() in TORQUES)
    if options.torque is not None:
        columns = (options.torque,)
    if not columns:
        return "", None
    if len(columns) > 1:
        raise table.fault(
            f"{len(columns)} columns may say whether the torque is on ({', '.join(columns)}); name "
            "one with --torque"
        )
    place = table.names.index(columns[0])
    switch = np.empty(len(table.rows), dtype=bool)
    for k, row in enumerate(table.rows):
        cell = row[place].strip().lower()
        if cell not in SWITCH:
            raise table.fault(
                f"column '{columns[0]}': got '{cell[:20]!s}', expected 0, 1, true or false", k
            )
        switch[k] = SWITCH[cell]
    return f", torque from '{columns[0]}'", switch
