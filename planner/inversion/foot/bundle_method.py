"""Multipliers that prove how close a foot can come to its path (``docs/math.md``, (13a))."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from planner.exceptions import SolverFailed
from planner.inversion.arguments import Norm
from planner.inversion.bounds.reachable_set import ReachableSet
from planner.inversion.foot.configuration_minima import Distance, minima
from planner.trajectory import Array

STEPS = 12
"""Most linearisations of the foot on the way to the nearest stationary point."""

STILL = 1e-5
"""Movement of all angles below which the point is stationary [rad]."""

PROXIMITY = 0.02
"""Weight of small steps, relative to how much the foot sees of a joint's angle."""

TOLERANCE = 1e-3
"""Share of a plan's squared error that the search for minima may leave unproved."""

RELUCTANCE = 3.0
"""What moving all pulls by their own size costs, relative to a plan's squared error."""


class Relaxation(NamedTuple):
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
        """Number of wanted positions."""
        return len(self.distance.wanted)

    def at_samples(self, rows: Sequence[Any]) -> list[Any]:
        """The entries at samples of one row of ticks for each joint."""
        return [row[each.sampled] for row, each in zip(rows, self.sets, strict=True)]


class Multipliers(NamedTuple):
    """What stands for the joints' conditions.

    Attributes:
        shares: Weights of the samples, 0 or more and together 1, shape (n,).
        conditions: One number, 0 or more, per row of each joint's set.
    """

    shares: Array
    conditions: list[Array]


class Column(NamedTuple):
    """Angles at every sample, (n, k), and the squared distance at each, (n,)."""

    angles: Array
    squared: Array


def proved_by(task: Relaxation, multipliers: Multipliers, guesses: Array) -> tuple[float, Array]:
    """The squared distance that multipliers prove, and the angles of least value, (n, k)."""
    pulls, constant = _pulls(task, multipliers.conditions)
    found = minima(
        task.distance, multipliers.shares, pulls, guesses, tolerance=TOLERANCE / task.samples
    )
    return float(np.sum(found.proved)) + constant, found.angles


def _pulls(task: Relaxation, conditions: Sequence[Array]) -> tuple[Array, float]:
    """Linear terms at the samples, (n, k), and what all that is not at samples adds at least."""
    pulls, constant = [], 0.0
    for each, given, low, high in zip(task.sets, conditions, *task.room, strict=True):
        pull = each.matrix.T @ given
        pulls.append(pull[each.sampled].copy())
        pull[each.sampled] = 0.0  # what is left pulls at ticks between samples
        constant += float(np.sum(np.minimum(pull * low, pull * high)) - each.limits @ given)
    return np.stack(pulls, axis=1), constant


def near_by(task: Relaxation, angles: Array) -> tuple[Array, Multipliers]:
    """The stationary point near some angles, in the box, (n, k), and its multipliers.

    Where the solver fails, those that it came to before, or none: they prove what they prove.
    """
    multipliers = nothing(task)
    for _ in range(STEPS):
        before = angles
        try:
            angles, multipliers = _step(task, before)
        except SolverFailed as failure:
            logging.getLogger(__name__).debug("foot bound: %s", failure)
            break
        if np.max(np.abs(angles - before)) <= STILL:
            break
    return angles, multipliers


def nothing(task: Relaxation) -> Multipliers:
    """Multipliers that take no notice of the joints: they prove how far poses are from the path."""
    none = [np.zeros(len(each.limits)) for each in task.sets]
    return Multipliers(np.full(task.samples, 1.0 / task.samples), none)


