"""Multipliers that prove how close a foot can come to its path (``docs/math.md``, (13a)).

They maximise a concave dual function that is known by its values and subgradients alone. A proximal
bundle method (Lemaréchal 1975, Kiwiel 1990) collects these and steps to the maximum of the
resulting model, near the best multipliers so far. Its many steps go to Clarabel directly; the few
steps of the search before it are stated in CVXPY, which takes four times as long as the solver.

A value of the dual function needs, for every sample, a proved minimum of the foot's squared
distance plus a linear term in the angles. It is found by branch and bound: a box of angles is cut
into cells, and a cell is halved along every joint as long as it may contain less than the least
value so far (13b). All samples are searched at once, a block of them at a time.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from kinematics.chain import Chain
from planner.exceptions import SolverFailed
from planner.planning.arguments import Norm
from planner.planning.bounds.multipliers import Cones, ConicSolver
from planner.planning.bounds.reachable_set import ReachableSet
from planner.trajectory import Array

PROXIMAL = 0.02
"""Proximal weight of the Gauss-Newton search, relative to the mean square of the foot's Jacobian
[-]."""

TOLERANCE = 1e-3
"""Share of a plan's squared error that the search for minima may leave unproved."""

RELUCTANCE = 3.0
"""Proximal weight of the bundle method: cost of a change of all linear terms by their own size,
relative to a plan's squared error [-]."""


class LagrangianRelaxation(NamedTuple):
    """The foot's distance, and the reachable sets of the joints' angles.

    Attributes:
        distance: Scaled so that the error of a known plan is 1.
        sets: Conditions that every response of a joint meets, one set for each of the k joints.
        norm: Root mean square or largest distance.
        room: Least and greatest angles of each joint at all ticks, also between samples [rad], (k,)
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
    """Multipliers of the samples and of the joints' conditions.

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
    """The lower bound on the squared distance by multipliers, and its minimiser, (n, k)."""
    slopes, constant = _linear_terms(relaxation, multipliers.conditions)
    proved, angles = minima(
        relaxation.distance,
        multipliers.weights,
        slopes,
        guesses,
        tolerance=TOLERANCE / relaxation.samples,
    )
    return float(np.sum(proved)) + constant, angles


def _linear_terms(
    relaxation: LagrangianRelaxation, conditions: Sequence[Array]
) -> tuple[Array, float]:
    """Linear terms at the samples, (n, k), and the least sum of the terms between samples."""
    slopes, constant = [], 0.0
    for each, multipliers_of, low, high in zip(
        relaxation.sets, conditions, *relaxation.room, strict=True
    ):
        gradient = each.matrix.T @ multipliers_of
        slopes.append(gradient[each.sampled].copy())
        gradient[each.sampled] = 0.0  # the rest acts between samples
        constant += float(
            np.sum(np.minimum(gradient * low, gradient * high)) - each.limits @ multipliers_of
        )
    return np.stack(slopes, axis=1), constant


def stationary_point(relaxation: LagrangianRelaxation, angles: Array) -> tuple[Array, Multipliers]:
    """The stationary point near some angles, in the box, (n, k), and its multipliers.

    If the solver fails, the multipliers of the step before, or zero ones: any of them are valid.
    """
    multipliers = zero_multipliers(relaxation)
    for _ in range(12):
        before = angles
        try:
            angles, multipliers = _step(relaxation, before)
        except SolverFailed as failure:
            logging.getLogger(__name__).debug("foot bound: %s", failure)
            break
        if np.max(np.abs(angles - before)) <= 1e-5:  # [rad]
            break
    return angles, multipliers


def zero_multipliers(relaxation: LagrangianRelaxation) -> Multipliers:
    """Multipliers without the joints' conditions: the distance of any configuration."""
    none = [np.zeros(len(each.limits)) for each in relaxation.sets]
    return Multipliers(np.full(relaxation.samples, 1.0 / relaxation.samples), none)


