"""Logs on the model's ticks: their clock, which rows count, which request was in force when."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, Indices, Mask, as_number, as_whole, rms, shown, stretches
from planner.exceptions import InvalidInput
from planner.identification.log import Log, pieces_of
from planner.model.joint import MOST_HOLD, MOST_TERMS
from planner.model.response import load_by_period

if TYPE_CHECKING:
    from planner.model.kernel import Track

SURE = 3.0  # standard deviations by which a period estimated from uneven pauses may be off
FEWEST_USED = 3  # rows with torque below which a run tells nothing: its first angle is free

MOST_ROWS = 20_000
"""About how many rows :func:`thinned` logs have, by which ticks and terms are chosen. (Of five logs
of 100,000 rows one is predicted 88 % worse held out with half; twice: the same, in 1.5 times the
time.)"""

ON_A_TICK = 1e-9  # rows this close to a tick [ticks] are taken to be on it

Place = tuple[int, int]  # a row of a log: number of the log, number of the row


class Timing(NamedTuple):
    """Ticks and periods."""

    period: float  # between the rows of all logs [s]
    tick: float  # time step of the model [s]
    hold: int  # ticks in a period
    reach: float  # longest lag plus acceleration time of the search [s]

    def ticking(self, tick: float) -> Timing:
        """The same with ticks of about this length [s], a whole number in a period."""
        hold = round(self.period / tick)
        return self._replace(tick=self.period / hold, hold=hold)


def timing_of(logs: Sequence[Log], *, tick: float | None, hold: int | None) -> Timing:
    """The ticks of the logs, as requested or by default; InvalidInput where these contradict."""
    pauses = np.concatenate([np.diff(log.times) for log in logs])
    median = float(np.median(pauses))
    mean = mean_period(pauses, median)
    period = mean if all(_keeps_to(mean, log.times) for log in logs) else median
    unsure = SURE * min(float(np.std(pauses)) / math.sqrt(len(pauses)), 0.01 * period)
    period = round(period, 9) or period  # differences of times that count up are no better
    plain = float(f"{period:.3g}")  # of 100 Hz with jitter no 99.9981 Hz is known
    if abs(plain - period) <= 3.0 * float(np.std(pauses)) / len(pauses):
        period = plain
    longest = max(float(log.times[-1] - log.times[0]) for log in logs)
    reach = max(min(max(50.0 * period, 0.75), 0.25 * longest), 4.0 * period)
    step = math.nan if tick is None else as_number(tick)
    if tick is not None and not step > 0.0:
        raise InvalidInput(f"tick: got {shown(tick)}, expected a time of more than 0 s")
    count = as_whole(hold) or 0
    if hold is None:
        whole = round(period / max(step, 1e-300)) if tick is not None else 1
        # Ticks of about 5 ms, with which the terms of a joint are sought: the fit ends at
        # :func:`fine_hold`. One a row for the paper's robot and faster logs, and at most 20: logs
        # of less than 10 rows a second do not show what more would. 20.06 and 20.55 ms are 4 ticks.
        if tick is None and period > 1.05 * 0.008:
            whole = min(math.ceil(period / (1.05 * 0.005)), 20)
        hold = count = max(whole, 1)
        if count > MOST_HOLD:
            least = f"{1e3 * period / MOST_HOLD:.6g} ms, the log's period over {MOST_HOLD}"
            raise InvalidInput(f"tick: got {1e3 * step:g} ms, expected at least {least}")
    if not 1 <= count <= MOST_HOLD:
        raise InvalidInput(
            f"hold: got {shown(hold)}, expected a whole number of ticks, 1 or more, to {MOST_HOLD}"
        )
    made = period / count if tick is None else step
    if abs(made * count - period) > 1e-3 * period + unsure:
        raise InvalidInput(
            f"tick, hold: got {count} x {1e3 * made:g} ms, expected the log's period of "
            f"{1e3 * period:g} ms; give a tick that divides it, or neither of the two"
        )
    return Timing(made * count, made, count, reach)


def unequal(logs: Sequence[Log]) -> bool:
    """Whether logs are of several clocks."""
    periods = [log.period for log in logs]
    return max(periods) > 1.05 * min(periods)


def mean_period(pauses: Array, median: float) -> float:
    """The mean of pauses that are about whole numbers of their median, up to ten [s]."""
    period = median
    for _ in range(3):
        whole = np.round(pauses / period)
        near = (whole >= 1.0) & (whole <= 10.0)
        near &= np.abs(pauses - whole * period) <= 0.4 * period
        if near.any():
            period = float(np.sum(pauses[near]) / np.sum(whole[near]))
    return period


def _keeps_to(period: float, times: Array) -> bool:
    """Whether times stay with a clock of this period, as those do that jitter or are rounded.

    Those of a loop that is late now and then do not: most pauses are as long as their median.
    """
    whole = np.round(np.diff(times) / period)
    apart = np.diff(times) - whole * period
    beside = np.concatenate([[0.0], np.cumsum(apart)])
    rows = np.arange(len(times)) - (len(times) - 1) / 2.0
    wandering = np.std(beside - rows * (rows @ beside) / (rows @ rows))  # about a straight line
    return bool(wandering <= np.std(apart))


def fine_hold(period: float, window: float) -> int:
    """Ticks of about 1 ms in a period [s], at most 20, and fewer for a long window [s].

    With ticks of 5 ms v_max / theta_0 comes out 4 % too small, and the lag 3 ms too long. The
    weights of a window that is twice as long still make a model (``MOST_TERMS``).
    """
    most = math.isqrt(int(0.5 * MOST_TERMS * period / max(window, period)))
    return max(min(round(period / 0.001), 20, most), 1)


def evenly_timed(logs: Sequence[Log], period: float) -> tuple[tuple[Log, ...], float]:
    """The logs with each row at the next whole period, and by how much times were off [s], rms.

    The period is that of all pieces together, or ``period`` where the times agree with it.
    """
    lines = []
    for log in logs:
        for piece in pieces_of(log):
            steps = np.maximum(np.floor(np.diff(log.times[piece]) / period + 0.3), 1.0)
            places = np.concatenate([[0.0], np.cumsum(steps)])
            since = log.times[piece] - log.times[piece.start]
            lines.append((places - np.mean(places), since - np.mean(since)))
    places, since = (np.concatenate(column) for column in zip(*lines, strict=True))
    weight = max(float(places @ places), 1.0)
    slope = float(places @ since) / weight
    unsure = float(np.std(since - slope * places)) / np.sqrt(weight)
    if abs(slope - period) <= SURE * unsure:
        slope = period
    off = slope * places - since
    ends = np.cumsum([len(log.times) for log in logs])[:-1]
    moved = [log.times + own for log, own in zip(logs, np.split(off, ends), strict=True)]
    if any(np.any(np.diff(times) <= 0.0) for times in moved):
        return tuple(logs), 0.0
    pairs = zip(logs, moved, strict=True)
    return tuple(replace(log, times=times) for log, times in pairs), rms(off)


@dataclass(frozen=True, eq=False)
class Grid:
    """Every run of some logs on ticks, one after another on one axis of time.

    The first request of a piece is taken to have been in force for ``reach`` before it. A run of T
    ticks has T + 1 states, the first of which is its start.
    """

    tick: float  # time step [s]
    reach: float  # longest lag plus acceleration time that the axis leaves room for [s]
    edges: Array  # times at which another request comes into force [s], increasing, (e,)
    requests: Array  # request in force from each of them on [rad], (e,)
    ticks: Array  # time of every tick after a start [s], (t,)
    states: Indices  # which state each tick leads to, (t,)
    starts: Indices  # state in which each run starts, (runs,)
    before: Indices  # state at or before each used row, (rows,)
    share: Array  # weight of the state after it, in [0, 1), (rows,)
    run: Indices  # number of the run of each used row, (rows,)
    times: Array  # of each used row on the axis [s], (rows,)
    angles: Array  # actual angle at each used row [rad], (rows,)
    weights: Array  # of its error in the loss, from 0 to 1, (rows,)
    firsts: tuple[Place, ...]  # for each run the first of its used rows in its log
    places: tuple[Mask, ...]  # for each log which of its rows are used, in the same order, (n,)
    loads: Array  # torque on the joint at every tick [N m], 0 where none is known, (t,)
    unloaded: bool  # no log has a torque, all have angles: gravity may be a sag by the angle
    burn_in: float  # how much of a piece is left out at its start [s]
    settled: frozenset[Place]  # pieces of which nothing is left out
    logs: tuple[Log, ...]

    @cached_property
    def track(self) -> Track:
        """What a joint is run along, for ``model/kernel.py``."""
        from planner.model.kernel import Track

        return Track(*(getattr(self, name) for name in Track._fields))

    @cached_property
    def first_rows(self) -> Indices:
        """The first used row of each run, or of the next one that has any, shape (runs,)."""
        return np.searchsorted(self.run, np.arange(len(self.starts)))

    @property
    def measured_starts(self) -> Array:
        """Angle at the first used row of each run [rad], shape (runs,)."""
        return np.asarray(self.angles[self.first_rows])

    @cached_property
    def span(self) -> float:
        """Difference between the largest and the least of requests and angles [rad]."""
        both = np.concatenate([self.requests, self.angles])
        return float(np.ptp(both)) or 1.0 if len(both) else 1.0

    @cached_property
    def signal(self) -> float:
        """Standard deviation of the angles about their mean in each run [rad]."""
        runs = len(self.starts)
        means = np.bincount(self.run, self.angles, runs) / np.bincount(self.run, minlength=runs)
        return rms(self.angles - means[self.run])

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
        return self.speed_exceeded_by(0.002)

    @cached_property
    def heaviest(self) -> float:
        """Largest torque [N m]; 1 without any."""
        return float(np.max(np.abs(self.loads), initial=0.0)) or 1.0

    def per_log(self, values: Array, fill: float = np.nan) -> tuple[Array, ...]:
        """Values of the used rows, sorted back into one array per log."""
        arrays = tuple(np.full(len(used), fill) for used in self.places)
        ends = np.cumsum([np.sum(used) for used in self.places])[:-1]
        for array, used, own in zip(arrays, self.places, np.split(values, ends), strict=True):
            array[used] = own
        return arrays


def glitches(angles: Array) -> Mask:
    """Rows that are off the median of five by more than a joint can be: jumps away and back.

    That is twice the largest step of this median, and six standard deviations of the noise.
    """
    from scipy.ndimage import median_filter

    if len(angles) < 5:
        return np.zeros(len(angles), dtype=bool)
    middle = median_filter(angles, 5, mode="mirror")
    off = np.abs(angles - middle)
    noise = float(np.quantile(off, 0.9)) / 1.645
    return np.asarray(off > 2.0 * float(np.max(np.abs(np.diff(middle)))) + 6.0 * noise)


def excursions(times: Array, angles: Array) -> Mask:
    """Runs of rows, of any length, to which no joint can have jumped and from which it returns.

    Such as failed readings. A run is shorter than those before and after it. No joint is as fast as
    25 rad/s, but where a log has many faster steps; servos reach 20.
    """
    found = np.zeros(len(angles), dtype=bool)
    if len(angles) < 5:
        return found
    pauses, steps = np.diff(times), np.abs(np.diff(angles))
    speed = max(25.0, 2.0 * float(np.quantile(steps / pauses, 0.95)))
    noise = 1.5 * float(np.quantile(np.abs(np.diff(angles, 2)), 0.9))  # six standard deviations
    jumps = np.flatnonzero(steps > speed * pauses + noise) + 1
    rows_after = np.diff(np.append(jumps, len(angles)))
    since = 0
    for k, first in enumerate(jumps[:-1].tolist()):
        if first <= since:  # in a run that was found
            continue
        back = jumps[k + 1 :]
        away = np.abs(angles[back] - angles[first - 1])
        near = away <= speed * (times[back] - times[first - 1]) + noise
        short = back - first < np.minimum(first - since, rows_after[k + 1 :])
        since = first
        if (returns := back[near & short]).size:
            since = int(returns[0])
            found[first:since] = True
    return found


def sound_rows(log: Log) -> Mask:
    """Rows whose angle was measured, and is one that the joint can have had."""
    sound = np.array(log.measured)
    sound[sound] = ~excursions(log.times[sound], log.angles[sound])
    sound[sound] = ~glitches(log.angles[sound])
    return sound


def thinned(logs: Sequence[Log]) -> tuple[Log, ...]:
    """Some stretches of logs of twice :data:`MOST_ROWS` and more; shorter ones as they are.

    Of each group of stretches two are kept, the other rows are as if without torque: that with the
    largest steps of requests and loads, which may alone show a limit, and one by an additive
    sequence of the golden ratio. (Without the half second that is left out, in which the unknown
    speed at the start of a stretch matters, the log of a motor takes 1.6 times as long.)
    """
    torque = np.concatenate([log.torque_on for log in logs])
    size = 2 * (int(np.sum(torque)) // MOST_ROWS)  # of a group [stretches]
    if size < 4:
        return tuple(logs)
    length = max(500, *(round(4.0 / log.period) for log in logs))
    stretches = (np.cumsum(torque) - torque) // length
    groups = np.arange(stretches[-1] // size + 1)
    steps = np.concatenate([np.diff(log.requests, prepend=log.requests[0]) for log in logs])
    loads = np.concatenate(
        [np.zeros(len(log.times)) if log.load is None else log.load for log in logs]
    )
    steps, loads = (each**2 / (np.mean(each**2) or 1.0) for each in (steps, loads))
    lively = np.bincount(stretches, torque * (steps + loads), size * len(groups)).reshape(-1, size)
    kept = np.zeros(lively.shape, dtype=bool)
    kept[groups, np.argmax(lively, axis=1)] = True
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    kept[groups, (size * (golden * groups % 1.0)).astype(int)] = True
    ends = np.cumsum([len(log.times) for log in logs])[:-1]
    found = []
    for log, on in zip(logs, np.split(torque & kept.ravel()[stretches], ends), strict=True):
        rows = np.arange(len(on))
        cut = on & np.append(False, log.torque_on[:-1] & ~on[:-1])
        last = np.maximum.accumulate(np.where(cut, rows, -1))
        settling = (last >= 0) & (rows > last) & (rows - last < 0.5 / log.period)
        found.append(replace(log, torque_on=on, measured=log.measured & ~settling))
    return tuple(found)


def measured_speed(log: Log, among: Mask | None = None) -> float:
    """Highest mean speed over 0.1 s, or three rows of slower logs, with torque [rad/s].

    It bounds the top speed of a joint that nothing pushes from below. Only motion with some of the
    rows ``among`` in it counts, by default all.
    """
    rows = np.flatnonzero(sound_rows(log) & log.torque_on)
    far = max(3, round(0.1 / log.period))
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
    """Put the runs of the logs, rows in a row with torque, on ticks: see :class:`Grid`.

    Where earlier requests are unknown the first ``burn_in`` [s] is left out.
    """
    used = tuple(np.zeros(len(log.times), dtype=bool) for log in logs)
    firsts: list[Place] = []
    edges: list[Array] = []
    requests: list[Array] = []
    runs = []  # ticks, torques there, tick before each row, share after it, time of the row
    now = 0.0
    for number, log in enumerate(logs):
        torque = load_by_period(log.load, cyclic=False)
        for piece in pieces_of(log):
            now += 2.0 * reach
            every = log.times[piece] + (now - log.times[piece.start])
            edges += [np.array([now - 2.0 * reach]), every]
            requests += [log.requests[piece][:1], log.requests[piece]]
            now = float(every[-1])
            unknown = 0.0 if (number, piece.start) in settled else burn_in * (1.0 - ON_A_TICK)
            known = log.times[piece] >= log.times[piece.start] + unknown
            for rows in stretches(log.torque_on[piece] & known):
                kept = np.flatnonzero(log.measured[piece][rows]) + rows.start
                if len(kept) < FEWEST_USED:
                    continue
                used[number][piece][kept] = True
                firsts.append((number, piece.start + int(kept[0])))
                times = every[kept]
                places: Array = (times - times[0]) / tick
                whole = np.round(places)
                on_a_tick = np.abs(places - whole) <= ON_A_TICK * np.maximum(1.0, whole)
                places = np.where(on_a_tick, whole, places)
                count = int(np.ceil(places[-1]))
                below = np.minimum(np.floor(places).astype(int), count - 1)
                ticks = times[0] + tick * np.arange(1, count + 1)
                ending = np.searchsorted(every, ticks - ON_A_TICK * tick)  # the row of a torque
                ending = np.minimum(ending, len(every) - 1)
                torques = np.zeros(count) if torque is None else torque[piece][ending]
                runs.append((ticks, torques, below, places - below, times))
    every, values = _joined(edges), _joined(requests)
    changes = np.concatenate([[True], np.diff(values) != 0.0])
    states = np.cumsum([0, *(len(run[0]) + 1 for run in runs)])
    starts = states[:-1]
    run = np.repeat(np.arange(len(runs)), [len(run[2]) for run in runs])
    return Grid(
        tick=tick,
        reach=reach,
        edges=every[changes],
        requests=values[changes],
        ticks=_joined([run[0] for run in runs]),
        states=np.delete(np.arange(states[-1]), starts),
        starts=starts,
        before=starts[run] + _joined([run[2] for run in runs]).astype(int),
        share=_joined([run[3] for run in runs]),
        run=run,
        times=_joined([run[4] for run in runs]),
        angles=_joined([log.angles[rows] for log, rows in zip(logs, used, strict=True)]),
        weights=_joined([log.weights[rows] for log, rows in zip(logs, used, strict=True)]),
        firsts=tuple(firsts),
        places=used,
        loads=_joined([run[1] for run in runs]),
        unloaded=all(log.load is None and log.unit == "rad" for log in logs),
        burn_in=burn_in,
        settled=frozenset(settled),
        logs=tuple(logs),
    )


def resampled_like(grid: Grid, logs: Sequence[Log], tick: float) -> Grid:
    """Other rows, or ticks [s], with the reach, burn-in and settled pieces of a grid."""
    return resampled(logs, tick=tick, reach=grid.reach, burn_in=grid.burn_in, settled=grid.settled)


def _joined(arrays: Sequence[npt.NDArray[Any]]) -> Array:
    return np.concatenate(arrays) if arrays else np.zeros(0)