def _step(task: Relaxation, angles: Array) -> tuple[Array, Multipliers]:
    """The best angles where the foot moves as its derivatives say, and their multipliers."""
    cvxpy = _modelling()
    positions, jacobians = task.distance.errors(angles)
    errors = positions - task.distance.wanted * task.distance.scale
    ticks: list[Any] = [cvxpy.Variable(each.matrix.shape[1]) for each in task.sets]
    sampled = cvxpy.vstack(task.at_samples(ticks)).T
    moves = sampled - angles
    axes = [
        errors[:, axis] + cvxpy.sum(cvxpy.multiply(jacobians[:, axis], moves), axis=1)
        for axis in range(3)
    ]
    met = [each.matrix @ tick <= each.limits for each, tick in zip(task.sets, ticks, strict=True)]
    conditions = [*met, sampled >= task.distance.lower, sampled <= task.distance.upper]
    seen = float(np.mean(np.sum(jacobians**2, axis=1)))
    cost = PROXIMITY * seen / task.samples * cvxpy.sum_squares(moves)
    most = cvxpy.Variable()
    if task.norm == "rms":
        conditions.append(sum(map(cvxpy.sum_squares, axes)) / task.samples <= most)
    else:
        conditions.append(cvxpy.norm(cvxpy.vstack(axes), axis=0) <= most)
    _solve(cvxpy.Problem(cvxpy.Minimize(cost + most), conditions))
    multipliers = [np.maximum(condition.dual_value, 0.0) for condition in met]
    shares = np.full(task.samples, 1.0 / task.samples)
    if task.norm == "max":
        shares = _shares(conditions[-1].dual_value)
        # of the squared distance, whose slope is twice that of the distance, times it
        multipliers = [2.0 * float(most.value) * each for each in multipliers]
    reached = np.stack(task.at_samples([tick.value for tick in ticks]), axis=1)
    inside = np.clip(reached, task.distance.lower, task.distance.upper)
    return inside, Multipliers(shares, multipliers)


def _shares(proposed: Array) -> Array:
    """Weights that are 0 or more and together 1."""
    weights = np.maximum(proposed, 0.0)
    total = float(np.sum(weights))
    return weights / total if total > 0.0 else np.full(len(weights), 1.0 / len(weights))


def best_known(
    task: Relaxation, columns: Sequence[Column], centre: Multipliers, *, stride: float
) -> tuple[Multipliers, float]:
    """Multipliers that would prove most if all angles were among the columns, near the centre.

    This is a step of a proximal bundle method, in which every sample has its own cuts.

    Returns:
        The multipliers, and what they would prove; the centre and nothing where the solver fails.
    """
    cvxpy = _modelling()
    around, _ = _pulls(task, centre.conditions)
    size = float(np.sum(around**2))
    if size == 0.0:
        return centre, 0.0
    given: list[Any] = [cvxpy.Variable(len(each.limits), nonneg=True) for each in task.sets]
    pulled = [each.matrix.T @ row for each, row in zip(task.sets, given, strict=True)]
    pulls = cvxpy.vstack(task.at_samples(pulled)).T
    least = cvxpy.Variable(task.samples)
    shares: Any = centre.shares
    conditions = []
    if task.norm == "max":
        shares = cvxpy.Variable(task.samples, nonneg=True)
        conditions.append(cvxpy.sum(shares) == 1.0)
    conditions += [
        least
        <= cvxpy.multiply(column.squared, shares)
        + cvxpy.sum(cvxpy.multiply(column.angles, pulls), axis=1)
        for column in columns
    ]
    value = cvxpy.sum(least)
    for each, row, pull, low, high in zip(task.sets, given, pulled, *task.room, strict=True):
        value -= each.limits @ row
        between = np.setdiff1d(np.arange(each.matrix.shape[1]), each.sampled)
        if len(between):
            value += cvxpy.sum(cvxpy.minimum(pull[between] * low, pull[between] * high))
    apart = cvxpy.sum_squares(pulls - around) / size
    if task.norm == "max":
        apart += cvxpy.sum_squares(shares - centre.shares) / float(np.sum(centre.shares**2))
    problem = cvxpy.Problem(cvxpy.Maximize(value - RELUCTANCE / stride * apart), conditions)
    try:
        _solve(problem)
    except SolverFailed as failure:
        logging.getLogger(__name__).debug("foot bound: %s", failure)
        return centre, 0.0
    found = centre.shares if task.norm == "rms" else _shares(shares.value)
    multipliers = Multipliers(found, [np.maximum(row.value, 0.0) for row in given])
    return multipliers, float(value.value)


def _modelling() -> Any:
    """CVXPY, imported where it is used, and without the types that its atoms lack."""
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
