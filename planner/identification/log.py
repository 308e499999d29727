"""What a robot recorded of one joint: when, what was requested, where the joint was."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.arrays import (
    LARGEST,
    TURN,
    Array,
    ReadOnly,
    Summarised,
    Summary,
    as_trajectory,
    check_choice,
    freeze,
    shown,
)
from planner.exceptions import InvalidInput, InvalidTrajectory

GAP = 10.0
"""Pause between rows, in median periods, after which nothing is assumed of what was requested."""

SUDDEN = 0.75 * TURN
"""A step between two rows beyond this [rad] is an encoder's that starts its next turn, where it is
too fast for a joint and about a whole turn."""

IMPOSSIBLE = 25.0
"""No joint is as fast as this [rad/s]: servos reach 20."""

UNITS = ("rad", "1")
"""What angles are in: radians, or shares of the joint's range where it is no angle."""

LATEST = 1e12  # times beyond this [s] are in another unit

SLOWEST, FASTEST = 2.0, 2e-5
"""A log with rows further apart than this [s], or closer, has probably another unit of time."""

FEWEST_ROWS = 3  # rows below which there is no motion to speak of


ONE_LOG = (
    "a planner.Log, a triple of arrays (times, requests, angles) or a mapping with the keys times, "
    "requests and angles"
)


class Doubt(str):
    """A note that asks whether the unit of a log's angles is right."""


class Written(NamedTuple):
    """How a file writes the angles of a log: angle = factor * number + shift."""

    path: str  # the file, or the dataset or bag
    episode: int | None  # of a dataset; None for a file of one recording
    column: str  # of the requested angles; "" where there are no columns by joint
    unit: str  # what the numbers are in, such as "deg", "ticks" or "percent"
    factor: float  # what one of them is [rad, or shares of a range]
    shift: float  # what their zero is [rad, or shares of a range]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Log(ReadOnly, Summarised):
    """Requested against actual angles of one joint; the arrays are read-only copies.

    Attributes:
        times: When each row was taken [s], strictly increasing, uneven allowed, shape (n,).
        requests: Request in force from that time on [rad], shape (n,).
        angles: Actual angle at that time [rad], shape (n,).
        torque_on: Whether the servo was powered, shape (n,); by default always.
        measured: Whether the angle was measured, shape (n,); by default always. Where it was not,
            such as after a failed read, the request counts and the angle, any finite one, does not.
        name: What to call the log in messages: a file, or anything else.
        joint: Name of the joint, or empty.
        unit: "rad" for angles, "1" for shares of a range (grippers, hands): everything that is
            said in radians then is a share.
        load: Torque on the joint in the direction of positive angles at that time [N m], shape
            (n,); between two rows their mean acts. None where it is not known.
        weights: Weight of each row's error in a fit, from 0 to 1, shape (n,); by default all are 1.
        notes: What was guessed when the log was read, in words.
        written: How the file wrote its requests, where it was read from one.

    Raises:
        InvalidTrajectory: Not finite, of unequal length, too short, or the time does not increase.
    """

    times: Array
    requests: Array
    angles: Array
    torque_on: npt.NDArray[np.bool_] = None  # type: ignore[assignment]  # always on
    name: str = "log"
    joint: str = ""
    unit: str = "rad"
    load: Array | None = None
    measured: npt.NDArray[np.bool_] = None  # type: ignore[assignment]  # always
    weights: Array = None  # type: ignore[assignment]  # all are 1
    notes: tuple[str, ...] = ()
    written: Written | None = None

    def _summarised(self) -> Summary:
        """Its name, rows, duration and rate."""
        joint = f" of {self.joint}" if self.joint else ""
        return Summary(
            f"Log {self.name!r}{joint}: {len(self.times)} rows in "
            f"{self.times[-1] - self.times[0]:.4g} s, one every {1e3 * self.period:.4g} ms"
        )

    def __post_init__(self) -> None:
        """Copy and check every column once."""
        for field in ("name", "joint"):
            value: Any = getattr(self, field)
            if not isinstance(value, str):
                raise InvalidTrajectory(f"log: {field}: got {shown(value)}, expected a text")
        columns = {"times": LATEST, "requests": LARGEST, "angles": LARGEST, "weights": 1.0}
        if self.load is not None:
            columns["load"] = LARGEST
        for column, largest in columns.items():
            value, named = getattr(self, column), f"{self.name}: {column}"
            if column == "weights" and value is None:
                value = np.ones(len(self.times))
            values = as_trajectory(value, name=named, minimum=FEWEST_ROWS, largest=largest)
            object.__setattr__(self, column, values)
        rows = len(self.times)
        if np.min(self.weights) < 0.0:
            raise InvalidTrajectory(
                f"{self.name}: weights: got {np.min(self.weights):g}, expected 0 to 1"
            )
        for column in ("torque_on", "measured"):
            value = getattr(self, column)
            try:
                flags = np.ones(rows, dtype=bool) if value is None else np.array(value, dtype=bool)
            except ValueError as error:
                raise InvalidTrajectory(
                    f"{self.name}: {column}: {error}; expected flags"
                ) from error
            freeze(flags)
            object.__setattr__(self, column, flags)
        if isinstance(self.notes, str) or not isinstance(self.notes, Sequence):
            raise InvalidTrajectory(
                f"{self.name}: notes: got {shown(self.notes)}, expected a list of texts"
            )
        object.__setattr__(self, "notes", tuple(self.notes))
        for column in (*columns, "torque_on", "measured"):
            shape = getattr(self, column).shape
            if shape != (rows,):
                raise InvalidTrajectory(
                    f"{self.name}: {column}: got shape {shape}, expected ({rows},), one a time"
                )
        check_choice(f"{self.name}: unit", self.unit, UNITS)
        back = np.flatnonzero(np.diff(self.times) <= 0.0)
        if back.size:
            row = int(back[0]) + 1
            raise InvalidTrajectory(
                f"{self.name}: times: got {self.times[row]:g} s in row {row} after "
                f"{self.times[row - 1]:g} s, expected strictly increasing times; sort the rows "
                "and leave out repeated ones"
            )

    @property
    def period(self) -> float:
        """Median time between rows [s]."""
        return float(np.median(np.diff(self.times)))


