"""Lower bound on the distance of a leg's foot from its path (``docs/math.md``, (13a)).

In a Lagrangian relaxation, multipliers replace the conditions that couple a joint's angles, so that
the problem separates into samples; a leg's few angles at one sample allow a search with proof: a
box of angles is cut into cells, and a cell is halved along every joint as long as it may contain
less than the least value so far (13b). The multipliers begin at those of a Gauss-Newton search; a
proximal bundle method (Lemaréchal 1975, Kiwiel 1990) improves them and, where that leaves a gap,
the responses are split by branch and bound.
"""

from __future__ import annotations

import heapq
import logging
import math
from collections.abc import Sequence
from itertools import count, product
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from kinematics.chain import Chain
from planner.arrays import Array, Indices
from planner.model.joint import JointModel
from planner.model.response import Loads, farthest_per_period, of_joints
from planner.planning.bounds.multipliers import conic_solutions
from planner.planning.bounds.reachable_set import reachable_set
from planner.planning.task import Norm, Task

MOST_SAMPLES_BOUNDED = 1000
"""Longest path whose bound is computed for reports [samples]: it takes half a minute at most."""

EFFORT = 1200
"""Most samples searched, summed over rounds, before splitting stops [-]: some seconds. The
multipliers of a round count as 20 more."""

MOST_CELLS = 400_000
"""Most open cells of a block, in some 100 MB; beyond it the search stops with their bounds. So many
occur only where angles far apart are equally good."""

Multipliers = tuple[Array, Array]
"""Weights of the samples, 0 or more and together 1, (n,), and of the conditions, (rows,)."""