def _step(relaxation: LagrangianRelaxation, angles: Array) -> tuple[Array, Multipliers]:
    """The best angles for a linearised foot, and their multipliers."""
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
    cost = PROXIMAL * seen / relaxation.samples * cvxpy.sum_squares(moves)
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
    """Multipliers of the greatest bound if all angles were among the columns, near the centre.

    This is a step of a proximal bundle method, in which every sample has its own cuts: a quadratic
    program.

    Returns:
        The multipliers, and their predicted bound; the centre and 0 where the solver fails.
    """
    around, _ = _linear_terms(relaxation, centre.conditions)
    size = float(np.sum(around**2))
    if size == 0.0:
        return centre, 0.0
    slope, matrix, limits, cones, counts = _bundle_problem(relaxation, columns, centre)
    # The proximal term keeps the linear terms and the weights near those of the centre.
    rates = [2.0 * RELUCTANCE / step / each for each in (size, np.sum(centre.weights**2))]
    proximal = np.repeat([0.0, rates[0], 0.0, 0.0, rates[1]], counts)
    proximal_centre = [np.zeros(count) for count in counts]
    proximal_centre[1], proximal_centre[4] = around.T.ravel(), centre.weights
    solver = ConicSolver(matrix, limits, cones, curvature=proximal, tolerance=1e-8)
    solution = solver.solve(slope - proximal * np.concatenate(proximal_centre))
    if not solution.solved:
        return centre, 0.0
    conditions, *_, weights = np.split(solution.unknowns, np.cumsum(counts)[:-1])
    sample_weights = centre.weights if relaxation.norm == "rms" else _normalised(weights)
    rows = np.cumsum([len(each.limits) for each in relaxation.sets])
    multipliers = np.split(np.maximum(conditions, 0.0), rows[:-1])
    return Multipliers(sample_weights, multipliers), -float(slope @ solution.unknowns)


def _bundle_problem(
    relaxation: LagrangianRelaxation, columns: Sequence[Column], centre: Multipliers
) -> tuple[Array, sparse.csr_array, Array, Cones, list[int]]:
    """The predicted bound by multipliers, negated, without the proximal term.

    Its unknowns are the multipliers of the conditions, their linear terms at the samples, joint by
    joint, the least value of those between samples, and the least value and weight of each sample.

    Returns:
        Slope, matrix, limits and cones of :class:`ConicSolver`, and the number of unknowns of each
        kind.
    """
    sets, samples = relaxation.sets, relaxation.samples
    gradients = sparse.block_diag([each.matrix.T for each in sets], format="csr")
    ticks = [each.matrix.shape[1] for each in sets]
    firsts = np.cumsum([0, *ticks[:-1]])
    at = np.concatenate([first + each.sampled for first, each in zip(firsts, sets, strict=True)])
    between = np.setdiff1d(np.arange(sum(ticks)), at)
    room = (sparse.diags_array(np.repeat(ends, ticks)[between]) for ends in relaxation.room)
    count, fixed = gradients.shape[1], relaxation.norm == "rms"
    each_sample = sparse.eye_array(samples)
    weight_rows = each_sample if fixed else sparse.csr_array(np.ones((1, samples)))
    zero = [
        [gradients[at], -sparse.eye_array(len(at)), None, None, None],
        [None, None, None, None, weight_rows],
    ]
    at_most: list[list[Any]] = [[-sparse.eye_array(count), None, None, None, None]]
    at_most += [
        [-end @ gradients[between], None, sparse.eye_array(len(between)), None, None]
        for end in room
    ]
    for column in columns:
        moved = sparse.hstack([sparse.diags_array(angles) for angles in column.angles.T])
        at_most.append([None, -moved, None, each_sample, -sparse.diags_array(column.squared)])
    at_most.append([None, None, None, None, -each_sample])
    counts = [count, len(at), len(between), samples, samples]
    slope = np.repeat([0.0, 0.0, -1.0, -1.0, 0.0], counts)
    slope[:count] = np.concatenate([each.limits for each in sets])
    zeros = len(at) + weight_rows.shape[0]
    matrix = sparse.csr_array(sparse.block_array([*zero, *at_most]))
    limits = np.zeros(matrix.shape[0])
    limits[len(at) : zeros] = centre.weights if fixed else 1.0
    return slope, matrix, limits, Cones(zeros, len(limits) - zeros), counts


def _modelling() -> Any:
    """CVXPY, imported where it is used, and untyped: its atoms have no types."""
    import cvxpy

    return cvxpy


