"""The parameters that fit best: least squares under Huber's loss, whose scale follows the rows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import optimize, sparse

from planner.identification.parameters import (
    BASE,
    Free,
    Parameters,
    bounds_of,
    coordinates_of,
    only,
    parameters_at,
)
from planner.identification.resampling import Grid
from planner.identification.robust_loss import NO_ERROR, huber, scale_of
from planner.identification.robust_loss import OPTIONS as LOSS
from planner.identification.sensitivities import Sensitivities, sensitivities
from planner.identification.simulation import ActiveRequests, active_requests, respond
from planner.trajectory import Array

USUAL = only(*BASE)
"""What is fitted where nothing else is asked for: the terms stay what they are."""


@dataclass(frozen=True)
class Effort:
    """How far a fit is taken.

    Attributes:
        evaluations: Of the model, in each round.
        tolerance: Relative change of the loss that ends a round.
        rounds: Estimates of the scale.
    """

    evaluations: int
    tolerance: float
    rounds: int = 1


@dataclass(frozen=True, kw_only=True)
class LeastSquaresOptions:
    """How far the fits of an identification are taken.

    In brackets what was measured on seven reference logs (four made, three recorded;
    ``scripts/reference``): the change of the error on all rows, and on those that are held out.

    Attributes:
        first_step: Share of the residuals that the first step may explain, parameter by parameter:
            longer steps jump to delays a cycle away. On a pure sine the fit ends in a local optimum
            at 0.1 and at 0.4; from 1 on the recording of a servo under load is fitted 8 % worse.
            (Half: 0.00 and up to 2.4 %; twice: 0.7 and 14 %.)
        quick: Tells a good start from a poor one (half the evaluations: 0.07 and 26 %, twice: none
            and -1.4 %; a tenth or ten times the tolerance, or one round: 0.19 %).
        search: To a loss that is right to a thousandth, which tells one local optimum from another
            (half and twice the evaluations or rounds: none; a tenth of the tolerance: 0.00 and
            -0.6 % in 1.2 times the time, ten times: 0.00 and 12 %).
        profile: Tells whether a value is refuted, from a fit with a value close by (half and twice
            the evaluations: none; a tenth of the tolerance: one end of 70 moves, by a third).
        full: To the optimum: parameters to a millionth of their standard deviations (half the
            evaluations: 0.002 %; a tenth or ten times the tolerance, half the rounds: 0.000 %).
        settled_scale: A change of the scale by less than this share of it ends the rounds (half
            and twice: none).
        most_dense: Runs up to which derivatives are a dense matrix; beyond, most of it is zeros.
            Dense, 70 runs take 1.9 times as long and 150 runs 6 times; sparse, a single run takes
            twice as long.
    """

    first_step: float = 0.2
    quick: Effort = Effort(evaluations=12, tolerance=1e-3, rounds=2)
    search: Effort = Effort(evaluations=25, tolerance=1e-4, rounds=6)
    profile: Effort = Effort(evaluations=15, tolerance=1e-4)
    full: Effort = Effort(evaluations=60, tolerance=1e-9, rounds=6)
    settled_scale: float = 1e-3
    most_dense: int = 64


OPTIONS = LeastSquaresOptions()


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit to the rows of a grid.

    Attributes:
        grid: The rows.
        parameters: The joint.
        free: Which parameters were fitted, in their order.
        starts: Angle at the start of each run [rad].
        active: The requests that act at each tick.
        states: Angles at all states [rad].
        scale: Standard deviation of the residuals without outliers [rad].
        cost: Huber's loss at that scale, sum over the rows [rad^2]; half a sum of squares.
        weights: Weight of each row, 1 unless its residual is an outlier.
    """

    grid: Grid
    parameters: Parameters
    free: Free
    starts: Array
    active: ActiveRequests
    states: Array
    scale: float
    cost: float
    weights: Array

    @property
    def free_names(self) -> tuple[str, ...]:
        """What was fitted, in the order of :class:`Parameters`."""
        return tuple(np.array(Parameters._fields)[self.free].tolist())

    @property
    def predicted(self) -> Array:
        """Angle at the used rows [rad]."""
        return self.grid.at_rows(self.states)

    @cached_property
    def residuals(self) -> Array:
        """Predicted minus actual angle at the used rows [rad]."""
        return self.predicted - self.grid.angles

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, outliers included [rad]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def sensitivities(self, **options: float) -> Sensitivities:
        """Derivatives of the predicted angles by what was fitted."""
        return sensitivities(
            self.grid, self.parameters, self.states, self.active, free=self.free, **options
        )


