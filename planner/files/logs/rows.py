"""Logs from columns of numbers: the choices of a user, and what every format has to check."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array, Indices, Mask, as_positive, not_radians, shown
from planner.exceptions import InvalidFile, InvalidInput, nearest
from planner.files.columns import (
    ANGLE_NAMES,
    COUNTS,
    IN_SHARES,
    LARGEST,
    LEAST_DEG,
    MOST_SHARE,
    Scale,
    check_increasing,
)
from planner.files.table import Source
from planner.identification.log import FASTEST, FEWEST_ROWS, Doubt, Log, Written

ALL_JOINTS = "all"  # the key of all joints of a log
ROLES = ("requested", "actual")  # columns of a joint that may have units of their own
SPARSE = 0.5  # rows so far apart [s] hardly show a joint's motion: their times may be their numbers

# Requests are slow if they travel at most this share of their range in this time [s]: the joint
# then lags by its delay and friction only, to both sides. For a scale to be fitted they must span
# this share of the range of all.
SLOW_TIME, SLOW_SHARE, SLOW_RANGE = 1.0, 0.4, 0.5


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

    Raises:
        InvalidInput: A choice is no text, an unknown unit, no range of episodes, or not above 0.
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
        """Check the values that need no log."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "ticks_per_turn" and not isinstance(value, str | None):
                raise InvalidInput(f"{field.name}: got {shown(value)}, expected text")
        self.units()
        if self.ticks_per_turn is not None:
            as_positive("ticks per turn", self.ticks_per_turn, "more than 0, such as 4096")
        self.episode_numbers()

    def unit_of(self, joint: str, role: str = "") -> str | None:
        """The unit that the user gives for angles of a joint and a role; None for none."""
        units = self.units()
        return next((units[name] for name in (joint, role, "") if name in units), None)

    def units(self) -> dict[str, str]:
        """Unit by joint or role; the key "" holds the default."""
        units: dict[str, str] = {}
        for part in self.unit.split(",") if self.unit is not None else ():
            joint, _, word = part.rpartition("=")
            unit = ANGLE_NAMES.get(word.strip().lower())
            if unit is None:
                known = tuple(dict.fromkeys(ANGLE_NAMES.values()))
                raise InvalidInput(
                    f"unit '{word.strip()}' is unknown{nearest(word.strip(), known)}; "
                    f"expected one of {', '.join(known)}, or rad,Jaw=range where joints "
                    "differ, or requested=us,actual=counts where columns do"
                )
            units[joint.strip()] = unit
        return units

    def episode_numbers(self) -> frozenset[int] | None:
        """The episodes to read; None for all."""
        if self.episodes is None:
            return None
        chosen: set[int] = set()
        for part in self.episodes.split(","):
            match = re.fullmatch(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?", part, re.ASCII)
            first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
            if last < first or last - first >= 1_000_000:  # longer ranges are typing errors
                words = "expected numbers and ranges such as 0-3,7"
                raise InvalidInput(f"episodes: got {shown(self.episodes)}, {words}")
            chosen.update(range(first, last + 1))
        return frozenset(chosen)


def chosen_joints(path: Path | str, joints: Sequence[str], joint: str | None) -> tuple[str, ...]:
    """The joint of ``path`` to read, or all for "all"; None is the only one."""
    if joint == ALL_JOINTS and joint not in joints:
        return tuple(joints)
    names = ", ".join(each or "(one without a name)" for each in joints)
    if joint is None and len(joints) != 1:
        words = f"{len(joints)} joints ({names}); choose one with --joint NAME, or --joint all"
        raise InvalidFile(path, words)
    if joint is not None and joint not in joints:
        names += "" if any(joints) else "; leave out --joint"
        raise InvalidFile(path, f"no joint '{joint}'{nearest(joint, joints)}; joints: {names}")
    return (joints[0] if joint is None else joint,)


@dataclass(frozen=True, kw_only=True)
class Rows:
    """The rows of a joint, as they are written; missing numbers are NaN."""

    source: Source
    joint: str  # "" where it has no name
    times: Array  # [s], shape (n,)
    requests: Array  # requested angles, shape (n,), in the unit of the first scale
    angles: Array  # actual angles, shape (n,), in the unit of the second
    scales: tuple[Scale, Scale]
    torque_on: Mask | None = None  # whether it was on, (n,); None where the log does not say
    # torque on the joint in the direction of positive angles [N m], shape (n,); None where the
    # log does not say
    load: Array | None = None
    requested: str = ""  # column of requests; "" where there is none of this joint alone
    episode: int | None = None  # its number; None for a file of one recording
    notes: tuple[str, ...] = ()
    numbers: Indices | None = None  # of the rows in the source, from 0; None for all

    def fault(self, problem: str, k: int) -> InvalidFile:
        """The error that a row has a problem."""
        return self.source.fault(problem, k if self.numbers is None else int(self.numbers[k]))

    def wrong(self, problem: str) -> InvalidFile:
        """The error that the rows of the joint as a whole have a problem."""
        named = not self.joint or self.source.part.endswith(self.joint)
        return InvalidFile(self.source.name, problem if named else f"{self.joint}: {problem}")

    @property
    def unread(self) -> Mask:
        """Rows in which the angle or the load is missing."""
        missing = np.isnan(self.angles)
        return missing if self.load is None else missing | np.isnan(self.load)


# A recording in a file: its joints, and the rows of each, read on demand.
Recorded = Mapping[str, Callable[[], Rows]]


def make_log(rows: Rows) -> Log:
    """Check rows and make a log of them.

    A row without a time or a request is left out, and so is one that repeats the row before. Where
    only the angle or the load is missing the request was sent: the row stays, as not measured.
    """
    rows, measured = _cleaned(rows)
    rows = _with_fitted_scale(rows, measured)
    source, problem, (requested, actual) = rows.source, "", rows.scales
    if requested.unit != actual.unit:
        problem = (
            f"requests in {requested.name} but angles in {actual.name}; expected angles for both, "
            "or shares of the range for both"
        )
    elif len(rows.times) < FEWEST_ROWS:
        least = f"expected at least {FEWEST_ROWS}; record longer"
        problem = f"rows of samples: got {len(rows.times)}, {least}"
    if problem:
        raise rows.wrong(problem)
    check_increasing(_checked(rows, "time", rows.times, Scale("s", 1.0, 0.0, "s")), rows.fault)
    requests = _checked(rows, "requested angle", rows.requests, requested)
    angles = _checked(rows, "actual angle", rows.angles, actual)
    _check_one_unit(rows, requests[measured], angles[measured])
    if np.array_equal(requests[measured], angles[measured]) and np.ptp(angles) > 0.0:
        raise rows.wrong(
            "the actual angles equal the requested ones in every row, expected measured angles; is "
            "the same column recorded twice?"
        )
    try:
        return Log(
            times=rows.times,
            requests=requests,
            angles=angles,
            torque_on=np.ones_like(measured) if rows.torque_on is None else rows.torque_on,
            name=source.name,
            joint=rows.joint,
            unit=actual.unit,
            load=rows.load,
            measured=measured,
            notes=(*rows.notes, *_doubts(rows)),
            written=Written(str(source.path), rows.episode, rows.requested, *requested[:3]),
        )
    except InvalidInput as error:
        raise InvalidFile(source.path, str(error)) from error


def _cleaned(rows: Rows) -> tuple[Rows, Mask]:
    """The rows with a time and a request that do not repeat the row before, and which are whole.

    Missing angles and loads are those before, or the first ones: values between two readings would
    hide where an encoder starts again.
    """
    lost = np.isnan(rows.times) | np.isnan(rows.requests)
    partial = lost | rows.unread
    count, whole = len(lost), int(np.sum(~partial))
    if whole < count and whole < FEWEST_ROWS:
        words = f"a value is missing in {count - whole} of {count} rows, expected both angles in at"
        advice = "are requested and actual angles in rows of their own?"
        raise rows.fault(f"{words} least {FEWEST_ROWS}; {advice}", int(np.argmax(partial)))
    kept = np.flatnonzero(~lost)
    names = ("times", "requests", "angles", "load", "torque_on")
    arrays: dict[str, Any] = {
        name: array[kept] for name in names if (array := getattr(rows, name)) is not None
    }
    double = np.arange(len(kept)) > 0
    for array in arrays.values():
        double[1:] &= (array[1:] == array[:-1]) | (np.isnan(array[1:]) & np.isnan(array[:-1]))
    parts = [
        (np.flatnonzero(lost), "left out, as the time or the request is missing"),
        (kept[double], "left out, the same as the row before"),
    ]
    arrays, kept = {name: array[~double] for name, array in arrays.items()}, kept[~double]
    rows = replace(rows, **arrays, numbers=kept)
    missing = rows.unread
    if missing.any():
        places = np.flatnonzero(~missing)
        last = places[np.maximum(np.searchsorted(places, np.arange(len(missing))) - 1, 0)]
        what = "angle" if np.isnan(rows.angles).any() else "load"
        parts.append((kept[missing], f"the {what} is missing, only the request counts"))
        for name in {"angles", "load"} & set(arrays):
            arrays[name] = np.where(np.isnan(arrays[name]), arrays[name][last], arrays[name])
    notes = list(rows.notes)
    for numbers, words in [each for each in parts if len(each[0])]:
        first = rows.source.place_of(int(numbers[0]))
        first = first if len(numbers) == 1 else f"{len(numbers)} rows, first {first}"
        notes.append(f"{first}: {words}")
    return replace(rows, **arrays, notes=tuple(notes)), ~missing


def _with_fitted_scale(rows: Rows, measured: Mask) -> Rows:
    """The rows with the scale of counts, by a line through slow rows, and a note on it."""
    requested, actual = rows.scales
    if requested.name == COUNTS:
        advice = "expected us, deg, rad or ticks, with counts for the actual angles only"
        raise rows.wrong(f"requests in counts, whose scale is unknown; {advice}")
    if actual.name != COUNTS:
        return rows
    requests = requested.factor * rows.requests + requested.shift
    slow = measured & _slow(rows.times, requests)
    if rows.torque_on is not None:
        slow &= rows.torque_on
    inputs, counts = requests[slow], rows.angles[slow]
    speeds = np.gradient(requests, rows.times)[slow]
    behind = np.sign(speeds)  # which way friction holds the joint back
    share = _share(inputs, requests)
    if not (share >= SLOW_RANGE and {-1.0, 1.0} <= set(behind.tolist())):
        raise rows.wrong(
            f"the scale of actual angles in counts cannot be found: {len(inputs)} rows have slow "
            f"requests, over {100.0 * share:.0f} % of their range; expected requests over "
            f"{100.0 * SLOW_RANGE:g} % of it that move by at most {100.0 * SLOW_SHARE:g} % of it "
            f"in {SLOW_TIME:g} s, up and down, such as excite's slow triangle; or give the unit "
            "of the actual angles",
        )
    basis = np.column_stack([np.ones_like(inputs), inputs, behind, speeds])
    line, *_ = np.linalg.lstsq(basis, counts)
    zero, slope, *_ = line.tolist()
    missed = float(np.std(counts - basis @ line)) / max(float(np.std(counts)), 1e-300)
    straight = 0.1  # share of their spread by which slow rows may miss a straight line, rms
    if not missed <= straight:
        raise rows.wrong(
            f"actual angles in counts are {100.0 * missed:.0f} % of their spread beside a straight "
            f"line of slow requests, expected at most {100.0 * straight:g} %; is this "
            "the sensor of this joint?",
        )
    fit = Scale(COUNTS, 1.0 / slope, -zero / slope, "rad")
    note = (
        f"a count of the actual angle is {np.degrees(fit.factor):.4g} degrees and {zero:.4g} "
        f"counts are a request of 0, by {len(inputs)} rows of slow requests; a constant offset "
        "of the joint cannot be seen"
    )
    return replace(rows, scales=(requested, fit), notes=(*rows.notes, note))


def _share(part: Array, whole: Array) -> float:
    """Range of a part of the requests over that of all; 0 for requests that never change."""
    return float(np.ptp(part) / np.ptp(whole)) if len(part) and np.ptp(whole) else 0.0


def _slow(times: Array, requests: Array) -> Mask:
    """Rows around which the requests are slow, and straight where enough of them are, (n,)."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

    period, span = float(np.median(np.diff(times))), float(np.ptp(requests))
    rows = 2 * math.ceil(SLOW_TIME / period) + 1
    ways = np.abs(np.diff(requests, prepend=requests[:1]))
    moved = rows * uniform_filter1d(ways, rows, mode="nearest")
    # a jump by a tenth of the range within the window is no slow motion, however short
    jumps = maximum_filter1d(ways, rows, mode="nearest") > 0.1 * span
    slow: Mask = (moved <= 2.0 * SLOW_SHARE * span) & ~jumps
    # straight where for 0.4 s to either side the speed changes by at most a tenth of the range a
    # second: friction that turns, and the delay, then do not count as scale
    far = max(1, round(0.2 / period))
    around = np.pad(requests, far, mode="edge")
    speeds = (around[2 * far :] - around[: -2 * far]) / (2.0 * far * period)
    highest, lowest = (each(speeds, 4 * far + 1) for each in (maximum_filter1d, minimum_filter1d))
    straight: Mask = slow & (highest - lowest <= 0.1 * span)
    return straight if _share(requests[straight], requests) >= SLOW_RANGE else slow


def _checked(rows: Rows, what: str, numbers: Array, scale: Scale) -> Array:
    """Numbers in the unit of their scale, all of them finite and of a likely size."""
    for k in np.flatnonzero(~np.isfinite(numbers))[:1].tolist():
        advice = "expected a finite number; remove or interpolate the sample"
        raise rows.fault(f"{what}: got {numbers[k]}, {advice}", k)
    values: Array = scale.factor * numbers + scale.shift
    largest = {"1": MOST_SHARE, "rad": LARGEST}.get(scale.unit, math.inf)
    for k in np.flatnonzero(np.abs(values) > largest)[:1].tolist():
        expected = IN_SHARES.get(scale.name, f"an angle in {scale.name}; check the unit")
        raise rows.fault(f"{what}: got {numbers[k]:g}, expected {expected}", k)
    return values


def _check_one_unit(rows: Rows, requests: Array, angles: Array) -> None:
    """Refuse a log in which one column alone, which the other follows, has another unit."""
    if len(angles) < 20:
        return
    spans = np.ptp(requests), np.ptp(angles)
    ratio = max(spans) / max(min(spans), 1e-300)
    if not 40.0 < ratio < 80.0:  # a radian has 57.3 degrees
        return
    latest = min(len(angles) // 2, round(0.5 / float(np.median(np.diff(rows.times)))))

    def follows(late: int) -> bool:
        (inputs, both), (_, outputs) = np.cov(requests[: len(requests) - late], angles[late:])
        return bool(both > 0.7 * np.sqrt(inputs * outputs))

    if not any(follows(late) for late in range(0, latest + 1, 1 + latest // 25)):
        return
    large, small = ROLES if spans[0] > spans[1] else ROLES[::-1]
    units = {role: of.name for role, of in zip(ROLES, rows.scales, strict=True)}
    if units[large] == "rad":
        wrong, named, held, units[large] = large, "radians", "degrees", "deg"
    elif units[small] == "deg":
        wrong, named, held, units[small] = small, "degrees", "radians", "rad"
    else:
        return
    option = ",".join(f"{column}={unit}" for column, unit in units.items())
    raise rows.wrong(
        f"the {large} angles span {ratio:.3g} times as much as the {small} ones: the {wrong} ones "
        f"are read as {named}, and are {held}; rename their column, or give "
        f"--unit {option} if the names have no unit"
    )


def _doubts(rows: Rows) -> tuple[str, ...]:
    """Signs of a wrong unit, in words."""
    doubts, sizes = list[str](), dict[str, dict[str, str]]()
    step = float(np.median(np.diff(rows.times)))
    if not FASTEST <= step < SPARSE:
        doubt = "is the unit of time right" if step < FASTEST else "are the times in seconds"
        doubts.append(f"one row every {step:.3g} s: {doubt}?")
    both = rows.requests, rows.angles
    for what, numbers, (unit, *_) in zip(ROLES, both, rows.scales, strict=True):
        span, largest = float(np.ptp(numbers)), float(np.abs(numbers).max())
        if unit == "rad" and not_radians(numbers):
            sizes.setdefault("reach {} rad: are they degrees?", {})[what] = f"{largest:.3g}"
        elif unit == "deg" and 0.0 < span < LEAST_DEG:
            sizes.setdefault("span only {} degrees: are they radians?", {})[what] = f"{span:.2g}"
    for words, of in sizes.items():
        size = " and ".join(dict.fromkeys(of.values()))
        doubts.append(Doubt(f"{' and '.join(of)} angles {words.format(size)}"))
    return tuple(doubts)
