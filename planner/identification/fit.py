"""The best model of some logs: a search on coarse ticks, refined at the ticks of the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

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
    QUICK,
    SEARCH,
    Fit,
    Response,
    huber,
    least_squares,
    respond,
)
from planner.identification.log import Log, pieces_of
from planner.identification.parameters import Parameters, only
from planner.model.joint import with_ticks
from planner.trajectory import Array, rms

SETTLED_ERRORS = 2.0
"""The first rows of a piece are used where the model, with the first request in force before, errs
there by less than so many standard deviations. (Half: up to 2.5 % worse held out, twice: none.)"""

EVEN_ROWS_SAVING = 0.03
"""Share of the loss that even times have to save: jitter that matters more than doubles it. (At
half one servo counts as even, and is 4.8 % worse held out; twice: none.)"""

DIVISIONS = ((0.0, 1.0, 3.0), (0.5, 0.7, 3.0), (0.2, 0.5, 1.5), (0.8, 0.4, 6.0))
"""How the search divides the whole delay: lag and acceleration time as shares of it, and gain times
it. The window begins wide, since a narrow one sees only the nearest change of a request."""

ROUNDED = 1e-9
"""Errors below this, relative to the spread of the angles, are rounding."""

JUST_ABOVE = 1.0 + 1e-6
"""By how much a top speed that was never reached lies above the fastest call."""

FAR_ABOVE = 4.0
"""Times the fastest motion of a log, a top speed that is hardly reached."""

FIRST_ORDER = only("gain", "lag", "offset")
"""The parameters of a first-order lag."""


def fit_joint(logs: Sequence[Log], timing: Timing, *, choose_tick: bool = False) -> tuple[Fit, ...]:
    """Fit the joint, without the terms of ``terms.py``, to logs: to some stretches of long ones.

    Args:
        logs: The logs.
        timing: Their ticks.
        choose_tick: Whether to try ticks of a whole period, too.

    Returns:
        The fit; with ticks of a whole period another one after it, where these fit better.

    Raises:
        InvalidInput: There is no motion to fit.
    """
    every, logs = logs, thinned(logs)
    delay = best_delay(moving(resampled(logs, tick=timing.tick, reach=timing.reach, burn_in=0.0)))
    burn_in = min(2.0 * delay + 2.0 * timing.period, timing.reach)
    stride = timing.period * max(1, int(0.004 / timing.period * (1.0 + 1e-9)))
    coarse = moving(resampled(logs, tick=stride, reach=timing.reach, burn_in=burn_in))
    found = _initial_fit(coarse)
    fine = resampled(logs, tick=timing.tick, reach=timing.reach, burn_in=burn_in)
    best = least_squares(fine, found.parameters, scale=found.scale, effort=SEARCH)
    window = best.parameters.lag + best.parameters.acceleration_time
    settled = settled_pieces(every, best)
    if settled or window > burn_in:
        burn_in = min(max(burn_in, 1.2 * window), timing.reach)
        final = resampled(
            logs, tick=timing.tick, reach=timing.reach, burn_in=burn_in, settled=settled
        )
        best = least_squares(moving(final), best.parameters, scale=best.scale, effort=SEARCH)
    fits = [best]
    if choose_tick and timing.hold > 1:
        rows = resampled(
            logs, tick=timing.period, reach=timing.reach, burn_in=burn_in, settled=settled
        )
        simple = least_squares(rows, found.parameters, scale=best.scale, effort=SEARCH)
        # Where the log does not tell which ticks the joint has, they agree to a tenth of this.
        fits += [simple] if huber(simple.weighted, best.scale) < 0.995 * best.cost else []
    again = (
        least_squares(fit.grid, fit.parameters, starts=fit.starts, effort=SEARCH) for fit in fits
    )
    return tuple(map(_without_saturation, again))


def refitted(logs: Sequence[Log], fit: Fit, *, tick: float | None = None) -> Fit:
    """The fit to other rows of its logs, weights, or ticks [s]; the same one where none is other.

    It begins at the joint that answers the same.
    """
    before, at = fit.grid, fit.parameters
    tick = before.tick if tick is None else tick
    grid = resampled_like(before, logs, tick)
    if tick == before.tick and np.array_equal(grid.weights, before.weights):
        return fit
    if tick != before.tick:
        inertia = at.time_constant > 0.0
        gain, lag = with_ticks(at.gain, at.lag, before.tick, tick, inertia=inertia)
        at = at._replace(gain=gain, lag=lag)
    return least_squares(grid, at, free=fit.free, starts=starts_of(grid, fit))


def starts_of(grid: Grid, fit: Fit) -> Array:
    """Where the runs start: as fitted where the fit has seen it, else as measured."""
    fitted_starts = dict(zip(fit.grid.firsts, fit.starts, strict=True))
    pairs = zip(grid.firsts, grid.measured_starts, strict=True)
    return np.array([fitted_starts.get(first, angle) for first, angle in pairs])


def _initial_fit(grid: Grid) -> Fit:
    """The best fit on a grid: of several starts the one that is best after a few steps."""
    delay = best_delay(grid)
    whole = max(delay, 2.0 * grid.tick)
    speed = grid.speed_exceeded_by(0.02)
    begins = _divided_delay(whole, v_max=max(speed, 1e-9 * float(np.ptp(grid.angles)) / grid.tick))
    quick = [least_squares(grid, begin, effort=QUICK) for begin in begins]
    scale = min(fit.scale for fit in quick)
    best = min(quick, key=lambda fit: huber(fit.weighted, scale))
    return least_squares(grid, best.parameters, starts=best.starts, scale=scale, effort=SEARCH)


def _divided_delay(delay: float, *, v_max: float, offset: float = 0.0) -> list[Parameters]:
    """Joints of about the same delay [s], divided into lag, window and time constant."""
    return [
        Parameters(
            gain=share / delay,
            v_max=v_max,
            lag=lag * delay,
            acceleration_time=window * delay,
            offset=offset,
        )
        for lag, window, share in DIVISIONS
    ]


def _without_saturation(best: Fit) -> Fit:
    """The better of a fit and one begun where the joint never saturates.

    Small steps of a joint that never saturates are fitted to 0.5 % with a top speed far too low;
    begun without one they are fitted to rounding. (Without this one of 29 reference logs is
    predicted 25 % worse.)
    """
    at, grid, shown = best.parameters, best.grid, peak_command(best)
    if at.v_max > shown or best.scale <= ROUNDED * float(np.std(grid.angles)):
        return best
    begin = _divided_delay(at.whole_delay, v_max=10.0 * shown, offset=at.offset)[1]
    found = least_squares(grid, begin, starts=best.starts, scale=best.scale, effort=SEARCH)
    if found.cost >= (1.0 - 1e-6) * best.cost:  # by no more than rounding
        return best
    return least_squares(grid, found.parameters, starts=found.starts, effort=SEARCH)


def moving(grid: Grid) -> Grid:
    """The grid, or why nothing can be learned from it."""
    from planner.model.kernel import in_force

    least = 1e-12  # of motion [rad]: what is less is rounding
    if len(grid.angles) < 10:
        raise InvalidInput(
            f"the log has {len(grid.angles)} rows to learn from, expected 10 or more with torque on"
        )
    if np.ptp(in_force(grid.edges, grid.requests, grid.ticks)) <= least:
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


def peak_command(fit: Fit) -> float:
    """Highest speed that the requests of a fit called for, limited or not [rad/s]."""
    return commanded_speed(fit.parameters, fit.response)


def commanded_speed(parameters: Parameters, response: Response) -> float:
    """Highest speed that the requests called for in any run, limited or not [rad/s]."""
    largest = float(np.max(np.abs(response.errors)))
    held = 0.0 if parameters.integral_rate > 0.0 else parameters.dead_band
    return parameters.gain * max(largest - held, 0.0)


def with_observed_speed(fit: Fit) -> Fit:
    """The fit with a top speed no higher than anything the log called for.

    Beyond that every top speed predicts the same; this one is the lowest.
    """
    shown = peak_command(fit)
    if fit.parameters.v_max * (1.0 - abs(fit.parameters.asymmetry)) <= shown:
        return fit
    return replace(fit, parameters=fit.parameters._replace(v_max=JUST_ABOVE * shown))


def never_saturating(fit: Fit) -> Fit | None:
    """The joint whose top speed is far above all motion of the log.

    On slow ramps a top speed a little below theirs may stand for a sag or friction that is not
    fitted yet. None where the top speed of the fit is above all motion that was measured.
    """
    if fit.parameters.v_max > fit.grid.fastest:
        return None
    at = fit.parameters._replace(v_max=FAR_ABOVE * fit.grid.fastest)
    return least_squares(fit.grid, at, free=fit.free & ~only("v_max"), starts=fit.starts)


def with_speed_of(fit: Fit, speed: float) -> Fit:
    """The fit with the top speed raised to one that a joint was seen to have [rad/s]."""
    at = fit.parameters._replace(v_max=JUST_ABOVE * speed)
    raised = least_squares(
        fit.grid, at, free=fit.free & ~only("v_max"), starts=fit.starts, scale=fit.scale
    )
    return replace(raised, free=fit.free)


def with_even_rows(logs: Sequence[Log], timing: Timing, fit: Fit) -> tuple[Log, ...] | None:
    """The logs with even times, if a joint with these explains them clearly better.

    Times that a program notes may come late by a millisecond or so, though the servo is read
    evenly. Rows that really are uneven fit worse on an even clock. Recorded loops of 50 Hz are off
    by 1.4 %, which is even.

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
    """A simpler description of the same rows, fitted.

    Attributes:
        name: "raw", "delay" or "first_order".
        parameters: As in :class:`planner.identification.result.Alternative`.
        joint: The joint that behaves so; None for a request that is merely delayed.
    """

    name: str
    parameters: dict[str, float]
    joint: Parameters | None


