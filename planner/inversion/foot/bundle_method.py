"""Multipliers that prove how close a foot can come to its path (``docs/math.md``, (13a)).

They maximise a concave dual function that is known by its values and subgradients alone. A proximal
bundle method (Lemaréchal 1975, Kiwiel 1990) collects them and steps to the maximum of the model
that they make, held near the best multipliers so far.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from planner.exceptions import SolverFailed
from planner.inversion.arguments import Norm
from planner.inversion.bounds.reachable_set import ReachableSet
from planner.inversion.foot.configuration_minima import Distance, minima
from planner.trajectory import Array


@dataclass(frozen=True)
class BundleOptions:
    """How multipliers are proposed: by a Gauss-Newton search first, then by the bundle method.

    Attributes:
        linearisations: Most of them on the way to the nearest stationary point [-].
        stationary: Movement of all angles below which a point is stationary [rad].
        proximal: Weight of small steps of that search, relative to how much the foot sees of a
            joint's angle [-].
        tolerance: Share of a plan's squared error that the search for minima may leave unproved.
        reluctance: Proximal weight of the bundle method: what moving all linear terms by their own
            size costs, relative to a plan's squared error [-].
    """

    linearisations: int = 12
    stationary: float = 1e-5
    proximal: float = 0.02
    tolerance: float = 1e-3
    reluctance: float = 3.0


OPTIONS = BundleOptions()


class LagrangianRelaxation(NamedTuple):
    """The foot's distance and the sets in which the joints' angles lie.

    Attributes:
        distance: Scaled so that the error of a known plan is 1.
        sets: What every response of each joint meets, k of them.
        norm: Root mean square or largest distance.
        room: Angles between which each joint is at all ticks, those between samples too [rad], (k,)
            and (k,).
    """

    distance: Distance
    sets: Sequence[ReachableSet]
    norm: Norm
    room: tuple[Array, Array]

    @property
    def samples(self) -> int:
        """Number of desired positions."""
        return len(self.distance.desired)

    def at_samples(self, rows: Sequence[Any]) -> list[Any]:
        """The entries at samples of one row of ticks for each joint."""
        return [row[each.sampled] for row, each in zip(rows, self.sets, strict=True)]


class Multipliers(NamedTuple):
    """What stands for the joints' conditions.

    Attributes:
        weights: Weights of the samples, 0 or more and together 1, shape (n,).
        conditions: One number, 0 or more, per row of each joint's set.
    """

    weights: Array
    conditions: list[Array]


class Column(NamedTuple):
    """Angles at every sample, (n, k), and the squared distance at each, (n,)."""

    angles: Array
    squared: Array


def dual_function(
    relaxation: LagrangianRelaxation, multipliers: Multipliers, guesses: Array
) -> tuple[float, Array]:
    """The squared distance that multipliers prove, and the angles of least value, (n, k)."""
    slopes, constant = _linear_terms(relaxation, multipliers.conditions)
    found = minima(
        relaxation.distance,
        multipliers.weights,
        slopes,
        guesses,
        tolerance=OPTIONS.tolerance / relaxation.samples,
    )
    return float(np.sum(found.proved)) + constant, found.angles


def _linear_terms(
    relaxation: LagrangianRelaxation, conditions: Sequence[Array]
) -> tuple[Array, float]:
    """Linear terms at the samples, (n, k), and what all that is not at samples adds at least."""
    slopes, constant = [], 0.0
    for each, multipliers_of, low, high in zip(
        relaxation.sets, conditions, *relaxation.room, strict=True
    ):
        gradient = each.matrix.T @ multipliers_of
        slopes.append(gradient[each.sampled].copy())
        gradient[each.sampled] = 0.0  # what is left acts between samples
        constant += float(
            np.sum(np.minimum(gradient * low, gradient * high)) - each.limits @ multipliers_of
        )
    return np.stack(slopes, axis=1), constant


def stationary_point(relaxation: LagrangianRelaxation, angles: Array) -> tuple[Array, Multipliers]:
    """The stationary point near some angles, in the box, (n, k), and its multipliers.

    Where the solver fails, those that it came to before, or none: they prove what they prove.
    """
    multipliers = zero_multipliers(relaxation)
    for _ in range(OPTIONS.linearisations):
        before = angles
        try:
            angles, multipliers = _step(relaxation, before)
        except SolverFailed as failure:
            logging.getLogger(__name__).debug("foot bound: %s", failure)
            break
        if np.max(np.abs(angles - before)) <= OPTIONS.stationary:
            break
    return angles, multipliers


def zero_multipliers(relaxation: LagrangianRelaxation) -> Multipliers:
    """Multipliers without the joints' conditions: how far any configuration is from the path."""
    none = [np.zeros(len(each.limits)) for each in relaxation.sets]
    return Multipliers(np.full(relaxation.samples, 1.0 / relaxation.samples), none)