def as_logs(logs: Any) -> tuple[Log, ...]:
    """One or several logs, in whatever form they are at hand.

    A Log; a triple of arrays (times, requests, angles), or one array of shape (3, n); a mapping
    with these keys and any other field of Log; or several of such, in whatever can be iterated.
    InvalidTrajectory is raised where it is none of these, or :class:`Log` refuses a column.
    """
    none = isinstance(logs, np.ndarray) and logs.ndim == 0  # which only looks iterable
    if isinstance(logs, Iterable) and not isinstance(logs, Sequence | Mapping) and not none:
        logs = tuple(logs)
    if isinstance(logs, Log | Mapping) or _is_triple(logs):
        logs = (logs,)
    if not isinstance(logs, Sequence) or isinstance(logs, str | bytes) or not logs:
        raise InvalidTrajectory(
            f"logs: got {type(logs).__name__}, expected {ONE_LOG}, or a sequence of such; "
            "planner.read_logs reads files"
        )
    return tuple(_as_log(log, f"log {number}") for number, log in enumerate(logs, start=1))


def _is_triple(log: Any) -> bool:
    if not isinstance(log, Sequence) or isinstance(log, str | bytes) or len(log) != 3:
        return False
    return all(
        np.ndim(each) == 1 and not isinstance(each, Log | Mapping) and not _is_triple(each)
        for each in log
    )