def simple_fits(grid: Grid) -> tuple[Simple, ...]:
    """Fit no model, a delay and a first-order lag, the simplest first."""
    grid = replace(grid, weights=np.ones_like(grid.weights))
    delay = best_delay(grid)
    at = _first_order(grid, delay).parameters
    found = {
        "delay": at.lag + at.acceleration_time / 2.0,
        "time_constant": 1.0 / at.gain,
        "offset": at.offset,
    }
    return (
        Simple("raw", {}, None),
        Simple("delay", {"delay": delay}, None),
        Simple("first_order", {name: float(value) for name, value in found.items()}, at),
    )


def errors_of(simple: Simple, grid: Grid, starts: Array) -> Array:
    """Predicted minus actual angle of a simpler description at the used rows [rad]."""
    if simple.joint is None:
        return delayed_errors(grid, simple.parameters.get("delay", 0.0))
    return respond(grid, simple.joint, starts).predicted - grid.angles


def _first_order(grid: Grid, delay: float) -> Fit:
    """A joint that never saturates and whose window is a single tick.

    The search starts with none, half and nine tenths of the whole delay as pure delay.
    """
    whole = max(delay, 2.0 * grid.tick)
    begins = [
        Parameters(
            gain=1.0 / max((1.0 - share) * whole, grid.tick),
            v_max=math.inf,
            lag=share * whole,
            acceleration_time=grid.tick,
            offset=0.0,
        )
        for share in (0.0, 0.5, 0.9)
    ]
    fits = [least_squares(grid, begin, free=FIRST_ORDER, effort=QUICK) for begin in begins]
    best = min(fits, key=lambda fit: fit.rms)
    return least_squares(grid, best.parameters, free=FIRST_ORDER, starts=best.starts, effort=SEARCH)


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
    from planner.model.kernel import in_force

    times = grid.times - (delay - 1e-6 * grid.tick)
    return in_force(grid.edges, grid.requests, times) - grid.angles
