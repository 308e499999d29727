"""The best model of some logs: search on coarse ticks, the last word on the model's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.initial_guess import best_delay, divided_delay, initial_fit
from planner.identification.least_squares import OPTIONS as FITTING
from planner.identification.least_squares import Fit, least_squares
from planner.identification.log import Log, pieces_of
from planner.identification.parameters import Parameters, only
from planner.identification.resampling import Grid, Place, resampled
from planner.identification.simulation import ActiveRequests
from planner.identification.timestamps import Timing, evenly_timed, unequal
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """What steers the choice among local optima, ticks and clocks.

    Attributes:
        search_tick: Ticks of the first search [s], as many whole periods as fit into it. Where
            to look for the best fit does not depend on it; a finer one only takes longer.
        commanded_share: Top speed from which the search starts again where none was reached, as
            a share of the highest commanded speed.
        period_tick_saving: Share of the loss that ticks of a whole period have to save over
            shorter ones. Where the log does not tell which ticks the joint has, the two agree
            to a tenth of that.
        settled_errors: The first rows of a piece are used where the model, with the first
            request in force before, errs there by less than so many standard deviations (rms).
        even_times: Times that are off even ones by less than this share of a period (rms) are
            even: recorded loops of 50 Hz are off by 1.4 %, and no fit to even rows was ever
            taken there.
        even_rows_saving: Share of the loss that even times have to save: jitter that matters
            more than doubles it.
    """

    search_tick: float = 0.004
    commanded_share: float = 0.7
    period_tick_saving: float = 0.005
    settled_errors: float = 2.0
    even_times: float = 0.02
    even_rows_saving: float = 0.03


OPTIONS = FitOptions()


CLEARLY = 1e-6
"""Share of the loss by which a later fit has to be better: less is rounding."""

LEAST_MOTION = 1e-12
"""Angles and requests that span less do not change [rad]: that is rounding."""

JUST_ABOVE = 1e-6
"""Share by which a top speed that was never reached lies above the fastest call."""

ROUNDED = 1e-9
"""Errors below this, relative to the spread of the angles, are rounding."""


def fit_joint(logs: Sequence[Log], timing: Timing, *, choose_tick: bool = False) -> Fit:
    """Fit the joint to all logs.

    Args:
        logs: The logs.
        timing: Their ticks.
        choose_tick: Whether ticks of a whole period may do instead, where they fit better.

    Raises:
        InvalidInput: There is no motion to fit.
    """
    delay, _ = best_delay(
        moving(resampled(logs, tick=timing.tick, reach=timing.reach, burn_in=0.0))
    )
    burn_in = min(2.0 * delay + 2.0 * timing.period, timing.reach)
    stride = timing.period * max(1, int(OPTIONS.search_tick / timing.period * (1.0 + 1e-9)))
    coarse = moving(resampled(logs, tick=stride, reach=timing.reach, burn_in=burn_in))
    found = initial_fit(coarse)
    fine = resampled(logs, tick=timing.tick, reach=timing.reach, burn_in=burn_in)
    best = _multistart(fine, found.parameters, found.scale)
    window = best.parameters.lag + best.parameters.acceleration_time
    settled = settled_pieces(logs, best)
    if settled or window > burn_in:
        burn_in = min(max(burn_in, 1.2 * window), timing.reach)
        final = resampled(
            logs, tick=timing.tick, reach=timing.reach, burn_in=burn_in, settled=settled
        )
        begin = best.parameters
        best = least_squares(moving(final), begin, scale=best.scale, effort=FITTING.search)
    if choose_tick and timing.hold > 1:
        rows = resampled(
            logs, tick=timing.period, reach=timing.reach, burn_in=burn_in, settled=settled
        )
        simple = _multistart(rows, found.parameters, best.scale)
        best = simple if simple.cost < (1.0 - OPTIONS.period_tick_saving) * best.cost else best
    return least_squares(best.grid, best.parameters, starts=best.starts)


def _multistart(grid: Grid, at: Parameters, scale: float) -> Fit:
    """The best of several fits at one scale, begun at and beside what was found on coarser ticks.

    Whole ticks put corners into the loss, and with them local optima. The fits begin at what was
    found and at four divisions of its delay; where the top speed then lies above every commanded
    speed, and has no slope, below the highest; and with one tick of the window given to the lag, or
    taken from it.
    """

    def better(best: Fit, begins: Sequence[Parameters], starts: Array | None = None) -> Fit:
        for begin in begins:
            fit = least_squares(grid, begin, starts=starts, scale=scale, effort=FITTING.search)
            best = fit if fit.cost < (1.0 - CLEARLY) * best.cost else best
        return best

    best = least_squares(grid, at, scale=scale, effort=FITTING.search)
    best = better(best, divided_delay(at.whole_delay, v_max=at.v_max, offset=at.offset))
    at, shown = best.parameters, peak_command(best)
    if at.v_max > shown:
        best = better(best, [at._replace(v_max=OPTIONS.commanded_share * shown)], best.starts)
    at, tick = best.parameters, grid.tick
    moves = [(at.lag + way * tick, at.acceleration_time - way * tick) for way in (1.0, -1.0)]
    beside = [at._replace(lag=lag, acceleration_time=window) for lag, window in moves]
    return better(best, beside, best.starts)


def moving(grid: Grid) -> Grid:
    """The grid, or why nothing can be learned from it."""
    if len(grid.angles) < 10:
        raise InvalidInput(
            f"the log has {len(grid.angles)} rows to learn from, expected 10 or more with torque on"
        )
    if np.ptp(grid.requests) <= LEAST_MOTION:
        raise InvalidInput(
            "the requests never change in this log: record one in which they move the joint"
        )
    if np.ptp(grid.angles) <= LEAST_MOTION:
        raise InvalidInput(
            "the joint does not move in this log: its actual angle is the same in every row; is "
            "the torque on, and is this the right column?"
        )
    return grid


def settled_pieces(logs: Sequence[Log], fit: Fit) -> set[Place]:
    """Pieces whose first rows say that their first request had been in force before."""
    grid = fit.grid
    pieces = {(i, piece.start) for i, log in enumerate(logs) for piece in pieces_of(log)}
    every = resampled(logs, tick=grid.tick, reach=grid.reach, burn_in=0.0)
    whole = least_squares(
        every, fit.parameters, free=only(), scale=fit.scale, effort=FITTING.search
    )
    errors = every.per_log(whole.residuals)
    bound = max(OPTIONS.settled_errors * fit.scale, ROUNDED * float(np.std(grid.angles)))
    found = set()
    for number, row in pieces:
        new = every.places[number] & ~grid.places[number]
        stop = next((p.stop for p in pieces_of(logs[number]) if p.start == row), 0)
        new[:row] = new[stop:] = False
        if new.any() and np.sqrt(np.mean(errors[number][new] ** 2)) <= bound:
            found.add((number, row))
    return found


def peak_command(fit: Fit) -> float:
    """Highest speed that the requests of a fit called for, limited or not [rad/s]."""
    return commanded_speed(fit.parameters, fit.grid, fit.active, fit.states)


def commanded_speed(
    parameters: Parameters, grid: Grid, active: ActiveRequests, states: Array
) -> float:
    """Highest speed that the requests called for in any run, limited or not [rad/s]."""
    errors = active.targets - states[grid.states - 1][:, np.newaxis]
    errors[active.weights <= 0.0] = 0.0
    return float(parameters.gain * np.max(np.abs(errors)))


def with_observed_speed(fit: Fit) -> Fit:
    """The fit with a top speed no higher than anything the log called for.

    Beyond that every top speed predicts the same; this one is the lowest.
    """
    shown = peak_command(fit)
    if fit.parameters.v_max <= shown:
        return fit
    return replace(fit, parameters=fit.parameters._replace(v_max=(1.0 + JUST_ABOVE) * shown))


def with_even_rows(logs: Sequence[Log], timing: Timing, fit: Fit) -> tuple[Log, ...] | None:
    """The logs with even times, if a joint with these explains them clearly better.

    Times that a program notes may come late by a millisecond or so, though the servo is read
    evenly. Rows that really are uneven fit worse on an even clock.

    Args:
        logs: The logs.
        timing: Their ticks.
        fit: The joint that was fitted to them as they are.

    Returns:
        The logs, or None where they are to stay as they are.
    """
    if unequal(logs):
        return None
    even, off = evenly_timed(logs, timing.period)
    if off <= OPTIONS.even_times * timing.period:
        return None
    delay = fit.parameters.lag + fit.parameters.acceleration_time
    burn_in = min(2.0 * delay + 2.0 * timing.period, timing.reach)
    losses = []
    for each in (logs, even):
        grid = resampled(each, tick=fit.grid.tick, reach=timing.reach, burn_in=burn_in)
        if not len(grid.angles):
            return None
        again = least_squares(grid, fit.parameters, scale=fit.scale, effort=FITTING.search)
        losses.append(again.cost / len(grid.angles))
    return even if losses[1] < (1.0 - OPTIONS.even_rows_saving) * losses[0] else None
