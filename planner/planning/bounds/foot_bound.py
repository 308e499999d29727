"""Lower bound on the distance of a leg's foot from its path (``docs/math.md``, (13a)).

The foot's distance is not convex in the joints' angles. In a Lagrangian relaxation, multipliers
replace the conditions that couple a joint's angles, so that the problem separates into samples; a
leg's few angles at one sample allow a search with proof. The multipliers are
improved by a bundle method and, where that leaves a gap, the responses are split by branch and
bound.
"""

from __future__ import annotations

import heapq
import logging
import math
from collections.abc import Sequence
from itertools import count
from typing import NamedTuple

import numpy as np

from planner.model.joint import JointModel
from planner.model.response import Loads, rest_angles
from planner.planning.bounds.bundle_method import (
    Column,
    Distance,
    LagrangianRelaxation,
    Multipliers,
    bundle_step,
    dual_function,
    stationary_point,
    zero_multipliers,
)
from planner.planning.bounds.reachable_set import (
    BoundProblem,
    farthest_per_period,
    reachable_set,
)
from planner.planning.task import Task
from planner.trajectory import Array

MOST_SAMPLES_BOUNDED = 1000
"""Longest path whose bound is computed for reports [samples]: it takes half a minute at most."""

ATTAINED = 1e-5
"""Error below which no bound is computed [of a leg's length]."""


EFFORT = 1000
"""Most samples searched, summed over rounds, before splitting stops [-]: some seconds. The
multipliers of a round count as 20 more."""

GAP = 0.05
"""Unproved share of the squared error at which splitting stops [-]: 2.5 % of the error."""

GAIN = 2e-3
"""Least predicted gain of a round [of the plan's squared error]; half of it may be no more than the
tolerance of the search for minima."""

NOTHING = 1e-3
"""Squared error of relaxed responses near the plan below which the bound is 0 [of the plan's]: it
is an upper limit of the bound."""

SPREAD = 0.05
"""Spread of the columns' angles below which the widest side is split instead [of that side];
without the rule three of seven bounds are 9 to 89 % lower."""


def foot_bound(task: Task, angles: Array) -> float:
    """Lower bound on the error of a foot under any requests within the limits [m].

    From rest it holds for plans that start from the same pose.

    Args:
        task: The task of the foot.
        angles: Angles of a plan, the better the sharper is the bound [rad], shape (n, k).

    Returns:
        The bound, at least 0, in the norm and the weights of the task; 0 where a joint has the
        integral of a speed loop. A solver that fails makes it weaker, never wrong.
    """
    models, leg, norm = task.nominal, task.leg, task.norm
    assert leg is not None, "a foot belongs to a leg"
    plan_error = float(task.errors_of(angles)[0])
    if plan_error <= ATTAINED * leg.chain.size or any(model.exceeds_v_max for model in models):
        return 0.0
    lower, upper = attainable_angles(
        models, (task.lower, task.upper), len(angles), start=task.start, loads=task.loads
    )
    if task.cyclic:
        turn = 2.0 * math.pi
        angles = angles - turn * np.floor((np.min(angles, axis=0) - lower[0]) / turn)
    scales = task.axis_scales / plan_error
    distance = Distance(leg.chain, lower, upper, task.desired_foot, scales)
    room = np.min(lower, axis=0), np.max(upper, axis=0)
    joints = zip(models, angles.T, task.starts, task.loads, *room, strict=True)
    sets = [
        reachable_set(
            BoundProblem(model, column, task.cyclic, norm, start, load), "envelope", (low, high)
        )
        for model, column, start, load, low, high in joints
    ]
    relaxation = LagrangianRelaxation(distance, sets, norm, room)
    away = largest_distances(models, len(angles), cyclic=task.cyclic, loads=task.loads)
    squared = _branch_and_bound(
        relaxation, away, stationary_point(relaxation, np.clip(angles, lower, upper))
    )
    return plan_error * math.sqrt(min(squared, 1.0))


class Node(NamedTuple):
    """The responses whose angles at the middle sample are in a box, and their lower bound.

    Attributes:
        bound: Lower bound on their squared error.
        lower: Least angles at the middle sample [rad], (k,).
        upper: Greatest angles there [rad], (k,).
        multipliers: Multipliers that prove it.
        columns: Angles that minimised (13a) under some multipliers.
        effort: Samples searched, summed over rounds, and the effort of the rounds themselves.
    """

    bound: float
    lower: Array
    upper: Array
    multipliers: Multipliers
    columns: tuple[Column, ...]
    effort: int = 0