def _as_log(log: Any, name: str) -> Log:
    if isinstance(log, Log):
        return log
    if _is_triple(log):
        times, requests, angles = log
        return Log(times=times, requests=requests, angles=angles, name=name)
    if not isinstance(log, Mapping):
        raise InvalidTrajectory(f"{name}: got {type(log).__name__}, expected {ONE_LOG}")
    missing = {"times", "requests", "angles"} - set(log)
    unknown = set(log) - set(Log.__dataclass_fields__)
    if missing or unknown:
        wrong = f"missing {sorted(missing)}" if missing else f"unknown {sorted(unknown)}"
        raise InvalidTrajectory(
            f"{name}: {wrong} among its keys, expected times, requests and angles"
        )
    return Log(**{"name": name, **log})


def check_periods(logs: Sequence[Log]) -> None:
    """Raise InvalidInput where rows are too close, or too far apart, to show how a joint moves."""
    for log in logs:
        if not FASTEST <= log.period <= SLOWEST:
            raise InvalidInput(
                f"{log.name}: one row every {log.period:.3g} s, expected one every {FASTEST:g} to "
                f"{SLOWEST:g} s, which show how a joint moves; give the times in seconds, or in a "
                "CSV say their unit: --time COLUMN:ms"
            )


def check_alike(logs: Sequence[Log]) -> None:
    """Raise InvalidInput where logs are of several joints, or in several units."""
    for name in ("unit", "joint"):
        found = sorted({getattr(log, name) for log in logs})
        if len(found) > 1:
            raise InvalidInput(
                f"logs: got {name}s {', '.join(map(repr, found))}, expected logs of one joint in "
                "one unit: identify each joint by itself"
            )


def pieces_of(log: Log) -> list[slice]:
    """Rows of a log between its gaps."""
    breaks = np.flatnonzero(np.diff(log.times) > GAP * log.period) + 1
    ends = [0, *breaks.tolist(), len(log.times)]
    return [slice(first, beyond) for first, beyond in pairwise(ends)]


def unwrapped(log: Log) -> tuple[Log, int]:
    """The log with angles that go on where the encoder started again, and how often it did.

    Requests may start again as well, or alone. They are made continuous too if that brings them
    nearer to the angles; the angles then take the turn in which they are nearest to the requests. A
    log that comes no nearer to its requests so, or that is a share of a range, stays as it is.
    """
    if log.unit != "rad":
        return log, 0
    rows = log.measured
    turns = _turns(log.times[rows], log.angles[rows])
    jumps = int(np.count_nonzero(np.diff(turns)))
    angles = log.angles.copy()
    angles[rows] += TURN * turns
    requests = min(
        (log.requests, *(np.unwrap(log.requests, discont=step) for step in (SUDDEN, 0.0))),
        key=lambda each: float(np.std((each - angles)[rows])),
    )
    if np.std((requests - angles)[rows]) >= np.std((log.requests - log.angles)[rows]):
        return log, 0
    if not jumps:  # the requests have to explain the motion then: a slow joint is far from them
        if np.std((requests - angles)[rows]) >= np.std(angles[rows]):
            return log, 0
        jumps = int(np.count_nonzero(np.round(np.diff(requests - log.requests) / TURN)))
    angles = angles + TURN * np.round(np.median((requests - angles)[rows]) / TURN)
    return replace(log, requests=requests, angles=angles), jumps


def _turns(times: Array, angles: Array) -> Array:
    """Turns to add to measured angles; none for glitches, which jump away and back in two rows.

    What is left of a step without its turns is motion of the joint, or noise.
    """
    from scipy.ndimage import median_filter

    steps, most = np.diff(angles), IMPOSSIBLE * np.diff(times)
    whole = np.round(steps / TURN)
    turned = np.abs(steps) > np.maximum(SUDDEN, most)
    turned &= np.abs(steps - TURN * whole) <= np.maximum(0.1 * TURN, most)
    turns: Array = np.concatenate([[0.0], -np.cumsum(np.where(turned, whole, 0.0))])
    if not turned.any():
        return turns
    lasting = median_filter(turns, 5, mode="nearest")
    return turns if np.ptp(lasting) > 0.0 else np.zeros_like(turns)
