"""Rows that were taken evenly, but whose times jitter: the even times, where these fit better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.identification.clock import Clock, unequal
from planner.identification.grid import gridded, pieces_of
from planner.identification.least_squares import SEARCH, Fit, least_squares
from planner.identification.log import Log

EVEN = 0.01
"""Times that are off an even clock by less than this share of a period (rms) are even."""

WORTH_EVENING = 0.03
"""Share of the loss that even times have to save: jitter that matters more than doubles it."""

SURE = 3.0
"""Standard deviations of the period of the rows within which it agrees with a given one."""

DROPPED = 0.3
"""A pause that is short of whole periods by less than this share of one is as many: less likely a
dropped row than a late one."""

STEPS = 15
"""Steps that tell which times fit better."""


def evened(logs: Sequence[Log], period: float) -> tuple[tuple[Log, ...], float]:
    """The logs with each row at the next whole period, and by how much times were off [s], rms.

    Pauses of several periods are dropped rows, and every piece between two gaps begins anew. The
    period is that of all pieces together, or the one given where the times agree with it.
    """
    lines = []
    for log in logs:
        for piece in pieces_of(log):
            steps = np.maximum(np.floor(np.diff(log.times[piece]) / period + DROPPED), 1.0)
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
    moved, done = [], 0
    for log in logs:
        times = log.times + off[done : done + len(log.times)]
        done += len(log.times)
        if not np.all(np.diff(times) > 0.0):
            return tuple(logs), 0.0
        moved.append(replace(log, times=times))
    return tuple(moved), float(np.sqrt(np.mean(off**2)))


def with_even_rows(logs: Sequence[Log], clock: Clock, fit: Fit) -> tuple[Log, ...] | None:
    """The logs with even times, if a joint with these explains them clearly better.

    Times that a program notes may come late by a millisecond or so, though the servo is read
    evenly. Rows that really are uneven fit worse on an even clock.

    Args:
        logs: The logs.
        clock: Their ticks.
        fit: The joint that was fitted to them as they are.

    Returns:
        The logs, or None where they are to stay as they are.
    """
    if unequal(logs):
        return None
    even, off = evened(logs, clock.period)
    if off <= EVEN * clock.period:
        return None
    delay = fit.parameters.lag + fit.parameters.acceleration_time
    burn_in = min(2.0 * delay + 2.0 * clock.period, clock.reach)
    losses = []
    for each in (logs, even):
        grid = gridded(each, tick=fit.grid.tick, reach=clock.reach, burn_in=burn_in)
        if not len(grid.angles):
            return None
        again = least_squares(grid, fit.parameters, scale=fit.scale, effort=SEARCH)
        losses.append(again.cost / len(grid.angles))
    return even if losses[1] < (1.0 - WORTH_EVENING) * losses[0] else None
