"""On which ticks a log is modelled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.log import Log, pieces_of
from planner.model.joint import MOST_HOLD
from planner.trajectory import Array
from planner.validation import as_number, as_whole, shown


@dataclass(frozen=True, kw_only=True)
class TimingOptions:
    """How the period of the rows is read and divided into ticks.

    Half and twice the values were tried on 29 reference logs (20 made, 9 recorded;
    ``scripts/reference``). Where nothing is said they change neither ticks nor fits.

    Attributes:
        slowest_own_tick: Logs of this period and less are modelled with one tick a row [s]: the
            paper's robot. Half divides the rows of the made logs: errors -0.1 to +0.15 %.
        longest_tick: Slower ones with ticks of at most this [s]: a joint that closes in by 50 a
            second then covers a quarter of its error a tick, and finer ticks predict recordings
            no better (docs/math.md). At half and twice the STS3250 is fitted 0.8 and 0.9 % worse,
            and held out 17 and 4 %.
        most_hold: Ticks in a period at most, unless more are asked for: logs of less than 10
            rows a second do not show what 5 ms would.
        slack: A tick may exceed these two by this factor: periods of 20.06 and 20.55 ms are 4
            ticks, not 5. It is a margin of a share: half or twice it has no meaning.
        agreement: A given tick and hold must agree with the log's period to this share of it
            and ``sure`` standard deviations.
        sure: Standard deviations by which a period estimated from uneven pauses may be off.
        unequal: Logs whose periods differ by more than this share are of several clocks.
        reach_periods: Periods that lag and acceleration time may span together.
        reach_time: Time that they may always span together [s].
        reach_share: Share of the longest log that they may span together. Half: one interval 1.3
            times wider, the errors unchanged.
        near_whole: Pauses within this share of a period of whole periods tell how long it is.
        most_dropped: Longest pause that tells the period [periods].
        rounds: Estimates of a period, each of which says anew which pauses tell it.
        dropped: A pause that is short of whole periods by less than this share of one is as
            many: less likely a dropped row than a late one.
        digits: Decimals of a period [s]: differences of the times that a log counts up are no
            better. With 4 the period of 20.06 ms would be 20.1.
    """

    slowest_own_tick: float = 0.008
    longest_tick: float = 0.005
    most_hold: int = 20
    slack: float = 1.05
    agreement: float = 1e-3
    sure: float = 3.0
    unequal: float = 0.05
    reach_periods: int = 50
    reach_time: float = 0.75
    reach_share: float = 0.25
    near_whole: float = 0.4
    most_dropped: float = 10.0
    rounds: int = 3
    dropped: float = 0.3
    digits: int = 9


OPTIONS = TimingOptions()


class Timing(NamedTuple):
    """Ticks and periods.

    Attributes:
        period: Time between the rows of all logs [s].
        tick: Time step of the model [s].
        hold: Ticks in a period.
        reach: Longest lag plus acceleration time that is looked for [s].
    """

    period: float
    tick: float
    hold: int
    reach: float

    def ticking(self, tick: float) -> Timing:
        """The same with ticks of about this length [s], a whole number in a period."""
        hold = round(self.period / tick)
        return self._replace(tick=self.period / hold, hold=hold)


def timing_of(logs: Sequence[Log], *, tick: float | None, hold: int | None) -> Timing:
    """The ticks of the logs, as given or chosen.

    Raises:
        InvalidInput: Tick and hold do not make the log's period.
    """
    pauses = np.concatenate([np.diff(log.times) for log in logs])
    median = float(np.median(pauses))
    mean = _mean_period(pauses, median)
    period = mean if all(_keeps_to(mean, log.times) for log in logs) else median
    unsure = OPTIONS.sure * min(float(np.std(pauses)) / math.sqrt(len(pauses)), 0.01 * period)
    period = round(period, OPTIONS.digits) or period
    longest = max(float(log.times[-1] - log.times[0]) for log in logs)
    reach = max(
        min(max(OPTIONS.reach_periods * period, OPTIONS.reach_time), OPTIONS.reach_share * longest),
        4.0 * period,
    )
    if hold is None:
        hold = _default_hold(period) if tick is None else _ticks(period, _positive(tick))
    hold = _count(hold)
    made = period / hold if tick is None else _positive(tick)
    if abs(made * hold - period) > OPTIONS.agreement * period + unsure:
        raise InvalidInput(
            f"tick, hold: got {hold} ticks of {made:g} s, expected the log's period of "
            f"{period:g} s; give one of the two, or neither"
        )
    return Timing(made * hold, made, hold, reach)


def unequal(logs: Sequence[Log]) -> bool:
    """Whether logs are of several clocks."""
    periods = [log.period for log in logs]
    return max(periods) > (1.0 + OPTIONS.unequal) * min(periods)


def _mean_period(pauses: Array, median: float) -> float:
    """The mean of pauses that are about whole numbers of their median [s]."""
    period = median
    for _ in range(OPTIONS.rounds):
        whole = np.round(pauses / period)
        near = (whole >= 1.0) & (whole <= OPTIONS.most_dropped)
        near &= np.abs(pauses - whole * period) <= OPTIONS.near_whole * period
        if near.any():
            period = float(np.sum(pauses[near]) / np.sum(whole[near]))
    return period


def _keeps_to(period: float, times: Array) -> bool:
    """Whether times stay with a clock of this period, so that the mean pause tells it.

    Times that jitter, or are rounded to milliseconds, do, and the median pause is off. Those of a
    loop that is late now and then do not, and most pauses are as long as the median says.
    """
    whole = np.round(np.diff(times) / period)
    apart = np.diff(times) - whole * period
    beside = np.concatenate([[0.0], np.cumsum(apart)])
    trend = np.polynomial.Polynomial.fit(np.arange(len(times)), beside, 1)
    wandering = float(np.std(beside - trend(np.arange(len(times)))))
    return wandering <= float(np.std(apart))


def _ticks(period: float, tick: float) -> int:
    """The whole number of ticks that comes nearest to a period."""
    return round(min(period / tick, 2.0 * MOST_HOLD))


def _default_hold(period: float) -> int:
    if period <= OPTIONS.slack * OPTIONS.slowest_own_tick:
        return 1
    return min(math.ceil(period / (OPTIONS.slack * OPTIONS.longest_tick)), OPTIONS.most_hold)


def _positive(tick: object) -> float:
    value = as_number(tick)
    if not value > 0.0:
        raise InvalidInput(f"tick: got {shown(tick)}, expected a time of more than 0 s")
    return value


def _count(hold: object) -> int:
    count = as_whole(hold) or 0
    if not 1 <= count <= MOST_HOLD:
        raise InvalidInput(
            f"hold: got {shown(hold)}, expected a whole number of ticks, 1 or more, to {MOST_HOLD}"
        )
    return count


def evenly_timed(logs: Sequence[Log], period: float) -> tuple[tuple[Log, ...], float]:
    """The logs with each row at the next whole period, and by how much times were off [s], rms.

    Pauses of several periods are dropped rows, and every piece between two gaps begins anew. The
    period is that of all pieces together, or the one given where the times agree with it.
    """
    lines = []
    for log in logs:
        for piece in pieces_of(log):
            steps = np.maximum(np.floor(np.diff(log.times[piece]) / period + OPTIONS.dropped), 1.0)
            places = np.concatenate([[0.0], np.cumsum(steps)])
            since = log.times[piece] - log.times[piece.start]
            lines.append((places - np.mean(places), since - np.mean(since)))
    places, since = (np.concatenate(column) for column in zip(*lines, strict=True))
    weight = max(float(places @ places), 1.0)
    slope = float(places @ since) / weight
    unsure = float(np.std(since - slope * places)) / np.sqrt(weight)
    if abs(slope - period) <= OPTIONS.sure * unsure:
        slope = period
    off = slope * places - since
    moved, done = [], 0
    for log in logs:
        times = log.times + off[done : done + len(log.times)]
        done += len(log.times)
        if not np.all(np.diff(times) > 0.0):
            return tuple(logs), 0.0
        moved.append(replace(log, times=times))
    return tuple(moved), float(np.sqrt(np.mean(off**2)))
