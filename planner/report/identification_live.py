"""A log to zoom into: requests, angles and prediction above, residuals below, row by row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.curves import Curve, Panel
from planner.report.identification_draw_log import DOWNWEIGHTED, close_up, prediction, thinned
from planner.report.live_plot import time_plot
from planner.report.style import CLOSED_FORM, DIRECT, INK, OPTIMAL, REQUESTED

if TYPE_CHECKING:
    from planner.identification.result import LogFit
    from planner.report.identification_parameters import Units
    from planner.trajectory import Array

BINS = 10_000
"""Parts of a log, of which each is drawn by its least and its largest value; a log of twice as many
rows, over three minutes at 100 Hz, is drawn row by row."""

MEASURED = INK._replace(label="measured", width=1.2)
RESIDUAL = INK._replace(label="residual", width=0.9)
FITTED = CLOSED_FORM._replace(label="model, fitted", width=1.4)
UNSEEN = OPTIMAL._replace(label="model, rows held out", width=1.4, dashes="-")


def log_plot(fit: LogFit, units: Units, noise: float) -> dict[str, Any]:
    """The whole log as a live plot, which a button brings to the seconds of the close-up.

    Args:
        fit: The log.
        units: In which to draw.
        noise: Standard deviation to draw as a band about the residuals [rad].
    """
    log = fit.log
    times = log.times - log.times[0]
    predicted = units.factor * prediction(fit)
    angles = units.factor * log.angles
    residuals = angles - predicted
    quantity = "angle" if units.si else "position"
    above = [
        _curve(REQUESTED._replace(width=1.1), times, units.factor * log.requests, held=True),
        _curve(MEASURED, times, angles),
        _curve(FITTED, times, np.where(fit.held_out, np.nan, predicted)),
        _curve(UNSEEN, times, np.where(fit.held_out, predicted, np.nan)),
    ]
    outliers = np.flatnonzero(fit.used & (fit.weights < DOWNWEIGHTED))
    below = [
        _curve(RESIDUAL, times, residuals),
        Curve(DIRECT, times[outliers], residuals[outliers], "outliers", dots=True),
    ]
    band = 2.0 * units.factor * noise
    close = times[close_up(fit)]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fit.held_out.astype(int), [0]])))
    return time_plot(
        [
            Panel("", quantity, units.angle, _drawn(above), height=1.9),
            Panel(
                "measured − predicted",
                "residual",
                units.angle,
                _drawn(below),
                band=band if np.isfinite(band) else None,
            ),
        ],
        unit="s",
        decimals=3,
        shaded=[
            (float(times[start]), float(times[end - 1]))
            for start, end in zip(edges[::2], edges[1::2], strict=True)
        ],
        views={
            "whole log": (0.0, float(times[-1])),
            "close-up": (float(close[0]), float(close[-1])),
        },
    )


def _curve(role: Any, times: Array, values: Array, *, held: bool = False) -> Curve:
    """A curve without the rows before its first and after its last value."""
    known = np.flatnonzero(np.isfinite(values))
    span = slice(known[0], known[-1] + 1) if len(known) else slice(0)
    return Curve(role, *thinned(times[span], values[span], bins=BINS), held=held)


def _drawn(curves: list[Curve]) -> tuple[Curve, ...]:
    return tuple(curve for curve in curves if len(curve.values))
