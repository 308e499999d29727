"""The parameters that fit best: Levenberg-Marquardt steps under Huber's loss."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from planner.identification.adjusted import Adjusted
from planner.identification.derivatives import derivatives
from planner.identification.grid import Grid
from planner.identification.loss import NO_ERROR, huber, scale_of
from planner.identification.simulation import Parameters, pulls_of, respond
from planner.trajectory import Array

FASTEST = 1.9
"""Largest gain times tick; from 2 on the joint would not come to rest."""

ALL = np.ones(5, dtype=bool)
"""Every parameter free."""


def adjust(
    grid: Grid,
    begin: Parameters,
    *,
    free: np.ndarray = ALL,
    starts: Array | None = None,
    scale: float | None = None,
    rounds: int = 6,
    steps: int = 40,
    precision: float = 1e-7,
    enough: float = -math.inf,
) -> Adjusted:
    """Fit the free parameters and the start of every run, from ``begin`` on.

    The scale of the loss follows the residuals, from round to round, unless it is given.

    Args:
        grid: The rows.
        begin: Where to begin; what is not free stays.
        free: Which parameters to fit, in their order.
        starts: Where the runs start, to begin with [rad]; by default where they were measured.
        scale: Fixed scale of Huber's loss [rad].
        rounds: Most estimates of the scale.
        steps: Most steps a round.
        precision: Steps below this, relative to what the parameters count in, end a round.
        enough: Loss that need not be improved on [rad^2].

    Returns:
        The best fit found.
    """
    spread = float(np.std(grid.angles))
    floor = NO_ERROR * max(spread, 1e-300)
    if starts is None:
        starts = grid.measured_starts
    at = _at(grid, _within(grid, begin), starts, scale or math.inf, free=free)
    for _ in range(1 if scale else rounds):
        if scale is None:
            found = scale_of(at.residuals, floor)
            settled = abs(found - at.scale) <= 1e-3 * found
            at = _rescaled(at, found)
            if settled:
                break
        at = _descend(at, steps, precision, enough)
    return at


def _descend(at: Adjusted, steps: int, precision: float, enough: float) -> Adjusted:
    """Levenberg-Marquardt steps at a fixed scale."""
    damping, slope, idle = 1e-4, None, 0
    for _ in range(steps):
        if at.cost <= enough:
            break
        if slope is None:
            slope = slopes(at)
        step, moved = _step(at, slope, damping)
        after = _at(at.grid, moved, at.starts + step.starts, at.scale, at.states, at.free)
        small = step.size <= precision
        if after.cost < at.cost:
            gained = at.cost - after.cost
            at, slope = after, None
            damping = max(damping / 8.0, 1e-9)
            idle = idle + 1 if gained <= precision * at.cost else 0
            if idle and (small or idle > 2):
                break
        else:
            if small or damping > 1e8:
                break
            damping *= 6.0
    return at


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of the predicted angles at the rows, the starts of the runs taken out.

    Attributes:
        by_parameter: By log gain, log v_max, lag [ticks], acceleration time [ticks] and offset,
            (rows, 5), free of what a change of the starts could do as well.
        raw: The same with the starts held.
        by_start: By the start of its run, (rows,).
        norms: Weighted squares of ``by_start`` in each run, (runs,).
    """

    by_parameter: Array
    raw: Array
    by_start: Array
    norms: Array


def units(grid: Grid, parameters: Parameters) -> Array:
    """What the search counts the parameters in: itself for gain and v_max, ticks for times."""
    top = parameters.v_max if math.isfinite(parameters.v_max) else 0.0
    return np.array([parameters.gain, top, grid.tick, grid.tick, 1.0])