def least_squares(
    grid: Grid,
    begin: Parameters,
    *,
    free: Free = USUAL,
    starts: Array | None = None,
    scale: float | None = None,
    effort: Effort = OPTIONS.full,
    enough: float = -math.inf,
) -> Fit:
    """Fit the free parameters and the first angle of every run: (15) of ``docs/math.md``.

    SciPy's Gauss-Newton method in a trust region (More's form of Levenberg-Marquardt), with the
    derivatives of (16). Bounds are kept by projection: a coordinate beyond its bound acts
    as if it were on it, and has no slope. SciPy's own methods for bounds, ``trf`` and ``dogbox``,
    stop where a corner of the loss meets a bound. The scale of the loss follows the residuals, from
    round to round, unless it is given.

    Args:
        grid: The rows.
        begin: Where to begin; what is not free stays.
        free: Which parameters to fit, in their order.
        starts: First angles of the runs, to begin with [rad]; by default those measured.
        scale: Fixed scale of Huber's loss [rad].
        effort: How far to go.
        enough: Loss that need not be improved on [rad^2].

    Returns:
        The best fit found; never worse than where it began.
    """
    floor = NO_ERROR * max(float(np.std(grid.angles)), 1e-300)
    if starts is None:
        starts = grid.measured_starts
    fit = _evaluated(grid, _within(grid, begin, free), starts, scale or math.inf, free)
    if scale is not None:
        return _minimised(fit, effort, enough)
    for _ in range(effort.rounds):
        found = scale_of(fit.residuals, floor)
        settled = abs(found - fit.scale) <= OPTIONS.settled_scale * found
        cost, weights = huber(fit.residuals, found)
        fit = replace(fit, scale=found, cost=cost, weights=weights)
        if settled:
            break
        fit = _minimised(fit, effort, enough)
    return fit


def _minimised(begin: Fit, effort: Effort, enough: float) -> Fit:
    """The best fit at a fixed scale."""
    if begin.cost <= enough:
        return begin
    grid, free, scale = begin.grid, begin.free, begin.scale
    chosen = np.flatnonzero(free)
    held = coordinates_of(grid, begin.parameters)
    span, runs = grid.span, len(grid.starts)
    size = OPTIONS.first_step * float(np.linalg.norm(begin.residuals)) or 1.0
    rows = np.arange(len(grid.angles))
    lower, upper = (coordinates_of(grid, ends) for ends in bounds_of(grid))
    lower[~free], upper[~free] = -np.inf, np.inf
    fits: dict[bytes, Fit] = {}
    accepted = begin

    def at(unknowns: Array) -> Fit:
        key = unknowns.tobytes()
        if key not in fits:
            coordinates = held.copy()
            coordinates[chosen] += unknowns[: len(chosen)]
            starts = begin.starts + span * unknowns[len(chosen) :]
            joint = parameters_at(grid, np.clip(coordinates, lower, upper))
            fits.clear()
            fits[key] = _evaluated(grid, joint, starts, scale, free)
        return fits[key]

    def residuals(unknowns: Array) -> Array:
        return at(unknowns).residuals / size

    def derivatives(unknowns: Array) -> Any:
        nonlocal accepted
        accepted = at(unknowns)
        slopes = accepted.sensitivities()
        by_parameter = slopes.by_parameter / size
        by_start = span / size * slopes.by_start
        here = held[chosen] + unknowns[: len(chosen)]
        by_parameter *= (here >= lower[chosen]) & (here <= upper[chosen])
        if runs > OPTIONS.most_dense:
            ends = sparse.csr_array((by_start, (rows, grid.run)), shape=(len(rows), runs))
            return sparse.csr_matrix(sparse.hstack([sparse.csr_array(by_parameter), ends]))
        matrix = np.zeros((len(rows), len(chosen) + runs))
        matrix[:, : len(chosen)] = by_parameter
        matrix[rows, len(chosen) + grid.run] = by_start
        return matrix

    def stop_early(intermediate_result: Any) -> None:
        if size**2 * intermediate_result.cost <= enough:
            raise StopIteration

    optimize.least_squares(
        residuals,
        np.zeros(len(chosen) + runs),
        derivatives,
        method="trf",
        loss="huber",
        f_scale=LOSS.corner * scale / size,
        x_scale="jac",
        ftol=effort.tolerance,
        xtol=1e-3 * effort.tolerance,
        gtol=None,
        max_nfev=effort.evaluations,
        callback=stop_early,
    )
    best = min((accepted, *fits.values()), key=lambda fit: fit.cost)
    return best if best.cost < begin.cost else begin


def _within(grid: Grid, parameters: Parameters, free: Free) -> Parameters:
    """The parameters, those that are free moved into their bounds."""
    ends = zip(parameters, *bounds_of(grid), free, strict=True)
    return Parameters(*(min(max(at, low), high) if moves else at for at, low, high, moves in ends))


def _evaluated(
    grid: Grid,
    parameters: Parameters,
    starts: Array,
    scale: float,
    free: Free = USUAL,
) -> Fit:
    active = active_requests(grid, parameters)
    states = respond(grid, parameters, starts, active=active)
    residuals = grid.at_rows(states) - grid.angles
    cost, weights = huber(residuals, scale)
    return Fit(grid, parameters, free, starts, active, states, scale, cost, weights)