def foot_bound(task: Task, angles: Array) -> float:
    """Lower bound on the error of a foot under any requests within the limits [m], at least 0.

    From rest it holds for plans that start from the same pose. The better the plan with these
    angles (n, k) [rad], the sharper it is; with the integral of a speed loop it is 0. A solver that
    fails makes it weaker, never wrong.
    """
    models, leg = task.nominal, task.leg
    assert leg is not None, "a foot belongs to a leg"
    plan_error = float(task.errors_of(angles)[0])
    attained = plan_error <= 1e-5 * leg.chain.size
    if attained or any(model.exceeds_v_max for model in models):
        return 0.0
    relaxation = LagrangianRelaxation.of(task, plan_error)
    distance, samples = relaxation.distance, relaxation.samples
    lower, upper = distance.lower, distance.upper
    # How far every joint's angle can be from the one at the middle sample
    apart = np.abs(np.arange(samples) - samples // 2)
    if task.cyclic:
        turn = 2.0 * math.pi
        angles = angles - turn * np.floor((np.min(angles, axis=0) - lower[0]) / turn)
        apart = np.minimum(apart, samples - apart)
    away = np.outer(apart, list(map(farthest_per_period, models, task.loads)))
    angles, multipliers = np.clip(angles, lower, upper), relaxation.unconditional
    for _ in range(12):
        step = gauss_newton_step(relaxation, angles)
        if step is None or np.max(np.abs(step[0] - angles)) <= 1e-5:  # [rad]
            break
        angles, multipliers = step
    squares = distance.squared(angles)
    if (np.max(squares) if relaxation.norm == "max" else np.mean(squares)) < 1e-3:
        return 0.0  # this is an upper limit of the bound
    order, rounds = count(), min(max(EFFORT // samples, 3), 12)  # three or four usually gain all
    node = Node(0.0, lower[samples // 2], upper[samples // 2], multipliers, (angles,))
    node = _improved(relaxation, node, rounds)
    nodes, effort = [(node.bound, next(order), node)], node.effort
    while nodes[0][0] < 0.95 and effort < EFFORT:  # 2.5 % of the error
        _, _, node = heapq.heappop(nodes)
        for half in _split(node):
            low = np.maximum(lower, half.lower - away)
            near = distance._replace(
                lower=low, upper=np.maximum(np.minimum(upper, half.upper + away), low)
            )
            child = _improved(relaxation._replace(distance=near), half, rounds=3)
            effort += child.effort
            heapq.heappush(nodes, (child.bound, next(order), child))
    logging.getLogger(__name__).debug(
        "foot bound: %.5f of the squared error proved by %d nodes", nodes[0][0], len(nodes)
    )
    return plan_error * math.sqrt(min(nodes[0][0], 1.0))


class Distance(NamedTuple):
    """The squared distance of a leg's foot from its desired position, with scaled axes."""

    chain: Chain
    lower: Array  # least angles at each sample [rad], shape (n, k)
    upper: Array  # greatest angles [rad], shape (n, k)
    desired: Array  # desired foot positions [m], shape (n, 3)
    scale: Array  # scale of each axis [1/m], shape (3,)

    def errors(self, angles: Array, samples: Indices | slice) -> tuple[Array, Array]:
        """Scaled errors at angles (m, k) of samples, (3, m); derivatives [1/rad], (k, 3, m)."""
        foot, columns, _ = self.chain.derivatives(angles)
        scale = self.scale[:, np.newaxis]
        return scale * (foot - self.desired[samples].T), scale * columns

    def squared(self, angles: Array) -> Array:
        """Scaled squared distances at one row of angles per sample, shape (n,)."""
        errors, _ = self.errors(angles, slice(None))
        return _dot(errors, errors)


class LagrangianRelaxation(NamedTuple):
    """The foot's distance, and conditions on the angles at all ticks of all joints."""

    distance: Distance  # scaled so that the error of a known plan is 1
    norm: Norm  # root mean square or largest distance
    # conditions ``matrix @ angles <= limits`` of all joints, shape (rows, ticks)
    matrix: sparse.csr_array
    limits: Array  # shape (rows,)
    sampled: Indices  # the ticks of the samples, shape (n, k)
    between: Indices  # the other ticks, shape (m,)
    low: Array  # least angles at these [rad], shape (m,)
    high: Array  # greatest angles at these [rad], shape (m,)

    @classmethod
    def of(cls, task: Task, unit: float) -> LagrangianRelaxation:
        """That of a foot's task, in this unit of error [m]."""
        assert task.leg is not None, "a foot belongs to a leg"
        models, desired = task.nominal, task.desired_foot
        lower, upper = attainable_angles(
            models, (task.lower, task.upper), len(desired), start=task.start, loads=task.loads
        )
        low, high = np.min(lower, axis=0), np.max(upper, axis=0)
        ranges = zip(low.tolist(), high.tolist(), strict=True)
        sets = [reachable_set(task.joint(j), "envelope", ends) for j, ends in enumerate(ranges)]
        ticks = [each.matrix.shape[1] for each in sets]
        firsts = np.cumsum([0, *ticks[:-1]])
        sampled = np.transpose([first + s.sampled for first, s in zip(firsts, sets, strict=True)])
        between = np.setdiff1d(np.arange(sum(ticks)), sampled)
        joint = np.repeat(np.arange(len(sets)), ticks)[between]
        return cls(
            Distance(task.leg.chain, lower, upper, desired, task.axis_scales / unit),
            task.norm,
            sparse.block_diag([each.matrix for each in sets], format="csr"),
            np.concatenate([each.limits for each in sets]),
            sampled,
            between,
            low[joint],
            high[joint],
        )

    @property
    def samples(self) -> int:
        """Number of desired positions."""
        return len(self.sampled)

    @property
    def unconditional(self) -> Multipliers:
        """Multipliers without the joints' conditions: the distance of any configuration."""
        return _normalised(np.zeros(self.samples)), np.zeros(len(self.limits))


def dual_function(
    relaxation: LagrangianRelaxation, multipliers: Multipliers, guesses: Array
) -> tuple[float, Array]:
    """The lower bound on the squared distance by multipliers, and its minimiser, (n, k)."""
    weights, conditions = multipliers
    gradient = relaxation.matrix.T @ conditions
    between = gradient[relaxation.between]
    constant = np.sum(np.minimum(between * relaxation.low, between * relaxation.high))
    proved, angles = minima(
        relaxation.distance,
        weights,
        gradient[relaxation.sampled],
        guesses,
        tolerance=1e-3 / relaxation.samples,  # of a plan's squared error
    )
    return float(np.sum(proved) + constant - relaxation.limits @ conditions), angles


def gauss_newton_step(
    relaxation: LagrangianRelaxation, angles: Array
) -> tuple[Array, Multipliers] | None:
    """The best angles in the box for a linearised foot, and their multipliers; None if it fails."""
    distance, samples = relaxation.distance, relaxation.samples
    errors, jacobians = distance.errors(angles, slice(None))
    ticks, sampled = relaxation.matrix.shape[1], relaxation.sampled.ravel()
    # The unknowns are the angles at all ticks, the linearised errors sample by sample and, in the
    # norm "max", the largest of their lengths.
    row = 3 * np.arange(samples) + np.arange(3)[:, np.newaxis]
    rows, columns = np.broadcast_arrays(row, relaxation.sampled.T[:, np.newaxis])
    linear = sparse.csr_array(
        (jacobians.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * samples, ticks)
    )
    at = sparse.eye_array(ticks, format="csr")[sampled]
    each = sparse.eye_array(3 * samples, format="csr")
    blocks: list[list[Any]] = [[linear, -each], [relaxation.matrix, None], [at, None], [-at, None]]
    limits = [linear @ (at.T @ angles.ravel()) - errors.T.ravel(), relaxation.limits]
    limits += [distance.upper.ravel(), -distance.lower.ravel()]
    curvature, slope = np.zeros(ticks + 3 * samples), np.zeros(ticks + 3 * samples)
    # The proximal weight is small beside the mean square of the foot's Jacobian.
    proximal = 0.04 * float(np.mean(np.sum(jacobians**2, axis=1))) / samples
    curvature[sampled], slope[sampled] = proximal, -proximal * angles.ravel()
    if relaxation.norm == "rms":
        curvature[ticks:] = 2.0 / samples
    else:
        lengths = sparse.kron(sparse.eye_array(samples), -np.eye(4, 3, -1))
        largest = sparse.csr_array(np.tile([-1.0, 0.0, 0.0, 0.0], samples)[:, np.newaxis])
        blocks = [[*block, None] for block in blocks] + [[None, lengths, largest]]
        limits.append(np.zeros(4 * samples))
        curvature, slope = np.append(curvature, 0.0), np.append(slope, 1.0)
    (answer,) = conic_solutions(
        sparse.csr_array(sparse.block_array(blocks)),
        np.concatenate(limits),
        [slope],
        equations=3 * samples,
        balls=() if relaxation.norm == "rms" else (4,) * samples,
        curvature=curvature,
        tolerance=1e-8,
    )
    if not answer.solved:
        return None
    inside = np.clip(answer.unknowns[relaxation.sampled], distance.lower, distance.upper)
    conditions = answer.multipliers[3 * samples :][: len(relaxation.limits)]
    if relaxation.norm == "rms":
        return inside, (relaxation.unconditional[0], conditions)
    weights = _normalised(answer.multipliers[-4 * samples :: 4])
    # of the squared distance, whose slope is twice that of the distance, times it
    return inside, (weights, 2.0 * float(answer.unknowns[-1]) * conditions)


def _normalised(proposed: Array) -> Array:
    """Weights that are 0 or more and together 1."""
    weights = np.maximum(proposed, 0.0)
    total = float(np.sum(weights))
    return weights / total if total > 0.0 else np.full(len(weights), 1.0 / len(weights))


def bundle_step(
    relaxation: LagrangianRelaxation, columns: Sequence[Array], centre: Multipliers, *, step: float
) -> tuple[Multipliers, float]:
    """Multipliers of the greatest bound if all angles were among the columns, and that bound.

    A step of a proximal bundle method, every sample with its own cuts; the centre and 0 where the
    solver fails.
    """
    samples, sampled, between = relaxation.samples, relaxation.sampled, relaxation.between
    gradients = sparse.csr_array(relaxation.matrix.T)
    weights, around = centre[0], (gradients @ centre[1])[sampled].T.ravel()
    size = float(np.sum(around**2))
    if size == 0.0:
        return centre, 0.0
    conditions, fixed = gradients.shape[1], relaxation.norm == "rms"
    # The unknowns are the multipliers of the conditions, their linear terms at the samples, the
    # least value of those between samples, and the least value and the weight of each sample.
    each = sparse.eye_array(samples)
    of_weights = each if fixed else sparse.csr_array(np.ones((1, samples)))
    zero: list[list[Any]] = [
        [gradients[sampled.T.ravel()], -sparse.eye_array(len(around)), None, None, None],
        [None, None, None, None, of_weights],
    ]
    at_most: list[list[Any]] = [[-sparse.eye_array(conditions), None, None, None, None]]
    for end in (relaxation.low, relaxation.high):
        least = -sparse.diags_array(end) @ gradients[between]
        at_most.append([least, None, sparse.eye_array(len(between)), None, None])
    for angles in columns:
        moved = sparse.hstack([sparse.diags_array(column) for column in angles.T])
        squared = sparse.diags_array(relaxation.distance.squared(angles))
        at_most.append([None, -moved, None, each, -squared])
    at_most.append([None, None, None, None, -each])
    counts = [conditions, len(around), len(between), samples, samples]
    matrix = sparse.csr_array(sparse.block_array([*zero, *at_most]))
    zeros = len(around) + of_weights.shape[0]
    limits = np.zeros(matrix.shape[0])
    limits[len(around) : zeros] = weights if fixed else 1.0
    # The proximal term keeps the linear terms and the weights near those of the centre: a change
    # of all by their own size costs three times a plan's squared error.
    by_terms, by_weights = (6.0 / step / each for each in (size, np.sum(weights**2)))
    slope = np.repeat([0.0, 0.0, -1.0, -1.0, 0.0], counts)
    slope[:conditions] = relaxation.limits
    proximal = np.repeat([0.0, by_terms, 0.0, 0.0, by_weights], counts)
    nothing = np.zeros(len(between) + samples)
    near = np.concatenate([np.zeros(conditions), around, nothing, weights])
    (answer,) = conic_solutions(
        matrix,
        limits,
        [slope - proximal * near],
        equations=zeros,
        curvature=proximal,
        tolerance=1e-8,
    )
    if not answer.solved:
        return centre, 0.0
    if not fixed:
        weights = _normalised(answer.unknowns[-samples:])
    return (weights, np.maximum(answer.unknowns[:conditions], 0.0)), -float(slope @ answer.unknowns)


class Node(NamedTuple):
    """The responses whose angles at the middle sample are in a box, and their lower bound."""

    bound: float  # lower bound on their squared error
    lower: Array  # least angles at the middle sample [rad], (k,)
    upper: Array  # greatest angles there [rad], (k,)
    multipliers: Multipliers  # multipliers that prove it
    columns: tuple[Array, ...]  # angles that minimised (13a) under some multipliers, each (n, k)
    effort: int = 0  # samples searched, summed over rounds, and the effort of the rounds themselves


def _split(node: Node) -> list[Node]:
    """The node split in two, halfway between the columns' angles that are farthest apart."""
    middle = len(node.columns[0]) // 2
    angles = np.clip([column[middle] for column in node.columns], node.lower, node.upper)
    joint = int(np.argmax(np.ptp(angles, axis=0)))
    # Without this rule three of seven bounds are 9 to 89 % lower.
    if np.ptp(angles[:, joint]) <= 0.05 * (node.upper[joint] - node.lower[joint]):
        joint = int(np.argmax(node.upper - node.lower))
        angles = np.array([node.lower, node.upper])
    first, second = node.upper.copy(), node.lower.copy()
    first[joint] = second[joint] = (np.min(angles[:, joint]) + np.max(angles[:, joint])) / 2.0
    return [node._replace(upper=first), node._replace(lower=second)]


def _improved(relaxation: LagrangianRelaxation, node: Node, rounds: int) -> Node:
    """The node after some rounds of the bundle method, begun at its multipliers."""
    distance = relaxation.distance
    columns = [np.clip(each, distance.lower, distance.upper) for each in node.columns]
    centre = multipliers = node.multipliers
    bound, predicted, step = -math.inf, math.inf, 1.0
    for turn in range(rounds):
        value, angles = dual_function(relaxation, multipliers, columns[0])
        logging.getLogger(__name__).debug(
            "foot bound: round %d proves %.5f of %.5f", turn + 1, value, predicted
        )
        if value > bound:
            centre, bound = multipliers, value
        else:
            step *= 0.5  # after a null step, as bundle methods have it
        columns.append(angles)
        if bound >= 1.0 or turn + 1 == rounds:
            break
        multipliers, predicted = bundle_step(relaxation, columns, centre, step=step)
        if predicted - max(bound, 0.0) < 2e-3:  # half of it is the tolerance of the minima
            break
    if bound < 0.0:  # less than without the joints' conditions
        bound, _ = dual_function(relaxation, relaxation.unconditional, columns[0])
    return node._replace(
        bound=max(node.bound, bound),
        multipliers=centre,
        columns=tuple(columns),
        effort=(turn + 1) * (relaxation.samples + 20),
    )


def attainable_angles(
    models: Sequence[JointModel],
    limits: tuple[Array, Array],  # smallest and largest requests [rad], two arrays (k,)
    samples: int,  # number of samples n
    *,
    # from rest: angles of the joints at the first sample [rad], (k,); None for a cycle
    start: Array | None,
    loads: Loads | None = None,  # torque on each joint at every sample [N m], (n,), or None
) -> tuple[Array, Array]:
    """Least and greatest angles of every joint under requests within limits [rad], (n, k) both.

    A joint overshoots a request by v - theta_0 a tick at most, with a sag by its angle of at most s
    by v - theta_0 / (1 + s); friction holds it within its dead band, over 1 - s. With inertia, or
    where gravity may overcome it, by any amount. As a turn changes nothing for the foot, a cycle's
    least angle is within a turn of the lower limit, or of -pi; the speed bounds the greatest.
    """
    loads = [None] * len(models) if loads is None else loads
    farthest = np.array(list(map(farthest_per_period, models, loads)))
    beyond = np.full(len(models), math.inf)
    for j, (model, load) in enumerate(zip(models, loads, strict=True)):
        pose, top, period = model.most_pose_sag, model.v_max_per_tick, model.v_max * model.period
        low, high = model.speed_limits(0.0 if load is None else load)
        weakest = float(min(np.min(high), np.min(-low)))
        overcome = pose > 0.0 and model.gain * pose >= weakest
        if not (model.has_inertia or overcome):
            over = max(top - model.theta_0 / (1.0 + pose), 0.0) * farthest[j] / period
            beyond[j] = max(over, model.dead_band / (1.0 - pose))
    lowest, highest = (
        np.atleast_2d(of_joints(JointModel.rest, models, end, loads)) for end in limits
    )
    lower, upper = np.min(lowest, axis=0) - beyond, np.max(highest, axis=0) + beyond
    if start is not None:
        away = np.arange(samples)[:, np.newaxis] * farthest
        return np.maximum(lower, start - away), np.minimum(upper, start + away)
    turn = 2.0 * math.pi
    span = turn + samples / 2.0 * farthest  # a cycle goes there and back
    nowhere = np.isinf(lower) & np.isinf(upper)
    lower = np.where(nowhere, -turn / 2.0, lower)
    lower = np.where(np.isinf(lower), upper - span, lower)
    upper = np.minimum(upper, lower + span)
    return np.tile(lower, (samples, 1)), np.tile(upper, (samples, 1))


def minima(
    distance: Distance, weights: Array, slopes: Array, guesses: Array, *, tolerance: float
) -> tuple[Array, Array]:
    """The least of ``weight * squared distance + slope @ angles`` over the box, for every sample.

    For weights of 0 or more, (n,), slopes [1/rad] and guesses in the box [rad], (n, k): lower
    bounds, (n,), the tolerance below the least values unless there are too many cells, and angles
    that come close to them, (n, k).
    """
    if len(weights) > 64:  # each sample has up to a few thousand first cells
        chain, *rows, scale = distance
        proved, angles = np.empty(len(weights)), np.empty(guesses.shape)
        for first in range(0, len(weights), 64):
            part = slice(first, first + 64)
            lower, upper, desired = (each[part] for each in rows)
            own = Distance(chain, lower, upper, desired, scale)
            proved[part], angles[part] = minima(
                own, weights[part], slopes[part], guesses[part], tolerance=tolerance
            )
        return proved, angles
    angles = guesses.copy()
    least = weights * distance.squared(angles) + np.sum(slopes * angles, axis=1)
    owner, half, centres = _first_cells(distance)
    halves = np.array(list(product((-1.0, 1.0), repeat=guesses.shape[1])))
    chain = distance.chain
    arms = np.linalg.norm(np.vstack([chain.translations[1:], chain.tip]), axis=1)
    reach = np.cumsum(arms[::-1])[::-1]  # of the foot from each joint: its move by a radian
    outer = np.minimum.outer(reach, reach)  # a pair's derivative turns about the outer one
    for _ in range(40):  # cells are then as small as rounding
        errors, jacobians = distance.errors(centres, owner)
        weight, slope = weights[owner], slopes.T[:, owner]
        values = weight * _dot(errors, errors) + _dot(slope, centres.T)
        lowest = least.copy()
        np.minimum.at(lowest, owner, values)
        best = (values == lowest[owner]) & (values < least[owner])
        angles[owner[best]], least = centres[best], lowest
        # How far a cell goes below its centre, (13b): slope times half the width, and a term for
        # the curvature of the foot's path.
        wide = half.T[:, owner]
        curved = (np.sum(half @ outer * half, axis=1) / 2.0 * np.max(distance.scale))[owner]
        gradients = 2.0 * weight * np.stack([_dot(each, errors) for each in jacobians]) + slope
        farthest = np.sqrt(_dot(errors, errors)) + _dot(np.sqrt(np.sum(jacobians**2, axis=1)), wide)
        bounds = values - _dot(np.abs(gradients), wide) - 2.0 * weight * farthest * curved
        is_open = ~(bounds >= (least - tolerance)[owner])
        proved = least - tolerance
        np.minimum.at(proved, owner[is_open], bounds[is_open])
        if not np.any(is_open) or np.count_nonzero(is_open) * len(halves) > MOST_CELLS:
            break
        half = half / 2.0
        owner = np.repeat(owner[is_open], len(halves))
        centres = np.repeat(centres[is_open], len(halves), axis=0)
        centres += np.tile(halves, (len(owner) // len(halves), 1)) * half[owner]
    return proved, angles


def _first_cells(distance: Distance) -> tuple[Indices, Array, Array]:
    """Sample of each cell, (m,), half a cell's width by sample [rad], (n, k), centres, (m, k)."""
    width = distance.upper - distance.lower
    across, widest = np.max(width, axis=0), np.radians(15.0)
    while len(width) * np.prod(np.ceil(across / widest) + 1.0) > MOST_CELLS:
        widest *= 1.5
    count = np.maximum(np.ceil(across / widest), 1.0).astype(int)
    half = width / count / 2.0
    odd = 2.0 * np.array(list(np.ndindex(*count))) + 1.0
    centres = distance.lower[:, np.newaxis] + odd * half[:, np.newaxis]
    return np.repeat(np.arange(len(width)), len(odd)), half, centres.reshape(-1, len(count))


def _dot(a: Array, b: Array) -> Array:
    """Sum over the first axis of the products: faster than over a short last one."""
    total: Array = np.sum(a * b, axis=0)
    return total
