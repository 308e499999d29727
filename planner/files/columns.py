"""Columns of a table: units, times and meanings by their names, or by the user's choice."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from itertools import takewhile
from typing import Literal, NamedTuple

import numpy as np

from planner.arrays import Array, not_radians, read_only, turns_words
from planner.exceptions import InvalidFile, nearest
from planner.files.table import Table


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _by_word(**units: str) -> dict[str, str]:
    return {word: unit for unit, words in units.items() for word in words.split()}


PULSE_ZERO, PULSES_PER_TURN = 1500, 4000  # of a hobby servo [us]: most turn 180° over 2000 us
COUNTS = "counts"  # unit of a sensor of unknown scale, such as a potentiometer at a converter
LARGEST = 1e6  # an angle or a length beyond [rad, m] is a mistake: its square would lose all digits
LEAST_DEG = 4.0  # a span below this [degrees] may be radians

# By unit: its names, factor and shift to the angle, and the unit of that; ticks and pulses have
# those of a turn, and a shift in pulses.
_ANGLES: Mapping[str, tuple[str, float, float, str]] = {
    "rad": ("rad radian radians", 1.0, 0.0, "rad"),
    "deg": ("deg degree degrees °", math.pi / 180.0, 0.0, "rad"),
    "ticks": ("tick ticks", 2.0 * math.pi, 0.0, "rad"),
    "us": ("us µs usec", 2.0 * math.pi, -PULSE_ZERO, "rad"),
    COUNTS: ("count counts adc", math.nan, math.nan, "rad"),
    "turns": ("turn turns", 2.0 * math.pi, 0.0, "rad"),
    "range": ("range", 1.0, 0.0, "1"),
    "percent": ("percent % range_0_100", 1e-2, 0.0, "1"),
    "range_m100_100": ("range_m100_100", 5e-3, 0.5, "1"),
}

# The unit of each of its names.
ANGLE_NAMES = _by_word(**{unit: words for unit, (words, *_) in _ANGLES.items()})
TIME_NAMES = _by_word(
    s="s sec secs second seconds", ms="ms msec millis", us="us usec µs", ns="ns nsec nanosec"
)
UNIT_NAMES = ANGLE_NAMES | _by_word(
    m="m meter meters metre metres", cm="cm", mm="mm", inch="inch", km="km"
)

# Units in SI; a percent of a joint's range is carried as if it were a degree, and printed as one.
SECONDS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLES: Mapping[str, float] = {"deg": math.pi / 180.0, "rad": 1.0}
SHARES: Mapping[str, float] = {"percent": math.pi / 180.0, "range": 100.0 * math.pi / 180.0}
JOINT_UNITS = {**ANGLES, **SHARES}
LENGTHS: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}

MOST_SHARE = 2.0  # largest magnitude of a share of the range
IN_SHARES = {  # by unit, what is expected of numbers beyond
    "range": "a share of the range, 0 to 1; if these are percent, call the unit percent",
    "percent": "percent of the range, 0 to 100; check the unit",
    "range_m100_100": "the range from -100 to 100; check the unit",
}

# Words in the names of columns: for times, for the roles of an angle, for what is no angle.
TIME = "t_s"  # the column of times [s]; it takes precedence over other columns
WORDS = _words("t time times timestamp stamp clock seconds")
ROLE_WORDS = {
    "requested": _words(
        "requested request req goal command commanded cmd target "
        "desired des reference ref setpoint action"
    ),
    "actual": _words(
        "actual act present measured meas measurement feedback state observed observation"
    ),
    "position": _words("position pos angle"),  # actual, without a word for its role
}
OTHER = _words(
    "velocity vel speed effort load torque current voltage volts temp temperature acceleration acc "
    "accel pwm error err gain limit min max"
)


def shown_units(names: Sequence[str], units: Sequence[str]) -> dict[str, Literal["deg", "percent"]]:
    """The unit of each joint's degrees, by joint: "deg", or "percent" of its range."""
    pairs = zip(names, units, strict=True)
    return {name: "percent" if unit in SHARES else "deg" for name, unit in pairs}


class Scale(NamedTuple):
    """How a logged number becomes an angle: ``factor * number + shift``."""

    name: str  # the unit of the number
    factor: float
    shift: float
    unit: str  # "rad", or "1" for a share of the joint's range


def scale(unit: str, ticks_per_turn: float | None, fault: Callable[[str], InvalidFile]) -> Scale:
    """The scale of a unit; NaN for counts. Of pulses a turn's ticks are its microseconds."""
    if unit == "ticks" and ticks_per_turn is None:
        raise fault(
            "angles in ticks without the ticks of a turn; give --ticks-per-turn, such as 4096 "
            "for Dynamixel X and Feetech STS servos"
        )
    _, factor, shift, of_angle = _ANGLES[unit]
    if unit in ("ticks", "us"):
        factor /= ticks_per_turn or PULSES_PER_TURN
        shift *= factor
    return Scale(unit, factor, shift, of_angle)