def _step(relaxation: LagrangianRelaxation, angles: Array) -> tuple[Array, Multipliers]:
    """The best angles where the foot moves as its derivatives say, and their multipliers."""
    cvxpy = _modelling()
    positions, jacobians = relaxation.distance.errors(angles)
    errors = positions - relaxation.distance.desired * relaxation.distance.scale
    ticks: list[Any] = [cvxpy.Variable(each.matrix.shape[1]) for each in relaxation.sets]
    sampled = cvxpy.vstack(relaxation.at_samples(ticks)).T
    moves = sampled - angles
    axes = [
        errors[:, axis] + cvxpy.sum(cvxpy.multiply(jacobians[:, axis], moves), axis=1)
        for axis in range(3)
    ]
    met = [
        each.matrix @ tick <= each.limits for each, tick in zip(relaxation.sets, ticks, strict=True)
    ]
    conditions = [*met, sampled >= relaxation.distance.lower, sampled <= relaxation.distance.upper]
    seen = float(np.mean(np.sum(jacobians**2, axis=1)))
    cost = OPTIONS.proximal * seen / relaxation.samples * cvxpy.sum_squares(moves)
    most = cvxpy.Variable()
    if relaxation.norm == "rms":
        conditions.append(sum(map(cvxpy.sum_squares, axes)) / relaxation.samples <= most)
    else:
        conditions.append(cvxpy.norm(cvxpy.vstack(axes), axis=0) <= most)
    _solve(cvxpy.Problem(cvxpy.Minimize(cost + most), conditions))
    multipliers = [np.maximum(condition.dual_value, 0.0) for condition in met]
    weights = np.full(relaxation.samples, 1.0 / relaxation.samples)
    if relaxation.norm == "max":
        weights = _normalised(conditions[-1].dual_value)
        # of the squared distance, whose slope is twice that of the distance, times it
        multipliers = [2.0 * float(most.value) * each for each in multipliers]
    reached = np.stack(relaxation.at_samples([tick.value for tick in ticks]), axis=1)
    inside = np.clip(reached, relaxation.distance.lower, relaxation.distance.upper)
    return inside, Multipliers(weights, multipliers)


def _normalised(proposed: Array) -> Array:
    """Weights that are 0 or more and together 1."""
    weights = np.maximum(proposed, 0.0)
    total = float(np.sum(weights))
    return weights / total if total > 0.0 else np.full(len(weights), 1.0 / len(weights))


def bundle_step(
    relaxation: LagrangianRelaxation, columns: Sequence[Column], centre: Multipliers, *, step: float
) -> tuple[Multipliers, float]:
    """Multipliers that would prove most if all angles were among the columns, near the centre.

    This is a step of a proximal bundle method, in which every sample has its own cuts.

    Returns:
        The multipliers, and what they would prove; the centre and 0 where the solver
        fails.
    """
    cvxpy = _modelling()
    around, _ = _linear_terms(relaxation, centre.conditions)
    size = float(np.sum(around**2))
    if size == 0.0:
        return centre, 0.0
    multipliers_of: list[Any] = [
        cvxpy.Variable(len(each.limits), nonneg=True) for each in relaxation.sets
    ]
    gradients = [
        each.matrix.T @ row for each, row in zip(relaxation.sets, multipliers_of, strict=True)
    ]
    slopes = cvxpy.vstack(relaxation.at_samples(gradients)).T
    least = cvxpy.Variable(relaxation.samples)
    weights: Any = centre.weights
    conditions = []
    if relaxation.norm == "max":
        weights = cvxpy.Variable(relaxation.samples, nonneg=True)
        conditions.append(cvxpy.sum(weights) == 1.0)
    conditions += [
        least
        <= cvxpy.multiply(column.squared, weights)
        + cvxpy.sum(cvxpy.multiply(column.angles, slopes), axis=1)
        for column in columns
    ]
    value = cvxpy.sum(least)
    for each, row, gradient, low, high in zip(
        relaxation.sets, multipliers_of, gradients, *relaxation.room, strict=True
    ):
        value -= each.limits @ row
        between = np.setdiff1d(np.arange(each.matrix.shape[1]), each.sampled)
        if len(between):
            value += cvxpy.sum(cvxpy.minimum(gradient[between] * low, gradient[between] * high))
    apart = cvxpy.sum_squares(slopes - around) / size
    if relaxation.norm == "max":
        apart += cvxpy.sum_squares(weights - centre.weights) / float(np.sum(centre.weights**2))
    problem = cvxpy.Problem(cvxpy.Maximize(value - OPTIONS.reluctance / step * apart), conditions)
    try:
        _solve(problem)
    except SolverFailed as failure:
        logging.getLogger(__name__).debug("foot bound: %s", failure)
        return centre, 0.0
    found = centre.weights if relaxation.norm == "rms" else _normalised(weights.value)
    multipliers = Multipliers(found, [np.maximum(row.value, 0.0) for row in multipliers_of])
    return multipliers, float(value.value)


def _modelling() -> Any:
    """CVXPY, imported where it is used, and untyped: its atoms have no types."""
    import cvxpy

    return cvxpy


def _solve(problem: Any) -> None:
    """Solve, or raise SolverFailed where there are no values and multipliers afterwards."""
    cvxpy = _modelling()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of accuracy: any multipliers prove what they prove
            problem.solve(solver=cvxpy.CLARABEL)
    except cvxpy.SolverError as error:
        raise SolverFailed("lower bound of the foot", str(error)) from error
    values = [variable.value for variable in problem.variables()]
    values += [condition.dual_value for condition in problem.constraints]
    if any(value is None or not np.all(np.isfinite(value)) for value in values):
        raise SolverFailed("lower bound of the foot", problem.status)
