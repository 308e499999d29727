"""How close to its path could a foot come? A lower bound for a whole leg (``docs/math.md``, (13a)).

The joints move through the sets that bound each of them alone, and the foot's distance is not
convex in their angles; but once multipliers have taken the place of the sets' conditions, the
samples are apart, and a few angles are few enough to be searched for the least value, with proof.
"""

from __future__ import annotations

import heapq
import logging
import math
from collections.abc import Sequence
from itertools import count
from typing import NamedTuple

import numpy as np

from kinematics.leg import Leg
from planner.inversion.arguments import Norm
from planner.inversion.bounds.reachable_set import reachable_set
from planner.inversion.foot.bundle_method import (
    Column,
    Multipliers,
    Relaxation,
    best_known,
    near_by,
    nothing,
    proved_by,
)
from planner.inversion.foot.configuration_minima import Distance
from planner.model.joint import JointModel
from planner.trajectory import Array

LEAST_ROUNDS, ROUNDS = 3, 12
"""Sets of multipliers that are tried on long paths, and at most; three or four usually use up what
there is to gain."""

LONGEST = 1000
"""Samples of a path up to which a bound takes half a minute at most: it is told unasked."""

LONGER, SHORTER, TRUSTED = 2.0, 0.5, 0.5
"""How much farther, or less far, the next multipliers may be from the best ones, and from which
share of the promised gain on they may."""

WORTH_A_ROUND = 2e-3
"""What a further round must promise, of the plan's squared error: half of it may be no more than
what the search for minima leaves unproved."""

EFFORT, ROUNDS_OF_A_PART = 1000, 3
"""After how many samples searched, counted in every round, no part of the responses is cut in two
any more [-], some seconds; and the most multipliers tried for a half."""

OVERHEAD = 20
"""What a round takes besides, for its multipliers [samples searched]."""

NARROW = 0.05
"""Spread of the angles that matter below which it does not say where to cut [of a part's side]."""

CLOSE_ENOUGH = 0.05
"""Share of the squared error left unproved from which on nothing is cut: 2.5 % of the error."""

ATTAINED = 1e-5
"""Error below which a foot is where it should be, and no bound is asked for [of a leg's length]."""


def foot_bound(
    models: Sequence[JointModel],
    leg: Leg,
    wanted: Array,
    angles: Array,
    *,
    cyclic: bool,
    norm: Norm,
    weights: Array,
    limits: tuple[Array, Array],
    start: Array | None,
) -> float:
    """A distance from its path that no requests within the limits can keep the foot below [m].

    From rest it is about plans that set out from the same pose.

    Args:
        models: The joints, in the leg's order.
        leg: The leg.
        wanted: Wanted positions in the base frame [m], shape (n, 3).
        angles: Angles of a plan, the better the sharper is the bound [rad], shape (n, k).
        cyclic: Whether the path repeats for ever.
        norm: Root mean square or largest distance.
        weights: Weight of each axis, shape (3,).
        limits: Smallest and largest requests [rad], two arrays (k,).
        start: From rest: angles at which the joints rest [rad], (k,).

    Returns:
        The bound, at least 0, in the norm and the weights of :attr:`FootInversion.error`. A solver
        that fails makes it weaker, never wrong.
    """
    roots = np.sqrt(weights / np.max(weights))
    errors = np.linalg.norm((leg.foot_positions(angles) - wanted) * roots, axis=1)
    known = float(np.max(errors) if norm == "max" else np.sqrt(np.mean(errors**2)))
    if known <= ATTAINED * leg.chain.size:
        return 0.0
    lower, upper = within_reach(models, limits, len(wanted), start=start)
    distance = Distance(leg.chain, lower, upper, wanted, roots / known)
    starts: list[float | None] = (
        [None] * len(models) if start is None else [float(angle) for angle in start]
    )
    sets = [
        reachable_set(model, len(wanted), cyclic=cyclic, level="envelope", start=each)
        for model, each in zip(models, starts, strict=True)
    ]
    task = Relaxation(distance, sets, norm, (np.min(lower, axis=0), np.max(upper, axis=0)))
    away = how_far_apart(models, len(wanted), cyclic=cyclic)
    squared = _searched(task, away, near_by(task, np.clip(angles, lower, upper)))
    return known * math.sqrt(min(squared, 1.0))


class Part(NamedTuple):
    """The responses whose angles at the middle sample are in a box, and what is proved of them.

    Attributes:
        proved: No response of them has a smaller squared error.
        lower: Least angles at the middle sample [rad], (k,).
        upper: Greatest angles there [rad], (k,).
        multipliers: Those that prove it.
        columns: Angles that are known to matter.
        effort: Samples that were searched, counted in every round, and what else rounds take.
    """

    proved: float
    lower: Array
    upper: Array
    multipliers: Multipliers
    columns: tuple[Column, ...]
    effort: int = 0


