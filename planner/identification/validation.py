"""How well a fit to the first part of every log predicts the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.fit import (
    commanded_speed,
    errors_of,
    fit_joint,
    moving,
    peak_command,
    simple_fits,
    with_observed_speed,
)
from planner.identification.intervals import speed_bounded
from planner.identification.least_squares import Fit, respond, rms, sound_rms
from planner.identification.log import Log
from planner.identification.resampling import Grid, resampled
from planner.identification.terms import with_terms
from planner.identification.timestamps import Timing
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class ValidationOptions:
    """What is held out, and when it is no fair test.

    Attributes:
        fitted_share: Share of the rows with torque, from the start of each log, that are
            fitted. With a quarter the errors on the rest range from -8 % to four times those of
            the half, on seven reference logs (``scripts/reference``).
        faster: The rest may command speeds up to this factor above those of the fitted part (half
            and twice change no verdict on these logs).
    """

    fitted_share: float = 0.5
    faster: float = 1.1


OPTIONS = ValidationOptions()


class HeldOut(NamedTuple):
    """What the rows that were held out say.

    Attributes:
        rows: Which of the grid's rows were held out.
        predicted: Angle at them by the model fitted to the others [rad].
        rms: Its error [rad].
        sound_rms: The same without gross outliers [rad].
        alternatives: Error of each simpler description, fitted to the others too [rad].
        beyond: Whether they call for faster motion than the other rows, which do not say how fast
            the joint can be: the top speed then is that of the fit to all rows.
    """

    rows: np.ndarray
    predicted: Array
    rms: float
    sound_rms: float
    alternatives: dict[str, float]
    beyond: bool


def held_out(
    logs: Sequence[Log], timing: Timing, whole: Fit, *, faster: bool = False
) -> HeldOut | None:
    """Fit the first part of every log, predict the rest; None where there is nothing to fit in it.

    A top speed that the first part does not bound, and the rest may exceed, cannot be predicted
    from it: there that of the fit to all rows is taken, and the rest tests the other parameters.

    Args:
        logs: The logs.
        timing: Their ticks.
        whole: The fit to all rows that are used in the end.
        faster: Whether its top speed is that of rows that are not fitted; then it is taken, too.
    """
    grid = whole.grid
    middles = [_middle(log) for log in logs]
    parts = [_first_rows(log, middle) for log, middle in zip(logs, middles, strict=True)]
    known = [part for part in parts if part is not None]
    if not known:
        return None
    try:
        fit = with_terms(fit_joint(known, timing)).fit
    except InvalidInput:
        return None
    rows = np.concatenate(
        [np.flatnonzero(used) >= middle for used, middle in zip(grid.places, middles, strict=True)]
    )
    if not rows.any():
        return None
    shown = peak_command(fit)
    fit = with_observed_speed(fit)
    at, starts = fit.parameters, _starts(grid, fit, parts)
    response = respond(grid, at, starts)
    called = commanded_speed(at, response)
    beyond = called > OPTIONS.faster * shown and not speed_bounded(fit)
    if beyond or faster:
        at = at._replace(v_max=whole.parameters.v_max)
        response = respond(grid, at, starts)
    predicted = response.predicted
    simple = simple_fits(
        moving(resampled(known, tick=timing.tick, reach=timing.reach, burn_in=0.0))
    )
    first = grid.measured_starts
    others = {other.name: rms(errors_of(other, grid, first)[rows]) for other in simple}
    errors = (predicted - grid.angles)[rows]
    return HeldOut(
        rows=rows,
        predicted=predicted[rows],
        rms=rms(errors),
        sound_rms=sound_rms(errors),
        alternatives=others,
        beyond=beyond,
    )


def _middle(log: Log) -> int:
    """First row that is held out."""
    powered = np.flatnonzero(log.torque_on)
    if not len(powered):
        return 0
    return int(powered[min(int(np.ceil(OPTIONS.fitted_share * len(powered))), len(powered) - 1)])


def _first_rows(log: Log, middle: int) -> Log | None:
    if middle < 3:
        return None
    columns = ("times", "requests", "angles", "torque_on", "measured")
    first = replace(log, load=None, **{name: getattr(log, name)[:middle] for name in columns})
    return first if log.load is None else replace(first, load=log.load[:middle])


def _starts(grid: Grid, fit: Fit, parts: Sequence[Log | None]) -> Array:
    """Where the runs start: as fitted where the fit has seen it, else as measured."""
    numbers = [i for i, part in enumerate(parts) if part is not None]
    fitted_starts = {
        (numbers[log], row): start
        for (log, row), start in zip(fit.grid.firsts, fit.starts, strict=True)
    }
    pairs = zip(grid.firsts, grid.measured_starts, strict=True)
    return np.array([fitted_starts.get(first, angle) for first, angle in pairs])