def split_name(name: str, units: Mapping[str, str]) -> tuple[str, str | None]:
    """Name and unit, if there is one, of ``knee_deg``, ``knee [deg]`` or ``knee (deg)``."""
    match = re.fullmatch(r"(.*\S)\s*[\[(]\s*([^\[\]()\s]+)\s*[\])]", name)
    stem, word = match.groups() if match else name.rpartition("_")[::2]
    unit = units.get(word.lower())
    return (stem, unit) if stem and unit is not None else (name, None)


def split_unit(column: str, units: Mapping[str, float]) -> tuple[str, str] | None:
    """Name and unit of a column, see :func:`split_name`; None where it has none of ``units``."""
    name, unit = split_name(column, UNIT_NAMES)
    return (name, unit) if unit is not None and unit in units else None


def with_unit(
    table: Table, columns: Sequence[str], units: Mapping[str, float]
) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Names and units of the columns, and their values in SI, shape (n, k), read-only."""
    parts = [split_unit(column, units) for column in columns]
    if bare := [column for column, part in zip(columns, parts, strict=True) if part is None]:
        stem, unit = split_name(bare[0], UNIT_NAMES)
        lack, advice = "has no unit", "rename or remove it"
        if unit is not None:
            lack = f"is in {unit}, which is not read here"
            advice = "convert it, or name the file from which it was exported"
        alike = [each for each in bare[1:] if split_name(each, UNIT_NAMES)[1] == unit]
        more = f" (likewise {', '.join(map(repr, alike))})" if alike else ""
        expected = f"expected {_endings(stem, units)}"
        raise table.fault(f"column '{bare[0]}' {lack}; {expected}: {advice}{more}")
    names, endings = zip(*(part for part in parts if part), strict=True)
    if double := next((name for name in names if names.count(name) > 1), ""):
        own = ", ".join(column for column, of in zip(columns, names, strict=True) if of == double)
        problem = f"'{double}' comes in several columns ({own}), expected one; remove the others"
        raise table.fault(problem)
    if len(set(endings) - set(SHARES)) > 1 or len(set(endings) & set(SHARES)) > 1:
        mixed = ", ".join(columns)
        raise table.fault(f"mixed units ({mixed}); expected one unit in all columns")
    factors = np.array([units[unit] for unit in endings])
    values = table.numbers(columns) * factors
    for k, j in np.argwhere(~(np.abs(values) <= LARGEST))[:1]:
        got, most = table.cells(columns[j])[k], f"{LARGEST / factors[j]:g}"
        words = f"got {got}, expected at most {most} either way; check the unit"
        raise table.fault(f"column '{columns[j]}': {words}", k)
    return names, endings, read_only(values)


def _endings(name: str, units: Mapping[str, float]) -> str:
    """A column's name with the usual units, in words."""
    return " or ".join(f"{name}_{unit}" for unit in units if unit != "range")


def pick(
    table: Table, names: Sequence[str], units: Mapping[str, float], *, advice: str
) -> list[str]:
    """Columns of the named quantities, in the order of ``names``; else the ``advice`` is given."""
    by_name: dict[str, list[str]] = {}
    for column in table.names:
        if part := split_unit(column, units):
            by_name.setdefault(part[0], []).append(column)
    for name in names:
        if (count := names.count(name)) > 1:
            raise InvalidFile(table.path, f"'{name}' is named {count} times; name it once")
        if name not in by_name:
            raise table.fault(
                f"no column {_endings(name, units)}{nearest(name, tuple(by_name))}; "
                f"columns: {', '.join(table.names)}; {advice}"
            )
    return [column for name in names for column in by_name[name]]


def check_radians(table: Table, column: str, angles: Array, advice: str) -> None:
    """Refuse radians, some of which may be missing (NaN), that look like degrees."""
    finite = np.flatnonzero(np.isfinite(angles))
    if len(finite) and not_radians(angles[finite]):
        k = int(finite[np.argmax(np.abs(angles[finite]))])
        words = f"column '{column}': {turns_words(angles[k])}; if these are degrees, {advice}"
        raise table.fault(words, k)


_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")


def time_columns(columns: Sequence[str]) -> list[str]:
    """The columns that may hold times."""

    def is_time(column: str) -> bool:
        stem, unit = split_name(column, TIME_NAMES)
        is_joint = unit is None and split_name(column, ANGLE_NAMES)[1] is not None  # `t_deg`
        return not is_joint and not WORDS.isdisjoint(map(str.lower, _WORD.findall(stem)))

    return list(filter(is_time, columns))