def _branch_and_bound(
    relaxation: LagrangianRelaxation, away: Array, first: tuple[Array, Multipliers]
) -> float:
    """The least bound of nodes that cover all responses."""
    middle = len(away) // 2
    angles, multipliers = first
    every = Node(
        0.0,
        relaxation.distance.lower[middle],
        relaxation.distance.upper[middle],
        multipliers,
        (Column(angles, relaxation.distance.squared(angles)),),
    )
    squares = relaxation.distance.squared(angles)
    if (np.max(squares) if relaxation.norm == "max" else np.mean(squares)) < NOTHING:
        return 0.0
    order = count()
    rounds = min(max(EFFORT // relaxation.samples, 3), 12)  # three or four usually gain all
    node = _improved(relaxation, every, rounds)
    nodes = [(node.bound, next(order), node)]
    effort = node.effort
    while nodes[0][0] < 1.0 - GAP and effort < EFFORT:
        _, _, node = heapq.heappop(nodes)
        for half in _split(node):
            child = _improved(_restricted(relaxation, half, away), half, rounds=3)
            effort += child.effort
            heapq.heappush(nodes, (child.bound, next(order), child))
    logging.getLogger(__name__).debug(
        "foot bound: %.5f of the squared error proved by %d nodes", nodes[0][0], len(nodes)
    )
    return nodes[0][0]


def _split(node: Node) -> list[Node]:
    """The node split in two, halfway between the columns' angles that are farthest apart."""
    middle = len(node.columns[0].angles) // 2
    angles = np.clip([column.angles[middle] for column in node.columns], node.lower, node.upper)
    joint = int(np.argmax(np.ptp(angles, axis=0)))
    if np.ptp(angles[:, joint]) <= SPREAD * (node.upper[joint] - node.lower[joint]):
        joint = int(np.argmax(node.upper - node.lower))
        angles = np.array([node.lower, node.upper])
    value = (np.min(angles[:, joint]) + np.max(angles[:, joint])) / 2.0
    first, second = node.upper.copy(), node.lower.copy()
    first[joint] = second[joint] = value
    return [node._replace(upper=first), node._replace(lower=second)]


def _restricted(relaxation: LagrangianRelaxation, node: Node, away: Array) -> LagrangianRelaxation:
    """The relaxation over a node's angles: ``away`` is how far joints go, (n, k)."""
    distance = relaxation.distance
    lower = np.maximum(distance.lower, node.lower - away)
    upper = np.maximum(np.minimum(distance.upper, node.upper + away), lower)
    return relaxation._replace(distance=distance._replace(lower=lower, upper=upper))


def _improved(relaxation: LagrangianRelaxation, node: Node, rounds: int) -> Node:
    """The node after some rounds of the bundle method, begun at its multipliers."""
    distance = relaxation.distance
    inside = (np.clip(each.angles, distance.lower, distance.upper) for each in node.columns)
    columns = [Column(angles, distance.squared(angles)) for angles in inside]
    multipliers, bound, predicted, step = node.multipliers, -math.inf, math.inf, 1.0
    centre = multipliers
    for turn in range(rounds):
        value, angles = dual_function(relaxation, multipliers, columns[0].angles)
        logging.getLogger(__name__).debug(
            "foot bound: round %d proves %.5f of %.5f", turn + 1, value, predicted
        )
        if value > bound:
            centre, bound = multipliers, value
        else:
            step *= 0.5  # after a null step, as bundle methods have it
        columns.append(Column(angles, distance.squared(angles)))
        if bound >= 1.0 or turn + 1 == rounds:
            break
        multipliers, predicted = bundle_step(relaxation, columns, centre, step=step)
        if predicted - max(bound, 0.0) < GAIN:
            break
    if bound < 0.0:  # less than without the joints' conditions
        bound, _ = dual_function(relaxation, zero_multipliers(relaxation), columns[0].angles)
    return node._replace(
        bound=max(node.bound, bound),
        multipliers=centre,
        columns=tuple(columns),
        effort=(turn + 1) * (relaxation.samples + 20),
    )


def attainable_angles(
    models: Sequence[JointModel],
    limits: tuple[Array, Array],
    samples: int,
    *,
    start: Array | None,
    loads: Loads | None = None,
) -> tuple[Array, Array]:
    """Least and greatest angles of every joint under requests within limits [rad], (n, k) both.

    A joint overshoots a request by v - theta_0 a tick at most, with a sag by its angle of at most s
    by v - theta_0 / (1 + s), by more in the direction of a higher
    top speed, and by nothing where that is negative; friction holds it within its dead band, over
    1 - s. With inertia, or where gravity may overcome it, it may overshoot by any amount. A turn
    by 2 pi changes nothing for the foot, so that the least angle of a cycle may be taken within a
    turn of the lower limit, or of -pi; the speed then bounds the greatest angle.

    Args:
        models: The joints.
        limits: Smallest and largest requests [rad], two arrays (k,).
        samples: Number of samples n.
        start: From rest: angles of the joints at the first sample [rad], (k,); None for a cycle.
        loads: Torque on each joint at every sample [N m], (n,), or None.
    """
    loads = [None] * len(models) if loads is None else loads
    farthest = _farthest(models, loads)
    thresholds = [model.theta_0 / (1.0 + model.most_pose_sag) for model in models]
    beyond = np.array([model.v_max_per_tick for model in models])
    beyond = np.maximum(beyond - thresholds, 0.0)
    beyond *= farthest / np.array([model.v_max_per_period for model in models])
    bands = [model.dead_band / (1.0 - model.most_pose_sag) for model in models]
    beyond = np.maximum(beyond, bands)
    free = [
        model.has_inertia or overcome(model, load)
        for model, load in zip(models, loads, strict=True)
    ]
    beyond[free] = math.inf
    lowest, highest = (np.atleast_2d(rest_angles(models, end, loads)) for end in limits)
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


def overcome(model: JointModel, load: Array | None) -> bool:
    """Whether gravity by the pose may exceed the joint's torque at some angle."""
    low, high = model.speed_limits(0.0 if load is None else load)
    by_pose = model.v_max / model.theta_0 * model.most_pose_sag
    return by_pose > 0.0 and by_pose >= float(min(np.min(high), np.min(-low)))


def _farthest(models: Sequence[JointModel], loads: Loads) -> Array:
    """How far each joint moves between two requests at most [rad], (k,)."""
    return np.array([farthest_per_period(m, load) for m, load in zip(models, loads, strict=True)])


def largest_distances(
    models: Sequence[JointModel], samples: int, *, cyclic: bool, loads: Loads
) -> Array:
    """How far every joint's angle can be from the one at the middle sample [rad], (n, k)."""
    apart = np.abs(np.arange(samples) - samples // 2)
    if cyclic:
        apart = np.minimum(apart, samples - apart)
    farthest: Array = apart[:, np.newaxis] * _farthest(models, loads)
    return farthest