def _searched(task: Relaxation, away: Array, first: tuple[Array, Multipliers]) -> float:
    """The least of what is proved about parts that are all responses together."""
    middle = len(away) // 2
    angles, multipliers = first
    whole = Part(
        0.0,
        task.distance.lower[middle],
        task.distance.upper[middle],
        multipliers,
        (Column(angles, task.distance.squared(angles)),),
    )
    order = count()
    affordable = EFFORT // task.samples
    part = _improved(task, whole, min(max(affordable, LEAST_ROUNDS), ROUNDS))
    parts = [(part.proved, next(order), part)]
    effort = part.effort
    while parts[0][0] < 1.0 - CLOSE_ENOUGH and effort < EFFORT:
        _, _, part = heapq.heappop(parts)
        for half in _halves(part):
            proved = _improved(_within(task, half, away), half, ROUNDS_OF_A_PART)
            effort += proved.effort
            heapq.heappush(parts, (proved.proved, next(order), proved))
    logging.getLogger(__name__).debug(
        "foot bound: %.5f of the squared error proved in %d parts", parts[0][0], len(parts)
    )
    return parts[0][0]


def _halves(part: Part) -> list[Part]:
    """The part cut in two between the angles at the middle sample that are farthest apart."""
    middle = len(part.columns[0].angles) // 2
    known = np.clip([column.angles[middle] for column in part.columns], part.lower, part.upper)
    joint = int(np.argmax(np.ptp(known, axis=0)))
    if np.ptp(known[:, joint]) <= NARROW * (part.upper[joint] - part.lower[joint]):
        joint = int(np.argmax(part.upper - part.lower))
        known = np.array([part.lower, part.upper])
    cut = (np.min(known[:, joint]) + np.max(known[:, joint])) / 2.0
    first, second = part.upper.copy(), part.lower.copy()
    first[joint] = second[joint] = cut
    return [part._replace(upper=first), part._replace(lower=second)]


def _within(task: Relaxation, part: Part, away: Array) -> Relaxation:
    """The task with no more room than the part leaves: ``away`` is how far joints go, (n, k)."""
    lower = np.maximum(task.distance.lower, part.lower - away)
    upper = np.maximum(np.minimum(task.distance.upper, part.upper + away), lower)
    return task._replace(distance=task.distance._replace(lower=lower, upper=upper))


def _improved(task: Relaxation, part: Part, rounds: int) -> Part:
    """The part with what some rounds prove, each with multipliers that the last one suggests."""
    columns = [
        Column(angles, task.distance.squared(angles))
        for angles in (
            np.clip(column.angles, task.distance.lower, task.distance.upper)
            for column in part.columns
        )
    ]
    multipliers, proved, promised, stride = part.multipliers, -math.inf, math.inf, 1.0
    centre = multipliers
    for turn in range(rounds):
        value, where = proved_by(task, multipliers, columns[0].angles)
        logging.getLogger(__name__).debug(
            "foot bound: round %d proves %.5f of %.5f", turn + 1, value, promised
        )
        if turn:
            kept = (value - proved) / (promised - proved)
            stride *= LONGER if kept > TRUSTED else SHORTER if kept < 0.0 else 1.0
        if value > proved:
            centre, proved = multipliers, value
        columns.append(Column(where, task.distance.squared(where)))
        if proved >= 1.0 or turn + 1 == rounds:
            break
        multipliers, promised = best_known(task, columns, centre, stride=stride)
        if promised - max(proved, 0.0) < WORTH_A_ROUND:
            break
    if proved < 0.0:  # less than the distance from the path of any pose at all
        proved, _ = proved_by(task, nothing(task), columns[0].angles)
    return part._replace(
        proved=max(part.proved, proved),
        multipliers=centre,
        columns=tuple(columns),
        effort=(turn + 1) * (task.samples + OVERHEAD),
    )


def within_reach(
    models: Sequence[JointModel],
    limits: tuple[Array, Array],
    samples: int,
    *,
    start: Array | None,
) -> tuple[Array, Array]:
    """Angles between which every joint stays under requests within limits [rad], (n, k) both.

    A joint overshoots a request by v - theta_0 a tick at most, and by nothing where that is
    negative. Turning by 2 pi changes nothing for the foot, so that a cycle may be thought to have
    its least angle within a turn of the lower limit, or of -pi; and it goes only so far.

    Args:
        models: The joints.
        limits: Smallest and largest requests [rad], two arrays (k,).
        samples: Number of samples n.
        start: From rest: where the joints rest at the first sample [rad], (k,); None for a cycle.
    """
    beyond = np.array([max(model.v_max_per_tick - model.theta_0, 0.0) for model in models])
    offsets = np.array([model.offset for model in models])
    farthest = np.array([model.v_max * model.period for model in models])
    lower, upper = limits[0] + offsets - beyond, limits[1] + offsets + beyond
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


def how_far_apart(models: Sequence[JointModel], samples: int, *, cyclic: bool) -> Array:
    """How far every joint's angle can be from the one at the middle sample [rad], (n, k)."""
    apart = np.abs(np.arange(samples) - samples // 2)
    if cyclic:
        apart = np.minimum(apart, samples - apart)
    farthest: Array = apart[:, np.newaxis] * np.array([m.v_max * m.period for m in models])
    return farthest