def slopes(at: Adjusted, *, blur: float = 0.0) -> Slopes:
    """Derivatives at a fit, see :class:`Slopes`; ``blur`` [s] as in the simulation."""
    grid = at.grid
    change = derivatives(grid, at.parameters, at.states, at.pulls, blur=blur)
    raw = grid.at_rows(change.by_parameter) * units(grid, at.parameters)
    by_start = grid.at_rows(change.by_start)
    runs = len(grid.starts)
    norms: Array = np.bincount(grid.run, at.weights * by_start**2, runs).astype(float)
    along: Array = np.stack(
        [np.bincount(grid.run, at.weights * by_start * column, runs) for column in raw.T], axis=1
    )
    shares = along / np.maximum(norms, 1e-300)[:, np.newaxis]
    return Slopes(raw - by_start[:, np.newaxis] * shares[grid.run], raw, by_start, norms)


@dataclass(frozen=True, eq=False)
class _Step:
    parameters: Array
    starts: Array
    size: float


def _step(at: Adjusted, slope: Slopes, damping: float) -> tuple[_Step, Parameters]:
    """One damped step, within the bounds: what would leave them is held and the step taken anew."""
    grid, residuals = at.grid, at.residuals
    weighted = at.weights[:, np.newaxis] * slope.by_parameter
    matrix = weighted.T @ slope.by_parameter
    gradient = weighted.T @ residuals
    scaling = units(grid, at.parameters)
    free = at.free & (np.diag(matrix) > 0.0)
    delta = np.zeros(5)
    for _ in range(4):
        active = np.flatnonzero(free)
        delta[:] = 0.0
        if len(active):
            block = matrix[np.ix_(active, active)]
            block = block + damping * np.diag(np.diag(block))
            delta[active] = -np.linalg.lstsq(block, gradient[active], rcond=1e-14)[0]
        delta[:2] = np.clip(delta[:2], -1.0, 1.0)
        wanted = _moved(at.parameters, delta, scaling)
        moved = _within(grid, wanted)
        held = free & (np.array(at.parameters) == np.array(moved)) & (delta != 0.0)
        if not held.any():
            break
        free = free & ~held
    pull = residuals + slope.raw @ delta
    runs = len(grid.starts)
    toward = np.bincount(grid.run, at.weights * slope.by_start * pull, runs)
    starts = -toward / np.maximum(slope.norms, 1e-300)
    size = float(np.max(np.abs(delta[:4]), initial=0.0))
    spread = max(float(np.std(grid.angles)), 1e-300)
    size = max(size, abs(float(delta[4])) / spread)
    return _Step(delta, starts, size), moved


def _moved(parameters: Parameters, delta: Array, scaling: Array) -> Parameters:
    return Parameters(
        gain=parameters.gain * math.exp(delta[0]),
        v_max=parameters.v_max * math.exp(delta[1]),
        lag=parameters.lag + delta[2] * scaling[2],
        acceleration_time=parameters.acceleration_time + delta[3] * scaling[3],
        offset=parameters.offset + delta[4],
    )


def _within(grid: Grid, parameters: Parameters) -> Parameters:
    """The parameters, moved into their bounds.

    An acceleration time below a tick is a tick: any weights on two neighbouring requests are those
    of some lag with an acceleration time of one tick.
    """
    lag = min(max(parameters.lag, 0.0), grid.reach - 2.0 * grid.tick)
    longest = grid.reach - grid.tick - lag
    return parameters._replace(
        gain=min(parameters.gain, FASTEST / grid.tick),
        lag=lag,
        acceleration_time=min(max(parameters.acceleration_time, grid.tick), longest),
    )


def _at(
    grid: Grid,
    parameters: Parameters,
    starts: Array,
    scale: float,
    guess: Array | None = None,
    free: np.ndarray = ALL,
) -> Adjusted:
    pulls = pulls_of(grid, parameters)
    states = respond(grid, parameters, starts, pulls=pulls, guess=guess)
    residuals = grid.at_rows(states) - grid.angles
    cost, weights = huber(residuals, scale)
    return Adjusted(grid, parameters, free, starts, pulls, states, scale, cost, weights)


def _rescaled(at: Adjusted, scale: float) -> Adjusted:
    cost, weights = huber(at.residuals, scale)
    return replace(at, scale=scale, cost=cost, weights=weights)
