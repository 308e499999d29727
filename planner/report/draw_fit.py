"""Pictures of a fit: its lines by how close they are to the top speed, and what more would buy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.style import APPROXIMATION, DESIRED, INK, MUTED, SURFACE, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.approximation.choices import Choices
    from planner.approximation.fit import PiecewiseLinearFit

ROW = 1.9
"""Height of one joint's row [inch]."""

PALE = 0.12
"""Where on the scale of colours a slope of zero lies: paler ones are lost on white."""

FLAT = 0.05
"""Least height of a picture of errors, relative to the floor: less is no difference."""


def draw_fits(fits: Mapping[str, PiecewiseLinearFit]) -> Figure:
    """Every joint's samples and the lines through them, coloured by |slope| / v_max."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, ROW * len(fits) + 0.5), layout="constrained")
    rows = figure.subplots(len(fits), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, fit) in zip(rows, fits.items(), strict=True):
        _draw_fit(axes, name, fit)
    _finish(figure, list(rows), next(iter(fits.values())))
    return figure


def draw_fits_and_choices(
    fits: Mapping[str, PiecewiseLinearFit], choices: Mapping[str, Choices]
) -> Figure:
    """The picture of :func:`draw_fits`, with error against number of lines beside every joint."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.75 * WIDTH, ROW * len(fits) + 0.6), layout="constrained")
    grid = figure.subplots(len(fits), 2, sharex="col", squeeze=False, width_ratios=(1.7, 1.0))
    for (left, right), (name, fit) in zip(grid, fits.items(), strict=True):
        _draw_fit(left, name, fit)
        draw_choices(right, choices[name], fit)
    grid[-1, 1].set_xlabel("number of lines")
    figure.align_ylabels(grid[:, 1])
    _finish(figure, list(grid[:, 0]), next(iter(fits.values())))
    handles, labels = grid[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    return figure


def draw_choices(axes: Axes, choices: Choices, fit: PiecewiseLinearFit) -> None:
    """Error against number of lines, the floor that v_max sets, and the automatic choice."""
    from matplotlib.ticker import MaxNLocator

    errors = np.degrees(choices.rms)
    axes.plot(choices.segments, errors, "o-", color=INK.light, lw=1.2, ms=3.2, label="rms error")
    floor = float(np.degrees(choices.floor))
    axes.axhline(floor, color=APPROXIMATION.light, lw=1.4, ls=(0, (5, 2)), label="floor by v_max")
    if choices.automatic in choices.segments:
        at = choices.segments.index(choices.automatic)
        axes.plot(
            choices.automatic,
            errors[at],
            "o",
            ms=9.0,
            mfc="none",
            mec=APPROXIMATION.light,
            mew=1.6,
            label="automatic",
        )
    axes.axvline(fit.segments, color=MUTED.light, lw=0.8, ls=":")
    top = float(np.max(errors, initial=floor))
    room = max(top - floor, FLAT * floor, 1e-9)
    axes.set_ylim(max(0.0, floor - 0.25 * room), floor + 1.1 * room)
    axes.set_ylabel("rms error [deg]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _draw_fit(axes: Axes, name: str, fit: PiecewiseLinearFit) -> None:
    n = fit.samples
    last = n if fit.cyclic else n - 1
    samples = np.arange(last + 1)
    axes.plot(samples, np.degrees(fit.desired[samples % n]), **{**DESIRED.line, "zorder": 2.0})
    # The curve from the first sample to the last, cut at every knot inside.
    cuts = np.unique(
        np.concatenate([[0.0], fit.knots[(fit.knots > 0) & (fit.knots < last)], [last]])
    )
    heights = np.degrees(fit(cuts))
    middle = 0.5 * (cuts[:-1] + cuts[1:])
    axes.add_collection(_lines(cuts, heights, np.abs(fit.slope_at(middle)) / fit.v_max))
    axes.plot(
        np.mod(fit.knots, n) if fit.cyclic else fit.knots,
        np.degrees(fit.values),
        "o",
        color=SURFACE.light,
        mec=INK.light,
        mew=1.0,
        ms=4.0,
        zorder=5,
        clip_on=False,
        label="knots",
    )
    axes.set_title(f"{name}: {fit.segments} lines, rms {np.degrees(fit.rms):.2f}°")
    axes.set_ylabel("angle [deg]")
    axes.margins(y=0.1)


def _lines(cuts: Any, heights: Any, share: Any) -> Any:
    """Lines between the cuts, coloured by their share of the top speed."""
    from matplotlib.collections import LineCollection

    points = np.column_stack([cuts, heights])
    lines = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)), cmap=_scale(), linewidths=2.6, zorder=3
    )
    lines.set_capstyle("round")
    lines.set_array(share)
    lines.set_clim(0.0, 1.0)
    return lines


def _scale() -> Any:
    """From pale at rest to dark at the top speed; lightness alone tells, whatever the eye."""
    import matplotlib as mpl
    from matplotlib.colors import ListedColormap

    return ListedColormap(mpl.colormaps["viridis_r"](np.linspace(PALE, 1.0, 256)), "to_top_speed")


def _finish(figure: Figure, rows: list[Axes], fit: PiecewiseLinearFit) -> None:
    last = fit.samples if fit.cyclic else fit.samples - 1
    figure.align_ylabels(rows)
    rows[-1].set_xlim(0, last)
    repeats = "; the path repeats" if fit.cyclic else ""
    rows[-1].set_xlabel(f"time [samples of {1000.0 * fit.tick:g} ms]{repeats}")
    bar = figure.colorbar(rows[0].collections[0], ax=rows, aspect=14.0 * len(rows), pad=0.02)
    bar.set_label("|slope| / v_max")
    bar.outline.set_visible(False)
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
