"""Logs on the model's ticks: which rows count, and when which request was in force."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.identification.log import Log, pieces_of
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.model.kernel import Track


@dataclass(frozen=True, kw_only=True)
class ResamplingOptions:
    """Which rows count.

    Half and twice the values change nothing on seven reference logs (four made, three recorded;
    ``scripts/reference``), which have no glitches and no short runs.

    Attributes:
        fewest_used: Rows with torque below which a run tells nothing: its first angle is free.
        glitch_steps: A row that is off the median of five by more than so many of the largest
            steps that this median takes is no position of a joint. A real turning point is off
            by less than one such step.
        glitch_noise: Standard deviations of the noise that a row may be off in addition.
        noisy_rows: Share of the rows that may be faster than what counts as the highest speed.
        speed_over: Time over which the speed of a joint is measured [s]: noise and jitter of the
            times hardly count.
        on_a_tick: Rows this close to a tick [ticks] are taken to be on it.
    """

    fewest_used: int = 3
    glitch_steps: float = 2.0
    glitch_noise: float = 6.0
    noisy_rows: float = 0.002
    speed_over: float = 0.1
    on_a_tick: float = 1e-9


OPTIONS = ResamplingOptions()


Rows = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int_]
Place = tuple[int, int]
"""A row of a log: number of the log, number of the row."""


class Run(NamedTuple):
    """Rows in a row with torque, through which the joint is simulated without a break."""

    log: int
    rows: slice


@dataclass(frozen=True, eq=False)
class Grid:
    """Every run of some logs on ticks, one after another on one axis of time.

    The axis is cut between the pieces of a log that a gap separates, and between logs: there the
    first request of a piece is taken to have been in force for ``reach`` before it. A run of T
    ticks has T + 1 states, the first of which is its start.

    Attributes:
        tick: Time step [s].
        reach: Longest lag plus acceleration time that the axis leaves room for [s].
        edges: Times at which another request comes into force [s], increasing, shape (e,).
        requests: Request in force from each of them on [rad], shape (e,).
        ticks: Time of every tick after a start [s], shape (t,).
        states: Which state each tick leads to, shape (t,).
        starts: State in which each run starts, shape (runs,).
        before: State at or before each used row, shape (rows,).
        share: Weight of the state after it, in [0, 1), shape (rows,).
        run: Number of the run of each used row, shape (rows,).
        angles: Actual angle at each used row [rad], shape (rows,).
        firsts: For each run the first of its used rows in its log.
        places: For each log, which of its rows are used, in the same order, shape (n,) each.
        loads: Torque on the joint at every tick [N m], shape (t,); 0 where none is known.
    """

    tick: float
    reach: float
    edges: Array
    requests: Array
    ticks: Array
    states: Indices
    starts: Indices
    before: Indices
    share: Array
    run: Indices
    angles: Array
    firsts: tuple[Place, ...]
    places: tuple[Rows, ...]
    loads: Array

    @cached_property
    def track(self) -> Track:
        """What a joint is run along, for ``model/kernel.py``."""
        from planner.model.kernel import Track

        return Track(
            self.edges,
            self.requests,
            self.tick,
            self.ticks,
            self.loads,
            self.states,
            self.before,
            self.share,
        )

    def at_rows(self, states: Array) -> Array:
        """Values at the used rows, between ticks on a straight line; along the first axis."""
        after = np.minimum(self.before + 1, len(states) - 1)
        share = self.share.reshape(-1, *(1,) * (states.ndim - 1))
        return np.asarray((1.0 - share) * states[self.before] + share * states[after])

    @cached_property
    def times(self) -> Array:
        """Time of each used row on the axis [s], shape (rows,)."""
        at_states = np.zeros(len(self.ticks) + len(self.starts))
        at_states[self.states] = self.ticks
        at_states[self.starts] = at_states[self.starts + 1] - self.tick
        return self.at_rows(at_states)

    @property
    def measured_starts(self) -> Array:
        """Angle at the first used row of each run [rad], shape (runs,)."""
        return np.asarray(self.angles[np.searchsorted(self.run, np.arange(len(self.starts)))])

    @cached_property
    def span(self) -> float:
        """Difference between the largest and the least of requests and angles [rad]."""
        both = np.concatenate([self.requests, self.angles])
        return float(np.ptp(both)) or 1.0 if len(both) else 1.0

    def speed_exceeded_by(self, share: float) -> float:
        """Speed of the angles over five rows [rad/s] that this share of the rows exceeds."""
        far = min(5, len(self.times) - 1)
        same = self.run[far:] == self.run[: len(self.run) - far]
        steps = (self.times[far:] - self.times[: len(self.times) - far])[same]
        moved = np.abs(self.angles[far:] - self.angles[: len(self.angles) - far])[same]
        return float(np.quantile(moved / steps, 1.0 - share)) if len(steps) and far > 0 else 0.0

    @cached_property
    def fastest(self) -> float:
        """Highest speed of the joint but for single rows, which are noise [rad/s]."""
        return self.speed_exceeded_by(OPTIONS.noisy_rows)

    @cached_property
    def heaviest(self) -> float:
        """Largest torque [N m]; 1 without any."""
        return float(np.max(np.abs(self.loads), initial=0.0)) or 1.0

    def per_log(self, values: Array, fill: float = np.nan) -> tuple[Array, ...]:
        """Values of the used rows, sorted back into one array per log."""
        arrays, done = [], 0
        for used in self.places:
            array = np.full(len(used), fill)
            count = int(np.sum(used))
            array[used] = values[done : done + count]
            array.setflags(write=False)
            arrays.append(array)
            done += count
        return tuple(arrays)


def runs_of(logs: Sequence[Log], burn_in: float, settled: Collection[Place] = ()) -> list[Run]:
    """The runs of logs; where earlier requests are unknown the first ``burn_in`` [s] is left out.

    Torque that returns starts a run as well, but there the requests before it are in the log.
    """
    found = []
    for number, log in enumerate(logs):
        for piece in pieces_of(log):
            unknown = (
                0.0 if (number, piece.start) in settled else burn_in * (1.0 - OPTIONS.on_a_tick)
            )
            usable = log.torque_on & (log.times >= log.times[piece.start] + unknown)
            usable[: piece.start] = usable[piece.stop :] = False
            turns = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]])))
            found += [
                Run(number, slice(int(first), int(beyond)))
                for first, beyond in turns.reshape(-1, 2)
                if beyond - first >= OPTIONS.fewest_used
            ]
    return found


def glitches(angles: Array) -> Rows:
    """Rows that are no position of the joint: single or double jumps away and back."""
    if len(angles) < 5:
        return np.zeros(len(angles), dtype=bool)
    padded = np.concatenate([angles[1:3][::-1], angles, angles[-3:-1][::-1]])
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    off = np.abs(angles - middle)
    noise = float(np.quantile(off, 0.9)) / 1.645
    allowed = (
        OPTIONS.glitch_steps * float(np.max(np.abs(np.diff(middle)))) + OPTIONS.glitch_noise * noise
    )
    return np.asarray(off > allowed)


def sound_rows(log: Log) -> Rows:
    """Rows whose angle was measured, and is no glitch."""
    sound = np.array(log.measured)
    sound[log.measured] = ~glitches(log.angles[log.measured])
    return sound


def measured_speed(log: Log, among: Rows | None = None) -> float:
    """Highest mean speed over 0.1 s, or three rows of slower logs, with torque [rad/s].

    Of all rows, whether their requests are known or not: no joint is as fast in the mean as it can
    be, so that but for noise and for what pushes it this bounds its top speed from below.

    Args:
        log: The log.
        among: Only motion with some of these rows in it, shape (n,); by default all.
    """
    rows = np.flatnonzero(sound_rows(log) & log.torque_on)
    far = max(3, round(OPTIONS.speed_over / log.period))
    if len(rows) <= far:
        return 0.0
    times, angles = log.times[rows], log.angles[rows]
    steps, moved = times[far:] - times[:-far], np.abs(angles[far:] - angles[:-far])
    whole = steps <= 1.5 * far * log.period  # no gap between
    if among is not None:
        before = np.concatenate([[0], np.cumsum(among[rows])])
        whole &= before[far + 1 :] > before[: -far - 1]
    return float(np.max(moved[whole] / steps[whole], initial=0.0))


def resampled(
    logs: Sequence[Log],
    *,
    tick: float,
    reach: float,
    burn_in: float,
    settled: Collection[Place] = (),
) -> Grid:
    """Put the runs of the logs on ticks.

    Args:
        logs: The logs.
        tick: Time step [s].
        reach: Longest lag plus acceleration time that will be asked for [s].
        burn_in: How much of a piece is left out at its start [s].
        settled: Pieces, by log and first row, of which nothing is left out.

    Returns:
        The grid; without runs it has no ticks.
    """
    axis = _Axis(logs, reach)
    ticks: list[Array] = []
    states: list[npt.NDArray[np.int_]] = []
    starts: list[int] = []
    before: list[npt.NDArray[np.int_]] = []
    share: list[Array] = []
    loads: list[Array] = []
    number: list[npt.NDArray[np.int_]] = []
    used = tuple(np.zeros(len(log.times), dtype=bool) for log in logs)
    sound = [sound_rows(log) for log in logs]
    firsts: list[Place] = []
    total = 0
    for run in runs_of(logs, burn_in, settled):
        kept = np.flatnonzero(sound[run.log][run.rows]) + run.rows.start
        if len(kept) < OPTIONS.fewest_used:
            continue
        used[run.log][kept] = True
        times = axis.shifted[run.log][kept]
        places: Array = (times - times[0]) / tick
        whole = np.round(places)
        places = np.where(
            np.abs(places - whole) <= OPTIONS.on_a_tick * np.maximum(1.0, whole), whole, places
        )
        count = int(np.ceil(places[-1]))
        below = np.minimum(np.floor(places).astype(int), count - 1)
        ticks.append(times[0] + tick * np.arange(1, count + 1))
        loads.append(_torques(logs[run.log], axis.shifted[run.log], ticks[-1], tick))
        states.append(total + np.arange(1, count + 1))
        starts.append(total)
        firsts.append((run.log, int(kept[0])))
        before.append(total + below)
        share.append(places - below)
        number.append(np.full(len(times), len(starts) - 1))
        total += count + 1
    return Grid(
        tick=tick,
        reach=reach,
        edges=axis.edges,
        requests=axis.requests,
        ticks=_joined(ticks),
        states=_joined(states).astype(int),
        starts=np.array(starts, dtype=int),
        before=_joined(before).astype(int),
        share=_joined(share),
        run=_joined(number).astype(int),
        angles=_joined([log.angles[rows] for log, rows in zip(logs, used, strict=True)]),
        firsts=tuple(firsts),
        places=used,
        loads=_joined(loads),
    )


def _torques(log: Log, times: Array, ticks: Array, tick: float) -> Array:
    """Torque at ticks of a log [N m]: that of the row which ends the time it acts in."""
    if log.load is None:
        return np.zeros(len(ticks))
    rows = np.searchsorted(times, ticks - OPTIONS.on_a_tick * tick)
    return np.asarray(log.load[np.minimum(rows, len(times) - 1)])


class _Axis:
    """One axis of time for all pieces of all logs, and the requests on it."""

    def __init__(self, logs: Sequence[Log], reach: float) -> None:
        edges: list[Array] = []
        requests: list[Array] = []
        self.shifted: list[Array] = []
        now = 0.0
        for log in logs:
            shifted = np.array(log.times)
            for piece in pieces_of(log):
                now += 2.0 * reach
                shifted[piece] += now - log.times[piece.start]
                edges += [np.array([now - 2.0 * reach]), shifted[piece]]
                requests += [log.requests[piece][:1], log.requests[piece]]
                now = float(shifted[piece][-1])
            self.shifted.append(shifted)
        every, values = _joined(edges), _joined(requests)
        changes = np.concatenate([[True], np.diff(values) != 0.0])
        self.edges, self.requests = every[changes], values[changes]


def _joined(arrays: Sequence[npt.NDArray[Any]]) -> Array:
    return np.concatenate(arrays) if arrays else np.zeros(0)