def clock_of(
    table: Table, named: str | None = None, *, advice: str = "name it with --time, or "
) -> tuple[str, str | None] | None:
    """The column of times, ``named`` as an option of logs or found, and its unit; None without one.

    The unit is "" of dates, and None where neither name nor cells say it.
    """
    name = named
    if name is None:
        columns = time_columns(table.names)
        advice = f"columns: {', '.join(table.names)}; {advice}rename it {TIME}"
        name = TIME if TIME in columns else table.only(columns, "be the time", advice)
    if name is None:
        return None
    stem, _, word = name.rpartition(":")
    if name not in table.names and stem in table.names:
        if word not in TIME_NAMES:
            units = ", ".join(SECONDS)
            raise table.fault(f"time in '{word}' is unknown; expected one of {units}")
        return stem, TIME_NAMES[word]
    unit = split_name(name, TIME_NAMES)[1]
    if unit is None:
        is_date = any(map(_date, table.cells(name)))
        unit = "" if is_date else TIME_NAMES.get(name.lower())
    return name, unit


def read_clock(
    table: Table, column: str, unit: str | None, *, missing: bool = False
) -> tuple[Array, str]:
    """Times [s], (n,), NaN where cells may be ``missing``; and where they come from, in words."""
    cells, absent = table.cells(column), ("", "nan", "nat")
    first = _date(next((cell for cell in cells if cell.lower() not in absent), ""))
    if first is not None:
        times = np.full(len(cells), np.nan)
        for k, cell in enumerate(cells):
            date = _date(cell)
            if date is not None and (date.tzinfo is None) == (first.tzinfo is None):
                times[k] = (date - first).total_seconds()
            elif not (missing and cell.lower() in absent):
                expected = f"a date and time as in the rows before, such as {first.isoformat()}"
                raise table.fault(f"column '{column}': got '{cell[:40]}', expected {expected}", k)
        return times, f"time from the dates in column '{column}', shifted to start at 0"
    if not unit:
        raise table.fault(f"column '{column}' has no unit; rename it {column}_s")
    seconds = SECONDS[unit]
    numbers = table.numbers([column], missing=missing)[:, 0]
    note = f"time from column '{column}'"
    if not column.endswith(f"_{unit}"):
        note += f" [{unit}]"
    finite = np.flatnonzero(np.isfinite(numbers))
    # times beyond eleven days count from the epoch, to a quarter of a microsecond in float64
    if not len(finite) or abs(numbers[finite[0]]) * seconds <= 1e6:
        return numbers * seconds, note
    return (numbers - numbers[finite[0]]) * seconds, f"{note}, shifted to start at 0"


def check_increasing(times: Array, fault: Callable[[str, int], InvalidFile]) -> None:
    """Refuse times [s] that do not increase, by the error that a row has a problem."""
    if (np.diff(times) <= 0.0).any():
        k = int(np.argmax(np.diff(times) <= 0.0)) + 1
        problem = (
            f"time is {times[k]:.9g} s after {times[k - 1]:.9g} s, expected times that increase; "
            "sort the rows and remove doubles, or cut the file there if its clock was set"
        )
        raise fault(problem, k)


def _date(cell: str) -> datetime | None:
    """The date and time that a cell holds; None for numbers and other text."""
    try:
        return datetime.fromisoformat(cell) if "-" in cell and ":" in cell else None
    except ValueError:
        return None


class Pair(NamedTuple):
    """The columns that may hold requested and actual angles of one joint, "" if they name none."""

    joint: str
    requested: tuple[str, ...]
    actual: tuple[str, ...]


def meaning(column: str) -> tuple[str, str] | None:
    """Role and joint ("" for none) of an angle's column; None where the name is unclear."""
    stem, _ = split_name(column, ANGLE_NAMES)
    stem = re.sub("set[ _.-]?point", "setpoint", stem, flags=re.IGNORECASE)
    spans = [word.span() for word in _WORD.finditer(stem)]
    words = [stem[start:end].lower() for start, end in spans]
    if "current" in words and not ROLE_WORDS["position"].isdisjoint(words):
        # the present position, and no ampere
        words = ["present" if word == "current" else word for word in words]
    if OTHER & set(words):
        return None
    role_words = frozenset[str]().union(*ROLE_WORDS.values())
    lead, trail = (
        len([*takewhile(role_words.__contains__, each)]) for each in (words, words[::-1])
    )
    trail = trail if lead < len(words) else 0
    edge = {*words[:lead], *words[len(words) - trail :]}
    roles = [role for role, synonyms in ROLE_WORDS.items() if edge & synonyms]
    if len(roles) == 2 and roles[1] == "position":
        roles.pop()
    if len(roles) != 1:
        return None
    first = spans[lead - 1][1] if lead else 0
    last = spans[len(spans) - trail][0] if trail else len(stem)
    return roles[0], stem[first:last].strip("_.-/: ")


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
