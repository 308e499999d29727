"""Pictures of a log: what was requested, what the joint did, what the model says it does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from planner.report.style import CLOSED_FORM, DIRECT, GRID, INK, OPTIMAL, REQUESTED, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.identification.result import LogFit
    from planner.report.identification_parameters import Units
    from planner.trajectory import Array

BINS = 500
"""Parts of a long log, of which each is drawn by its least and its largest value."""

CLOSE_UP = 3.0
"""Length of the part that is drawn as it is [s]: some ten answers of a hobby servo."""

Rows = npt.NDArray[np.intp]

DOWNWEIGHTED = 0.5
"""Rows whose weight is below this are marked as outliers."""


def draw_close_up(fit: LogFit, units: Units, noise: float) -> Figure:
    """The seconds in which the joint is farthest from its requests, among those held out if any.

    Args:
        fit: The log.
        units: In which to draw.
        noise: Standard deviation to draw as a band about the residuals [rad].
    """
    rows = close_up(fit)
    figure, above, below = _axes()
    times = fit.log.times - fit.log.times[0]
    requests, angles = units.factor * fit.log.requests, units.factor * fit.log.angles
    above.step(times[rows], requests[rows], where="post", **REQUESTED.line)
    _draw_model(above, times, fit, units, rows, width=1.9)
    above.plot(
        times[rows], angles[rows], "o", ms=2.4, mew=0, color=INK.light, label="measured", zorder=4
    )
    _draw_residuals(below, times, fit, units, noise, rows)
    _finish(figure, above, below, units)
    below.set_xlim(times[rows][0], times[rows][-1])
    return figure


def draw_whole(fit: LogFit, units: Units, noise: float) -> Figure:
    """The whole log, the part held out shaded; long ones by least and largest value.

    Args:
        fit: The log.
        units: In which to draw.
        noise: Standard deviation to draw as a band about the residuals [rad].
    """
    rows = np.arange(len(fit.log.times))
    figure, above, below = _axes()
    times = fit.log.times - fit.log.times[0]
    for axes in (above, below):
        _shade(axes, times, fit)
    requests, angles = units.factor * fit.log.requests, units.factor * fit.log.angles
    above.plot(*thinned(times, requests), **{**REQUESTED.line, "linewidth": 1.0})
    above.plot(*thinned(times, angles), color=INK.light, lw=1.3, label="measured")
    _draw_model(above, times, fit, units, rows, width=0.9)
    _draw_residuals(below, times, fit, units, noise, rows)
    _finish(figure, above, below, units)
    below.set_xlim(times[0], times[-1])
    return figure


def close_up(fit: LogFit) -> Rows:
    """The rows of the seconds to look at closely."""
    log = fit.log
    rows = fit.held_out & fit.used if (fit.held_out & fit.used).any() else fit.used
    error = np.where(rows, (log.requests - log.angles) ** 2, 0.0)
    summed = np.concatenate([[0.0], np.cumsum(error)])
    ends = np.searchsorted(log.times, log.times + CLOSE_UP, side="right")
    whole = log.times + CLOSE_UP <= log.times[np.flatnonzero(rows)[-1]]
    found = summed[ends] - summed[:-1]
    start = int(np.argmax(np.where(whole, found, -1.0))) if whole.any() else 0
    return np.arange(start, ends[start])


def thinned(times: Array, values: Array, *, bins: int = BINS) -> tuple[Array, Array]:
    """A curve for drawing: of every part the least and the largest value, NaN where it has none."""
    if len(values) <= 2 * bins:
        return times, values
    chosen = []
    for rows in np.array_split(np.arange(len(values)), bins):
        known = rows[np.isfinite(values[rows])]
        if not len(known):
            chosen.append(rows[:1])
            continue
        ends = (known[np.argmin(values[known])], known[np.argmax(values[known])])
        chosen.append(np.unique(ends))
    kept = np.concatenate(chosen)
    return times[kept], values[kept]


def _axes() -> tuple[Figure, Axes, Axes]:
    """A panel for angles above a lower one for residuals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.3, 1.0))
    return figure, above, below


def _draw_model(
    axes: Axes, times: Array, fit: LogFit, units: Units, rows: Rows, *, width: float
) -> None:
    """The prediction: of the model that never saw the rows where there is one, else of the last."""
    for shown, role, label in (
        (~fit.held_out[rows], CLOSED_FORM, "model, fitted"),
        (fit.held_out[rows], OPTIMAL, "model, rows held out"),
    ):
        line = np.where(shown, units.factor * prediction(fit)[rows], np.nan)
        if np.isfinite(line).any():
            axes.plot(*thinned(times[rows], line), color=role.light, lw=width, label=label)


def _draw_residuals(
    axes: Axes, times: Array, fit: LogFit, units: Units, noise: float, rows: Rows
) -> None:
    residuals = units.factor * (fit.log.angles - prediction(fit))
    band = 2.0 * units.factor * noise
    axes.axhspan(-band, band, color=CLOSED_FORM.light, alpha=0.16, lw=0, label="± 2 noise")
    axes.plot(*thinned(times[rows], residuals[rows]), color=INK.light, lw=0.9)
    outliers = rows[fit.used[rows] & (fit.weights[rows] < DOWNWEIGHTED)]
    if len(outliers):
        few = outliers[:: max(1, len(outliers) // BINS)]
        axes.plot(
            times[few], residuals[few], "o", ms=2.8, mew=0, color=DIRECT.light, label="outliers"
        )


def prediction(fit: LogFit) -> Array:
    """The prediction of each row [rad], by a model that had not seen it where there is one."""
    return np.where(fit.held_out, fit.held_out_predicted, fit.predicted)


def _shade(axes: Axes, times: Array, fit: LogFit) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fit.held_out.astype(int), [0]])))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        axes.axvspan(times[start], times[end - 1], color=GRID.light, alpha=0.6, lw=0, zorder=0)


def _finish(figure: Figure, above: Axes, below: Axes, units: Units) -> None:
    above.set_ylabel(f"{'angle' if units.si else 'position'} [{units.angle}]")
    below.set_ylabel(f"residual [{units.angle}]")
    below.set_xlabel("time [s]")
    above.margins(y=0.08)
    figure.align_ylabels([above, below])
    handles, labels = above.get_legend_handles_labels()
    more = below.get_legend_handles_labels()
    figure.legend([*handles, *more[0]], [*labels, *more[1]], loc="outside upper left", ncols=3)
