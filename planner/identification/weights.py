"""How much each row of a log counts: less in motion that the model misses by more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.identification.grid import Grid
from planner.identification.least_squares import Fit, least_squares
from planner.identification.parameters import only
from planner.model.evidence import OPTIONS, error_line
from planner.trajectory import Array, rms

LEAST_SHARE = 0.1
"""Error of the calmest motion, at least, as a share of that of the log's most accelerated one: a
smaller one is chance where the joint hardly moves."""


def weighted_by_motion(fit: Fit) -> Fit:
    """The fit to the same rows, each of which counts by what the model misses in such motion.

    The error of a model grows with the acceleration: (19) of ``docs/math.md``. Least squares of all
    rows alike would leave dry friction and sag, which calm rows show, to what is missing in fast
    ones. Weights are inverse to the error of the fit in such motion (Aitken, 1935).
    """
    grid = replace(fit.grid, weights=weights_of(fit))
    return least_squares(grid, fit.parameters, free=fit.free, starts=fit.starts)


def unweighted(fit: Fit) -> Fit:
    """The same joint, all of whose rows count alike."""
    grid = replace(fit.grid, weights=None)
    alike = least_squares(grid, fit.parameters, free=only(), starts=fit.starts)
    return replace(alike, free=fit.free)


def weights_of(fit: Fit) -> Array:
    """Weight of each used row [-], (rows,); weighted errors have the rms of the errors."""
    errors = fit.predicted - fit.grid.angles
    sizes, squares = around(fit.grid, _accelerations(fit) ** 2), around(fit.grid, errors**2)
    line = error_line(np.sqrt(sizes), np.sqrt(squares))
    expected = line[0] + line[1] * np.sqrt(sizes)
    weights = 1.0 / np.maximum(expected, LEAST_SHARE * float(np.max(expected)))
    return np.asarray(weights * (rms(errors) / rms(weights * errors)))


def around(grid: Grid, values: Array) -> Array:
    """Mean of the values of rows within a window of time about each, in its own run, (rows,)."""
    half = 0.5 * OPTIONS.window
    sums = np.concatenate([[0.0], np.cumsum(values)])
    numbers = np.arange(len(grid.starts))
    first = np.searchsorted(grid.run, numbers)[grid.run]
    beyond = np.searchsorted(grid.run, numbers, side="right")[grid.run]
    low = np.maximum(np.searchsorted(grid.times, grid.times - half), first)
    high = np.minimum(np.searchsorted(grid.times, grid.times + half, side="right"), beyond)
    return np.asarray(np.maximum(sums[high] - sums[low], 0.0) / (high - low))


def _accelerations(fit: Fit) -> Array:
    """Accelerations of the model at the used rows [rad/s^2], (rows,); 0 at the ends of runs."""
    grid, found = fit.grid, np.zeros(len(fit.predicted))
    steps = np.maximum(np.diff(grid.times), grid.tick)
    speeds = np.diff(fit.predicted) / steps
    found[1:-1] = 2.0 * np.diff(speeds) / (steps[1:] + steps[:-1])
    found[1:-1][grid.run[2:] != grid.run[:-2]] = 0.0
    return found