def _solve(problem: Any) -> None:
    """Solve, or raise SolverFailed where there are no values and multipliers afterwards."""
    cvxpy = _modelling()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of accuracy: any multipliers are valid
            problem.solve(solver=cvxpy.CLARABEL)
    except cvxpy.SolverError as error:
        raise SolverFailed("lower bound of the foot", str(error)) from error
    values = [variable.value for variable in problem.variables()]
    values += [condition.dual_value for condition in problem.constraints]
    if any(value is None or not np.all(np.isfinite(value)) for value in values):
        raise SolverFailed("lower bound of the foot", problem.status)


WIDEST_CELL = float(np.radians(15.0))
"""Width of the first cells [rad], wider by steps of half of it where there would be too many."""

SAMPLES_AT_ONCE = 64
"""Samples in a block: each has up to a few thousand first cells."""

MOST_CELLS = 400_000
"""Most open cells of a block; beyond it the search stops with their bounds. So many occur only
where angles far apart are equally good, and take some 100 MB."""


class Distance(NamedTuple):
    """The squared distance of a leg's foot from its desired position, with scaled axes.

    Attributes:
        chain: The leg.
        lower: Least angles at each sample [rad], shape (n, k).
        upper: Greatest angles [rad], shape (n, k).
        desired: Desired foot positions [m], shape (n, 3).
        scale: Scale of each axis [1/m], shape (3,).
    """

    chain: Chain
    lower: Array
    upper: Array
    desired: Array
    scale: Array

    def by_axis(self, angles: Array) -> tuple[Array, Array]:
        """Scaled positions of the foot, (3, m), and their derivatives [1/rad], (k, 3, m)."""
        foot, columns = self.chain.foot_and_jacobian(np.cos(angles.T), np.sin(angles.T))
        scale = self.scale[:, np.newaxis]
        return scale * foot, scale * np.stack(columns)

    def errors(self, angles: Array) -> tuple[Array, Array]:
        """Scaled positions of the foot, (m, 3), and their derivatives [1/rad], (m, 3, k)."""
        positions, jacobians = self.by_axis(angles)
        return positions.T, jacobians.transpose(2, 1, 0)

    def squared(self, angles: Array) -> Array:
        """Scaled squared distances at one row of angles per sample, shape (n,)."""
        positions, _ = self.errors(angles)
        squared: Array = np.sum((positions - self.desired * self.scale) ** 2, axis=1)
        return squared


def minima(
    distance: Distance, weights: Array, slopes: Array, guesses: Array, *, tolerance: float
) -> tuple[Array, Array]:
    """The least of ``weight * squared distance + slope @ angles`` over the box, for every sample.

    Args:
        distance: The foot's distance, and the box of angles.
        weights: Weights of the samples, 0 or more, shape (n,).
        slopes: Linear terms [1/rad], shape (n, k).
        guesses: Angles in the box that may be good [rad], shape (n, k).
        tolerance: Allowed distance of a bound below the least value.

    Returns:
        Lower bounds over all angles, shape (n,), valid however early the search has to stop; and
        angles that come close to them [rad], shape (n, k).
    """
    blocks = [
        _block(
            distance._replace(
                lower=distance.lower[part],
                upper=distance.upper[part],
                desired=distance.desired[part],
            ),
            weights[part],
            slopes[part],
            guesses[part],
            tolerance,
        )
        for part in (
            slice(first, first + SAMPLES_AT_ONCE)
            for first in range(0, len(weights), SAMPLES_AT_ONCE)
        )
    ]
    proved, angles = (np.concatenate(column) for column in zip(*blocks, strict=True))
    return proved, angles


