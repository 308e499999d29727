"""The best model of some logs: search on coarse ticks, the last word on the model's own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.adjust import adjust
from planner.identification.adjusted import Adjusted
from planner.identification.clock import Clock
from planner.identification.grid import Grid, Place, gridded, pieces_of
from planner.identification.log import Log
from planner.identification.starts import best_delay, nearby, searched

SETTLED = 2.0
"""The first rows of a piece are used where the model, told that the first request had been in force
before, errs there by less than so many standard deviations (rms)."""

AS_GOOD = 1.1
"""Fits on coarse ticks within this factor of the best loss may be the best on the model's own."""

WORTH_COARSER = 0.005
"""Share of the loss that ticks of a whole period have to save over shorter ones; where the log does
not tell which ticks the joint has, the two agree to a tenth of that."""

SEARCH_TICK = 0.004
"""The search walks logs that have more rows on ticks of so many whole periods as fit into this [s]:
where to look for the best fit does not depend on it."""

LEAST_MOTION = 1e-12
"""Angles and requests that span less do not change [rad]: that is rounding."""

ROUNDED = 1e-9
"""Errors below this, relative to the spread of the angles, are rounding."""


def fitted(logs: Sequence[Log], clock: Clock, *, choose_tick: bool = False) -> Adjusted:
    """Fit the joint to all logs.

    Args:
        logs: The logs.
        clock: Their ticks.
        choose_tick: Whether ticks of a whole period may do instead, where they fit better.

    Raises:
        InvalidInput: There is no motion to fit.
    """
    delay, _ = best_delay(moving(gridded(logs, tick=clock.tick, reach=clock.reach, burn_in=0.0)))
    burn_in = min(2.0 * delay + 2.0 * clock.period, clock.reach)
    stride = clock.period * max(1, int(SEARCH_TICK / clock.period * (1.0 + 1e-9)))
    coarse = moving(gridded(logs, tick=stride, reach=clock.reach, burn_in=burn_in))
    found = searched(coarse)
    fine = gridded(logs, tick=clock.tick, reach=clock.reach, burn_in=burn_in)
    fits = [
        adjust(fine, fit.parameters, scale=found[0].scale, steps=25, precision=1e-3)
        for fit in _unlike(found)
    ]
    best = min(fits, key=lambda fit: fit.cost)
    window = best.parameters.lag + best.parameters.acceleration_time
    settled = settled_pieces(logs, best)
    if settled or window > burn_in:
        burn_in = min(max(burn_in, 1.2 * window), clock.reach)
        final = gridded(logs, tick=clock.tick, reach=clock.reach, burn_in=burn_in, settled=settled)
        best = adjust(moving(final), best.parameters, scale=best.scale, steps=15, precision=1e-3)
    best = nearby(best)
    if choose_tick and clock.hold > 1:
        period = clock.period
        rows = gridded(logs, tick=period, reach=clock.reach, burn_in=burn_in, settled=settled)
        begin = found[0].parameters
        simple = adjust(rows, begin, scale=best.scale, steps=15, precision=1e-3)
        best = nearby(simple) if simple.cost < (1.0 - WORTH_COARSER) * best.cost else best
    return adjust(best.grid, best.parameters, starts=best.starts)


def _unlike(found: list[Adjusted]) -> list[Adjusted]:
    """The best fit, and the next one if it is nearly as good but not the same."""
    for other in found[1:]:
        if other.cost > AS_GOOD * found[0].cost:
            break
        pairs = zip(found[0].parameters[2:4], other.parameters[2:4], strict=True)
        if max(abs(one - two) for one, two in pairs) > found[0].grid.tick / 2.0:
            return [found[0], other]
    return found[:1]


def moving(grid: Grid) -> Grid:
    """The grid, or why nothing can be learned from it."""
    if len(grid.angles) < 10:
        raise InvalidInput(
            f"the log has {len(grid.angles)} rows to learn from, expected 10 or more with torque on"
        )
    if np.ptp(grid.requests) <= LEAST_MOTION:
        raise InvalidInput(
            "the requests never change in this log: record one in which the joint is told to move"
        )
    if np.ptp(grid.angles) <= LEAST_MOTION:
        raise InvalidInput(
            "the joint does not move in this log: its actual angle is the same in every row; is "
            "the torque on, and is this the right column?"
        )
    return grid


def settled_pieces(logs: Sequence[Log], fit: Adjusted) -> set[Place]:
    """Pieces whose first rows say that their first request had been in force before."""
    grid = fit.grid
    pieces = {(i, piece.start) for i, log in enumerate(logs) for piece in pieces_of(log)}
    every = gridded(logs, tick=grid.tick, reach=grid.reach, burn_in=0.0)
    whole = adjust(every, fit.parameters, free=np.zeros(5, dtype=bool), scale=fit.scale, steps=4)
    errors = every.per_log(whole.residuals)
    bound = max(SETTLED * fit.scale, ROUNDED * float(np.std(grid.angles)))
    found = set()
    for number, row in pieces:
        new = every.places[number] & ~grid.places[number]
        stop = next((p.stop for p in pieces_of(logs[number]) if p.start == row), 0)
        new[:row] = new[stop:] = False
        if new.any() and np.sqrt(np.mean(errors[number][new] ** 2)) <= bound:
            found.add((number, row))
    return found
