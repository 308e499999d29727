"""The best model of some logs: a search on coarse ticks, refined at the ticks of the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, rms
from planner.exceptions import InvalidInput
from planner.identification.grid import (
    ON_A_TICK,
    Grid,
    Place,
    Timing,
    evenly_timed,
    resampled,
    resampled_like,
    thinned,
    unequal,
)
from planner.identification.least_squares import (
    FULL,
    QUICK,
    ROUNDED,
    SEARCH,
    TERM,
    Effort,
    Fit,
    huber,
    least_squares,
    respond,
)
from planner.identification.log import Log, pieces_of
from planner.identification.parameters import Parameters, only
from planner.model.joint import with_ticks

SETTLED_ERRORS = 2.0
"""The first rows of a piece are used where the model, with the first request in force before, errs
there by less than so many standard deviations. (Half: up to 2.5 % worse held out, twice: none.)"""

EVEN_ROWS_SAVING = 0.03
"""Share of the loss that even times have to save: jitter that matters more than doubles it. (At
half one servo counts as even, and is 4.8 % worse held out; twice: none.)"""

DIVISIONS = ((0.0, 1.0, 3.0), (0.5, 0.7, 3.0), (0.2, 0.5, 1.5), (0.8, 0.4, 6.0))
"""How the search divides the whole delay: lag and acceleration time as shares of it, and gain times
it. The window begins wide, since a narrow one sees only the nearest change of a request."""

JUST_ABOVE = 1.0 + 1e-6
"""By how much a top speed that was never reached lies above the fastest call."""


def fit_joint(logs: Sequence[Log], timing: Timing, *, choose_tick: bool = False) -> tuple[Fit, ...]:
    """Fit the joint, without the terms of ``terms.py``, to logs: to some stretches of long ones.

    With ``choose_tick`` ticks of a whole period are tried, too; where they fit better that is
    another fit after the first. Raises InvalidInput where there is no motion to fit.
    """
    rows = partial(resampled, thinned(logs), reach=timing.reach)
    delay = best_delay(moving(rows(tick=timing.tick, burn_in=0.0)))
    burn_in = min(2.0 * delay + 2.0 * timing.period, timing.reach)
    stride = timing.period * max(1, int(0.004 / timing.period * (1.0 + 1e-9)))
    found = _initial_fit(moving(rows(tick=stride, burn_in=burn_in)))
    search = partial(least_squares, effort=SEARCH)
    best = search(rows(tick=timing.tick, burn_in=burn_in), found.parameters, scale=found.scale)
    window = best.parameters.lag + best.parameters.acceleration_time
    settled = settled_pieces(logs, best)
    if settled or window > burn_in:
        burn_in = min(max(burn_in, 1.2 * window), timing.reach)
        final = moving(rows(tick=timing.tick, burn_in=burn_in, settled=settled))
        best = search(final, best.parameters, scale=best.scale)
    fits = [best]
    if choose_tick and timing.hold > 1:
        grid = rows(tick=timing.period, burn_in=burn_in, settled=settled)
        simple = search(grid, found.parameters, scale=best.scale)
        # Where the log does not tell which ticks the joint has, they agree to a tenth of this.
        fits += [simple] if huber(simple.weighted, best.scale) < 0.995 * best.cost else []
    return tuple(_without_saturation(fit.again(effort=SEARCH)) for fit in fits)


def refitted(
    logs: Sequence[Log], fit: Fit, *, tick: float | None = None, effort: Effort = FULL
) -> Fit:
    """The fit to other rows of its logs, weights, or ticks [s]; the same one where none is other.

    It begins at the joint that answers the same. A motor at shorter ticks may have a window that is
    shorter, too: that is a local optimum of its own. (Without it three of 44 logs are fitted up to
    4 % worse.)
    """
    before, at = fit.grid, fit.parameters
    tick = before.tick if tick is None else tick
    grid = resampled_like(before, logs, tick)
    rows = all(map(np.array_equal, grid.places, before.places))
    if tick == before.tick and rows and np.array_equal(grid.weights, before.weights):
        return fit
    if tick != before.tick:
        inertia = at.time_constant > 0.0
        gain, lag = with_ticks(at.gain, at.lag, before.tick, tick, inertia=inertia)
        at = at._replace(gain=gain, lag=lag)
    found = fit.again(at, grid=grid, effort=effort)
    if tick < before.tick and found.has("time_constant", "acceleration"):
        short = found.with_short_window(effort=TERM)
        found = short.again(effort=effort) if short.cost < 0.999 * found.cost else found
    return found


def _initial_fit(grid: Grid) -> Fit:
    """The best fit on a grid: of several starts the one that is best after a few steps."""
    delay = best_delay(grid)
    whole = max(delay, 2.0 * grid.tick)
    speed = grid.speed_exceeded_by(0.02)
    speed = max(speed, 1e-9 * float(np.ptp(grid.angles)) / grid.tick)
    begins = (
        Parameters(share / whole, speed, lag * whole, window * whole, offset=0.0)
        for lag, window, share in DIVISIONS
    )
    quick = [least_squares(grid, begin, effort=QUICK) for begin in begins]
    scale = min(fit.scale for fit in quick)
    best = min(quick, key=lambda fit: huber(fit.weighted, scale))
    return best.again(scale=scale, effort=SEARCH)


def _without_saturation(best: Fit) -> Fit:
    """The better of a fit and one begun where the joint never saturates.

    Without it small steps, and slow ramps, of such a joint are fitted with a top speed far too low.
    """
    at, shown = best.parameters, best.peak_command
    if at.v_max > shown or best.exact:
        return best
    (lag, window, share), delay = DIVISIONS[1], at.whole_delay
    begin = Parameters(share / delay, 10.0 * shown, lag * delay, window * delay, at.offset)
    found = best.trial(begin, effort=SEARCH)
    if found.cost >= (1.0 - 1e-6) * best.cost:  # by no more than rounding
        return best
    return found.again(effort=SEARCH)


def moving(grid: Grid) -> Grid:
    """The grid, or why nothing can be learned from it."""
    from planner.model.kernel import numbers_in_force

    least = 1e-12  # of motion [rad]: what is less is rounding
    if len(grid.angles) < 10:
        raise InvalidInput(
            f"the log has {len(grid.angles)} rows to learn from, expected 10 or more with torque on"
        )
    sent = grid.requests[numbers_in_force(grid.edges, grid.ticks, 0.0)]
    if np.ptp(sent) <= least:
        raise InvalidInput(
            "the requests never change in this log: record one in which they move the joint"
        )
    if np.ptp(grid.angles) <= least:
        raise InvalidInput(
            "the joint does not move in this log: its actual angle is the same in every row; is "
            "the torque on, and is this the right column?"
        )
    return grid


def settled_pieces(logs: Sequence[Log], fit: Fit) -> set[Place]:
    """Pieces whose first rows show that their first request had been in force before."""
    grid = fit.grid
    every = resampled(logs, tick=grid.tick, reach=grid.reach, burn_in=0.0)
    whole = least_squares(every, fit.parameters, free=only(), scale=fit.scale, effort=SEARCH)
    errors = every.per_log(whole.weighted)
    bound = max(SETTLED_ERRORS * fit.scale, ROUNDED * float(np.std(grid.angles)))
    found = set()
    for number, log in enumerate(logs):
        for piece in pieces_of(log):
            unknown = log.times[piece.start] + grid.burn_in * (1.0 - ON_A_TICK)
            new = every.places[number][piece] & (log.times[piece] < unknown)
            of_piece = errors[number][piece][new]
            if len(of_piece) and rms(of_piece) <= bound:
                found.add((number, piece.start))
    return found


def with_observed_speed(fit: Fit) -> Fit:
    """The fit with a top speed no higher than anything the log called for.

    Beyond that every top speed predicts the same; this one is the lowest. Of a joint that friction
    holds throughout the log calls for none.
    """
    shown = fit.peak_command
    if not 0.0 < shown < fit.parameters.v_max * (1.0 - abs(fit.parameters.asymmetry)):
        return fit
    return replace(fit, parameters=fit.parameters._replace(v_max=JUST_ABOVE * shown))


def with_speed_of(fit: Fit, speed: float) -> Fit:
    """The fit with the top speed raised to one that a joint was seen to have [rad/s]."""
    at = fit.parameters._replace(v_max=JUST_ABOVE * speed)
    raised = fit.trial(at, free=fit.free & ~only("v_max"), effort=FULL)
    return replace(raised, free=fit.free)


def with_even_rows(logs: Sequence[Log], timing: Timing, fit: Fit) -> tuple[Log, ...] | None:
    """The logs with even times, if a joint with these explains them clearly better; else None.

    Times that a program notes may come late by a millisecond or so, though the servo is read
    evenly. Recorded loops of 50 Hz are off by 1.4 %, which is even.
    """
    if unequal(logs):
        return None
    even, off = evenly_timed(logs, timing.period)
    if off <= 0.02 * timing.period:
        return None
    delay = fit.parameters.lag + fit.parameters.acceleration_time
    burn_in = min(2.0 * delay + 2.0 * timing.period, timing.reach)
    losses = []
    for each in (logs, even):
        grid = resampled(each, tick=fit.grid.tick, reach=timing.reach, burn_in=burn_in)
        if not len(grid.angles):
            return None
        again = least_squares(grid, fit.parameters, scale=fit.scale, effort=SEARCH)
        losses.append(again.cost / len(grid.angles))
    return even if losses[1] < (1.0 - EVEN_ROWS_SAVING) * losses[0] else None


class Simple(NamedTuple):
    """A simpler description of the same rows, fitted."""

    name: str  # "raw", "delay" or "first_order"
    parameters: dict[str, float]  # as in :class:`planner.identification.result.Alternative`
    joint: Parameters | None  # that behaves so; None for a request that is merely delayed


def simple_fits(grid: Grid) -> tuple[Simple, ...]:
    """Fit no model, a delay and a first-order lag, which never saturates, the simplest first."""
    grid = replace(grid, weights=np.ones_like(grid.weights))
    delay, tick = best_delay(grid), grid.tick
    whole = max(delay, 2.0 * tick)
    search = partial(least_squares, grid, free=only("gain", "lag", "offset"))
    begins = [
        Parameters(
            1.0 / max((1.0 - share) * whole, tick), math.inf, share * whole, tick, offset=0.0
        )
        for share in (0.0, 0.5, 0.9)
    ]
    best = min((search(begin, effort=QUICK) for begin in begins), key=lambda fit: fit.rms)
    at = search(best.parameters, starts=best.starts, effort=SEARCH).parameters
    found = {
        "delay": float(at.lag + at.acceleration_time / 2.0),
        "time_constant": float(1.0 / at.gain),
        "offset": float(at.offset),
    }
    return (
        Simple("raw", {}, None),
        Simple("delay", {"delay": delay}, None),
        Simple("first_order", found, at),
    )


def errors_of(simple: Simple, grid: Grid, starts: Array) -> Array:
    """Predicted minus actual angle of a simpler description at the used rows [rad]."""
    if simple.joint is None:
        return delayed_errors(grid, simple.parameters.get("delay", 0.0))
    return respond(grid, simple.joint, starts).predicted - grid.angles


def best_delay(grid: Grid) -> float:
    """The delay after which the requests come nearest to the angles [s], the least among equals."""
    step = 4.0 * grid.tick
    delays = np.arange(0.0, grid.reach, step)
    for _ in range(3):
        errors = [rms(delayed_errors(grid, delay)) for delay in delays]
        delay = float(delays[np.argmin(errors)])
        step /= 8.0
        around = delay + step * np.arange(-8, 9)
        delays = np.unique(np.append(around[around >= 0.0], delay))
    return delay


def delayed_errors(grid: Grid, delay: float) -> Array:
    """The request of ``delay`` [s] ago minus the angle, at the used rows [rad].

    A request that comes into force at the very time of a row counts for that row.
    """
    from planner.model.kernel import numbers_in_force

    late = delay - 1e-6 * grid.tick
    numbers = numbers_in_force(grid.edges, grid.times, late)
    return np.asarray(grid.requests[numbers] - grid.angles)