def _block(
    distance: Distance, weights: Array, slopes: Array, guesses: Array, tolerance: float
) -> tuple[Array, Array]:
    target = (distance.desired * distance.scale).T
    angles = guesses.copy()
    least = weights * distance.squared(angles) + np.sum(slopes * angles, axis=1)
    owner, half, centres = _first_cells(distance)
    halves = np.array(list(product((-1.0, 1.0), repeat=guesses.shape[1])))
    for _ in range(40):  # cells are then as small as rounding
        positions, jacobians = distance.by_axis(centres)
        errors, share, linear = positions - target[:, owner], weights[owner], slopes.T[:, owner]
        values = share * _dot(errors, errors) + _dot(linear, centres.T)
        _update_least(owner, values, centres, least, angles)
        enough = (least - tolerance)[owner]
        curved = _linearisation_error(distance, half)[owner]
        bounds = values - _depths(errors, jacobians, share, linear, half.T[:, owner], curved)
        is_open = ~(bounds >= enough)
        proved = least - tolerance
        np.minimum.at(proved, owner[is_open], bounds[is_open])
        if not np.any(is_open) or np.count_nonzero(is_open) * len(halves) > MOST_CELLS:
            break
        half = half / 2.0
        owner = np.repeat(owner[is_open], len(halves))
        centres = np.repeat(centres[is_open], len(halves), axis=0)
        centres += np.tile(halves, (len(owner) // len(halves), 1)) * half[owner]
    return proved, angles


def _first_cells(distance: Distance) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """Sample of each cell, (m,), half a cell's width by sample [rad], (n, k), centres, (m, k).

    The samples' boxes are cut alike.
    """
    width = distance.upper - distance.lower
    across, widest = np.max(width, axis=0), WIDEST_CELL
    while len(width) * np.prod(np.ceil(across / widest) + 1.0) > MOST_CELLS:
        widest *= 1.5
    count = np.maximum(np.ceil(across / widest), 1.0).astype(int)
    half = width / count / 2.0
    odd = np.stack(
        np.meshgrid(*(2.0 * np.arange(number) + 1.0 for number in count), indexing="ij"), axis=-1
    ).reshape(-1, len(count))
    centres = distance.lower[:, np.newaxis] + odd * half[:, np.newaxis]
    owner = np.repeat(np.arange(len(width)), len(odd))
    return owner, half, centres.reshape(-1, len(count))


def _update_least(
    owner: npt.NDArray[np.intp], values: Array, centres: Array, least: Array, angles: Array
) -> None:
    """Update the least value and its angles for every sample with cells, where one is less."""
    firsts = np.flatnonzero(np.diff(owner, prepend=-1))  # the cells of a sample stand together
    lowest = np.minimum.reduceat(values, firsts)
    better = lowest < least[owner[firsts]]
    reached = np.flatnonzero(values == np.repeat(lowest, np.diff(firsts, append=len(owner))))
    winners = reached[np.searchsorted(reached, firsts)][better]
    least[owner[winners]], angles[owner[winners]] = values[winners], centres[winners]


def _linearisation_error(distance: Distance, half: Array) -> Array:
    """Largest error of the linearised foot within a cell, scaled: (n,)."""
    reach = _reach(distance)
    outer = np.minimum.outer(reach, reach)  # a pair's derivative turns about the outer one
    curved: Array = np.sum(half @ outer * half, axis=1) / 2.0 * np.max(distance.scale)
    return curved


def _reach(distance: Distance) -> Array:
    """Largest distance of the foot from each joint [m], shape (k,): its move by a radian."""
    beyond = np.linalg.norm(
        np.vstack([distance.chain.translations[1:], distance.chain.tip]), axis=1
    )
    return np.cumsum(beyond[::-1])[::-1]


def _dot(a: Array, b: Array) -> Array:
    """Sum over the first axis of the products: faster than over a short last one."""
    total: Array = np.sum(a * b, axis=0)
    return total


def _depths(
    errors: Array, jacobians: Array, weights: Array, slopes: Array, half: Array, curved: Array
) -> Array:
    """Bound on how far cells of angles go below the values at their centres, shape (m,): (13b).

    The slope times the width, and a term for the curvature of the foot's path.

    Args:
        errors: Scaled errors of the foot at the centres, shape (3, m).
        jacobians: Derivatives of the foot there [1/rad], shape (k, 3, m).
        weights: Weight of each cell's sample, shape (m,).
        slopes: Linear terms [1/rad], shape (k, m).
        half: Half the widths [rad], shape (k, m).
        curved: :func:`_linearisation_error`, shape (m,).
    """
    gradients = 2.0 * weights * np.stack([_dot(column, errors) for column in jacobians]) + slopes
    steps = np.sqrt(np.sum(jacobians**2, axis=1))
    farthest = np.sqrt(_dot(errors, errors)) + _dot(steps, half)
    return _dot(np.abs(gradients), half) + 2.0 * weights * farthest * curved
