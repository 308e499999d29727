"""The best model of some logs: a search on coarse ticks, refined at the ticks of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.alternatives import best_delay
from planner.identification.least_squares import OPTIONS as FITTING
from planner.identification.least_squares import Fit, least_squares
from planner.identification.log import Log, pieces_of
from planner.identification.parameters import Parameters, only
from planner.identification.resampling import Grid, Place, resampled
from planner.identification.robust_loss import huber
from planner.identification.simulation import ActiveRequests
from planner.identification.timestamps import Timing, evenly_timed, unequal
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """What steers the choice among local optima, ticks and clocks.

    In brackets what half and twice the value change on seven reference logs (four made, three
    recorded; ``scripts/reference``): the error on all rows, and on those that are held out.

    Attributes:
        search_tick: Ticks of the first search [s], as many whole periods as fit into it. Where
            to look for the best fit does not depend on it; a finer one only takes longer (none,
            none).
        commanded_share: Top speed from which the search starts again where none was reached, as
            a share of the highest commanded speed. (Held out the STS3250 is 24 and 25 % worse,
            in another local optimum; the rest is unchanged.)
        unlimited: Top speed of a search in which nothing saturates, as a multiple of the highest
            commanded speed. Small steps of a joint that never saturates are fitted to 0.5 % with
            a top speed far too low; begun without one they are fitted to rounding.
        period_tick_saving: Share of the loss that ticks of a whole period have to save over
            shorter ones. Where the log does not tell which ticks the joint has, the two agree
            to a tenth of that (none, none).
        settled_errors: The first rows of a piece are used where the model, with the first
            request in force before, errs there by less than so many standard deviations (rms;
            up to 2.5 % worse held out, none).
        even_times: Times that are off even ones by less than this share of a period (rms) are
            even: recorded loops of 50 Hz are off by 1.4 %, and no fit to even rows was ever
            taken there (none, none; it saves a fit).
        even_rows_saving: Share of the loss that even times have to save: jitter that matters
            more than doubles it. (At half the XL330 counts as even, and is 4.8 % worse held out;
            twice: none.)
        divisions: How the search divides the whole delay: lag and acceleration time as shares of
            it, and gain times it. The window begins wide, since a narrow one sees only the nearest
            change of a request.
        rows_at_top_speed: Share of the rows that are faster than where the search for the top
            speed begins.
        clearly: Share of the loss by which a later fit has to be better: less is rounding.
        just_above: Share by which a top speed that was never reached lies above the fastest call.
        least_motion: Angles and requests that span less do not change [rad]: that is rounding.
        rounded: Errors below this, relative to the spread of the angles, are rounding.
    """

    search_tick: float = 0.004
    commanded_share: float = 0.7
    unlimited: float = 10.0
    period_tick_saving: float = 0.005
    settled_errors: float = 2.0
    even_times: float = 0.02
    even_rows_saving: float = 0.03
    divisions: tuple[tuple[float, float, float], ...] = (
        (0.0, 1.0, 3.0),
        (0.5, 0.7, 3.0),
        (0.2, 0.5, 1.5),
        (0.8, 0.4, 6.0),
    )
    rows_at_top_speed: float = 0.02
    clearly: float = 1e-6
    just_above: float = 1e-6
    least_motion: float = 1e-12
    rounded: float = 1e-9


OPTIONS = FitOptions()


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
    found = _initial_fit(coarse)
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
    best = least_squares(best.grid, best.parameters, starts=best.starts)
    return _without_saturation(best)


def _without_saturation(best: Fit) -> Fit:
    """The better of a fit and one begun where the joint never saturates."""
    at, grid, shown = best.parameters, best.grid, peak_command(best)
    if at.v_max > shown or best.scale <= OPTIONS.rounded * float(np.std(grid.angles)):
        return best
    never = OPTIONS.unlimited * shown
    begins = [
        at._replace(v_max=never),
        _divided_delay(at.whole_delay, v_max=never, offset=at.offset)[1],
    ]
    for begin in begins:
        found = least_squares(
            grid, begin, starts=best.starts, scale=best.scale, effort=FITTING.search
        )
        if found.cost < (1.0 - OPTIONS.clearly) * best.cost:
            best = least_squares(grid, found.parameters, starts=found.starts)
    return best


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
        for lag, window, share in OPTIONS.divisions
    ]


def _initial_fit(grid: Grid) -> Fit:
    """The best fit on a grid: of several starts the one that is best after a few steps."""
    delay, _ = best_delay(grid)
    whole = max(delay, 2.0 * grid.tick)
    speed = grid.speed_exceeded_by(OPTIONS.rows_at_top_speed)
    begins = _divided_delay(whole, v_max=max(speed, 1e-9 * float(np.ptp(grid.angles)) / grid.tick))
    quick = [least_squares(grid, begin, effort=FITTING.quick) for begin in begins]
    scale = min(fit.scale for fit in quick)
    best = min(quick, key=lambda fit: huber(fit.residuals, scale)[0])
    at, starts = best.parameters, best.starts
    return least_squares(grid, at, starts=starts, scale=scale, effort=FITTING.search)


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
            best = fit if fit.cost < (1.0 - OPTIONS.clearly) * best.cost else best
        return best

    best = least_squares(grid, at, scale=scale, effort=FITTING.search)
    best = better(best, _divided_delay(at.whole_delay, v_max=at.v_max, offset=at.offset))
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
    if np.ptp(grid.requests) <= OPTIONS.least_motion:
        raise InvalidInput(
            "the requests never change in this log: record one in which they move the joint"
        )
    if np.ptp(grid.angles) <= OPTIONS.least_motion:
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
    bound = max(OPTIONS.settled_errors * fit.scale, OPTIONS.rounded * float(np.std(grid.angles)))
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
    errors = active.targets - states[grid.states - 1]
    errors[active.weights <= 0.0] = 0.0
    return float(parameters.gain * max(np.max(np.abs(errors)) - parameters.dead_band, 0.0))


def with_observed_speed(fit: Fit) -> Fit:
    """The fit with a top speed no higher than anything the log called for.

    Beyond that every top speed predicts the same; this one is the lowest.
    """
    shown = peak_command(fit)
    if fit.parameters.v_max * (1.0 - abs(fit.parameters.asymmetry)) <= shown:
        return fit
    return replace(
        fit, parameters=fit.parameters._replace(v_max=(1.0 + OPTIONS.just_above) * shown)
    )


def with_speed_of(fit: Fit, speed: float) -> Fit:
    """The fit with a top speed no lower than a joint was seen to move [rad/s]."""
    lowest = (1.0 + OPTIONS.just_above) * speed
    if fit.parameters.v_max >= lowest:
        return fit
    at = fit.parameters._replace(v_max=lowest)
    raised = least_squares(
        fit.grid, at, free=only(), starts=fit.starts, scale=fit.scale, effort=FITTING.search
    )
    return replace(raised, free=fit.free)


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
