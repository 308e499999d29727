"""Paths over time as CSV: angles or requests of joints, positions of a foot, knots of curves.

A joint path has one ``<joint>_deg`` or ``<joint>_rad`` column per joint, or ``<joint>_percent`` or
``<joint>_range`` (0 to 1) where only the share of its range is known. Its columns
``<joint>_load_Nm`` are torques on these joints in the direction of positive angles. A foot path has
the columns ``x_m, y_m, z_m`` (or ``_cm``, ``_mm``). Both may have times, as logs have them
(:mod:`planner.files.columns`): ``t_s``, ``time_ms``, ``stamp_ns``, dates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.arrays import MOST_SAMPLES, Array, read_only
from planner.exceptions import InvalidFile, InvalidInput, nearest
from planner.files.columns import (
    IN_SHARES,
    JOINT_UNITS,
    LENGTHS,
    MOST_SHARE,
    SHARES,
    TIME,
    check_increasing,
    check_radians,
    clock_of,
    pairs,
    pick,
    read_clock,
    split_unit,
    time_columns,
    with_unit,
)
from planner.files.staging import writing
from planner.files.table import Table, read_table, write_table

LOAD = "_load_Nm"  # ending of the columns that hold the torque on a joint [N m]
MOST_JOINTS = 1000  # joints of a path, each a plan of its own
UNEVEN = 0.01  # share by which a time step may differ from the period: clocks have few decimals
AXES = ("x", "y", "z")  # axes of a foot's positions


@dataclass(frozen=True)
class SampledPath:
    """Angles or requests of joints, or positions of a foot, over time."""

    path: str  # where it came from; `-` is standard input
    names: tuple[str, ...]  # of the joints; `AXES` of a foot
    units: tuple[str, ...]  # units in the file; `.SHARES` are of joints without angles
    values: Array  # [rad, m], shape (n, k), read-only; a percent is carried as a degree
    times: Array | None  # times of the samples [s], shape (n,); None where the file does not say

    # torques on the joints [N m], shape (n, k), read-only, 0 for a joint without a column; None
    # where no joint has one
    loads: Array | None = None

    @property
    def step(self) -> float:
        """Mean time between the samples [s]; NaN where the file does not say."""
        if self.times is None:
            return math.nan
        return float(self.times[-1] - self.times[0]) / (len(self.times) - 1)

    def check_period(self, period: float, advice: str = "", first: str = "") -> None:
        """Raise InvalidFile, with ``first`` words, unless ``period`` [s] is that of the samples."""
        advice = advice or (
            f"plan with --rate-hz {1.0 / period:.6g} to resample the path, or with --rate-hz "
            f"{1.0 / self.step:.6g} to send as many requests, or set tick and hold in the model"
        )
        check_step(self.path, self.step, period, advice, f"{first}one sample")

    def in_step(
        self, period: float, first: str = "", *, resample: bool, cyclic: bool, speed: float | None
    ) -> SampledPath:
        """The path with a sample every ``period`` [s], as without times: resampled, or checked."""
        farthest = 5.0  # [s]; times in milliseconds are a thousand times as long
        if self.step > farthest:
            words = f"one sample every {self.step:.6g} s, expected one every {farthest:g} s"
            advice = "give the times in seconds, or call a column of milliseconds t_ms"
            raise InvalidFile(self.path, f"{words} or more often; {advice}")
        if speed is None and (self.times is None or not resample):
            self.check_period(period, first=first)
            return self
        times = period * np.arange(float(len(self.values))) if self.times is None else self.times
        values, *loads = (
            resampled(times, rows, period * (speed or 1.0), cyclic=cyclic)
            for rows in (self.values, self.loads)
            if rows is not None
        )
        even = period * np.arange(float(len(values)))
        return replace(self, times=even, values=values, loads=loads[0] if loads else None)

    def check_samples(self, samples: int) -> None:
        """Raise InvalidFile unless these are the requests of a path of so many samples."""
        if (count := len(self.values)) != samples:
            expected = f"expected {samples}, one for each sample of the desired path"
            advice = "name the path for which they were planned"
            raise InvalidFile(self.path, f"got {count} requests, {expected}; {advice}")


def check_step(path: str, step: float, period: float, advice: str, row: str) -> None:
    """Raise InvalidFile if rows, ``step`` [s] apart, are not ``period`` apart, as requests are."""
    if abs(step - period) > UNEVEN * period:
        expected = f"expected one every {period:.6g} s, the time between requests"
        raise InvalidFile(path, f"{row} every {step:.6g} s, {expected}; {advice}")


def path_table(path: Path | str) -> Table:
    """Read a table of at most as many rows as a path may have samples; see :func:`.read_table`."""
    return read_table(path, most_rows=MOST_SAMPLES)


def read_joint_path(path: Path | str, *, joints: Sequence[str] = ()) -> SampledPath:
    """Read a joint path from CSV, or from standard input for ``-``: the named joints, or all."""
    return joint_path(path_table(path), joints=joints)


def joint_path(table: Table, *, joints: Sequence[str] = (), even: bool = True) -> SampledPath:
    """Parse a table as a path of the named joints, or of all columns but times and numbers."""
    if joints:
        columns = pick(
            table, joints, JOINT_UNITS, advice="rename a column, or choose joints with --joint"
        )
    else:
        for pair in pairs(table.names):
            if pair.requested and pair.actual:
                raise table.fault(
                    f"'{pair.requested[0]}' and '{pair.actual[0]}' are columns of a log, expected "
                    "a path, with one column for each joint; request-planner identify reads logs, "
                    "and --joint takes single columns as a path"
                )
        no_joints = {*time_columns(table.names), "index", "sample"}  # which number the rows
        columns = [name for name in table.names if not (name in no_joints or name.endswith(LOAD))]
    problem, titles = "", "columns <joint>_deg or <joint>_rad"
    if not joints and is_foot_path(table):
        advice = "request-planner plan makes such from it"
        problem = f"a foot path, expected joint angles in {titles}; {advice}"
    elif not columns:
        problem = f"only {', '.join(table.names)}; expected {titles}"
    elif len(columns) > MOST_JOINTS:
        problem = f"{len(columns)} joints, expected at most {MOST_JOINTS}; choose some with --joint"
    if problem:
        raise table.fault(problem)
    names, units, values = with_unit(table, columns, JOINT_UNITS)
    for column, name, unit, angles in zip(columns, names, units, values.T, strict=True):
        if unit == "rad":
            check_radians(table, column, angles, f"rename it {name}_deg")
        for k in np.flatnonzero((unit in SHARES) & (np.abs(angles) > MOST_SHARE * SHARES["range"])):
            words = f"got {angles[k] / SHARES[unit]:g}, expected {IN_SHARES[unit]}"
            raise table.fault(f"column '{column}': {words}", int(k))
    loaded = [name.removesuffix(LOAD) for name in table.names if name.endswith(LOAD)]
    for name in [name for name in loaded if not joints and name not in names]:
        words = f"no joint '{name}'{nearest(name, names)}; joints: {', '.join(names)}"
        raise table.fault(f"column '{name}{LOAD}': {words}")
    loads = None
    if own := [j for j, name in enumerate(names) if name in loaded]:
        loads = np.zeros_like(values)
        loads[:, own] = table.numbers([f"{names[j]}{LOAD}" for j in own])
        read_only(loads)
    return SampledPath(str(table.path), names, units, values, read_times(table, even=even), loads)


def write_joint_path(
    path: Path | str,
    names: Sequence[str],
    angles: Array,
    *,
    period: float,
    units: Sequence[str] | None = None,
    loads: Array | None = None,
) -> None:
    """Write angles [rad] and torques [N m], (n, k), as CSV: shares of a range, or degrees."""
    endings = [unit if unit in SHARES else "deg" for unit in units or ["deg"] * len(names)]
    titles = [f"{name}_{unit}" for name, unit in zip(names, endings, strict=True)]
    rows = angles / [JOINT_UNITS[unit] for unit in endings]
    if loads is not None:
        titles += [f"{name}{LOAD}" for name in names]
        rows = np.hstack([rows, loads])
    write_samples(path, titles, rows, period=period)


def is_foot_path(table: Table) -> bool:
    """Whether a table has a position along an axis, as foot paths have."""
    parts = [split_unit(name, LENGTHS) for name in table.names]
    return any(part is not None and part[0] in AXES for part in parts)


def foot_path(table: Table, *, even: bool = True) -> SampledPath:
    """Parse a table as a foot path, whose times must be evenly spaced if ``even``."""
    columns = pick(table, AXES, LENGTHS, advice="rename the column, or add it")
    _, units, positions = with_unit(table, columns, LENGTHS)
    return SampledPath(str(table.path), AXES, units, positions, read_times(table, even=even))


def write_foot_path(path: Path | str, positions: Array, *, period: float) -> None:
    """Write positions [m], shape (n, 3), one every ``period`` [s], as CSV."""
    write_samples(path, [f"{axis}_m" for axis in AXES], positions, period=period)


def write_samples(path: Path | str, titles: Sequence[str], rows: Array, *, period: float) -> None:
    """Write rows, (n, len(titles)), one every ``period`` [s], as CSV with their times."""
    times = period * np.arange(len(rows))
    write_table(path, [TIME, *titles], np.column_stack([times, rows]))


def write_curve(path: Path | str, curve: PiecewiseLinear, *, unit: str = "deg") -> None:
    """Write the knots of a curve as CSV, in degrees or percent."""
    columns = np.column_stack([curve.knots * curve.tick, np.degrees(curve.values)])
    write_table(path, ["knot_s", f"value_{unit}"], columns)


def read_times(table: Table, *, even: bool = True) -> Array | None:
    """Times of the samples [s], shape (n,); None where no column may hold them."""
    clock = clock_of(table, advice="keep one of them, or ")
    if clock is None:
        return None
    times, _ = read_clock(table, *clock)
    check_increasing(times, table.fault)
    steps = np.diff(times)
    period = float(np.median(steps))
    uneven = np.abs(steps - period) > UNEVEN * period
    if even and uneven.any():
        k = int(np.argmax(uneven)) + 1
        words = f"{clock[0]} advances by {steps[k - 1]:g} s where most steps are {period:g} s"
        advice = "expected even steps; plan with --rate-hz to resample the path"
        raise table.fault(f"{words}, {advice}", k)
    return times


def resampled(times: Array, rows: Array, period: float, *, cyclic: bool) -> Array:
    """Rows (n, k) at increasing times [s], (n,), at even times from the first on, linearly.

    A cycle lasts one mean step longer; it is stretched to a whole number of samples.
    """
    since = times - times[0]
    span = float(since[-1])
    if span / period > MOST_SAMPLES:
        most = f"expected at most {MOST_SAMPLES} samples; ask for a lower rate"
        raise InvalidInput(f"a sample every {period:g} s for {span:g} s: {most}")
    if cyclic:
        whole = span * len(times) / (len(times) - 1)
        count = max(round(whole / period), 1)
        at = np.arange(count) * (whole / count)
        since, rows = np.append(since, whole), np.vstack([rows, rows[:1]])
    else:
        at = np.arange(math.floor(span / period + UNEVEN) + 1) * period
    return read_only(np.column_stack([np.interp(at, since, column) for column in rows.T]))


@contextmanager
def growing_log(
    path: Path | str,
    names: Sequence[str],
    *,
    kinds: Sequence[str] = ("requested", "actual"),
    units: Mapping[str, str] = {},
) -> Iterator[Callable[..., None]]:
    """A CSV of the joints' angles that has every row as soon as it was measured.

    It is written as ``NAME.part``, and gets its name at the end of the block. The function in the
    block writes a row: a time [s], and of each kind the angles [rad], NaN where there is none. The
    ``units`` are those of :func:`.shown_units`, by default degrees.
    """
    unfinished, rows = Path(f"{path}.part"), 0

    def write(*cells: str) -> None:
        with writing(unfinished):
            file.write(",".join(cells) + "\n")
            file.flush()

    def keep(time: float, *of_kinds: Array) -> None:
        nonlocal rows
        angles = np.degrees(np.column_stack(of_kinds)).round(6) + 0.0  # no negative zero
        cells = ("" if math.isnan(each) else f"{each:.6f}" for each in angles.ravel().tolist())
        write(f"{time:.6f}", *cells)
        rows += 1

    with writing(unfinished):
        unfinished.parent.mkdir(parents=True, exist_ok=True)
        file = unfinished.open("w", encoding="utf-8", newline="\n")
    try:
        with file:
            columns = (
                "_".join(filter(None, (name, kind, units.get(name, "deg"))))
                for name in names
                for kind in kinds
            )
            write(TIME, *columns)
            yield keep
        if rows:
            unfinished.replace(path)
    finally:
        if not rows:
            unfinished.unlink(missing_ok=True)
