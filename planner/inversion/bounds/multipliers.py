"""Bounds by weak duality: multipliers that prove how far a set of linear conditions is.

For every trajectory x with G x <= h and every lambda >= 0, Hölder's inequality gives
``|x - d| >= lambda (G d - h) / |G' lambda|*``. The solver proposes the multipliers and the
inequality is evaluated here, so that a bound is valid whatever the solver did.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from planner.exceptions import SolverFailed
from planner.inversion.bounds.reachable_set import Level, Question, Reachable, reachable_set
from planner.inversion.norm import Norm
from planner.model.joint import JointModel
from planner.trajectory import Array


def linear_bound(question: Question, level: Level) -> float:
    """The best bound that linear conditions of the joint prove [rad], by multipliers.

    Args:
        question: The joint, and what is wanted of it.
        level: "slope" for the speed alone; otherwise "envelope" too.
    """
    model, desired, cyclic, norm, start = question
    linear: tuple[Level, ...] = ("slope",) if level == "slope" else ("slope", "envelope")
    sets = (
        reachable_set(model, len(desired), cyclic=cyclic, level=each, start=start)
        for each in linear
    )
    return max(_proved(model, desired, reachable, norm) for reachable in sets)


def _proved(model: JointModel, desired: Array, reachable: Reachable, norm: Norm) -> float:
    """The distance from a set that multipliers prove [rad], computed on a scale of about one."""
    middle = float(np.mean(desired))
    scale = max(float(np.ptp(desired)), model.v_max * model.period)
    centred = (desired - middle) / scale
    scaled = reachable._replace(limit=_relative(reachable, middle) / scale)
    reference, multipliers = propose(scaled, centred, norm=norm)
    slack = model.v_max * model.period / scale
    return scale * certified_error(scaled, centred, reference, multipliers, norm=norm, slack=slack)


def propose(reachable: Reachable, desired: Array, *, norm: Norm) -> tuple[Array, Array]:
    """The nearest trajectory of the set and the multipliers that prove it so, as a solver has them.

    Args:
        reachable: The set.
        desired: Wanted angles, shape (n,).
        norm: Which distance.

    Returns:
        Angles at every tick, and a multiplier >= 0 for every row.

    Raises:
        SolverFailed: The solver has none.
    """
    import cvxpy

    angles: Any = cvxpy.Variable(reachable.matrix.shape[1])
    errors = angles[reachable.sampled] - desired
    distance: Any = cvxpy.sum_squares if norm == "rms" else cvxpy.norm_inf  # type: ignore[attr-defined]
    objective = distance(errors)
    conditions = reachable.matrix @ angles <= reachable.limit
    problem = cvxpy.Problem(cvxpy.Minimize(objective), [conditions])
    try:
        problem.solve(solver=cvxpy.CLARABEL)  # type: ignore[no-untyped-call]
    except cvxpy.SolverError as error:
        raise SolverFailed("lower bound", str(error)) from error
    logging.getLogger(__name__).debug(
        "lower bound: Clarabel says %s after %s iterations",
        problem.status,
        problem.solver_stats.num_iters if problem.solver_stats else "no",
    )
    if angles.value is None or conditions.dual_value is None:
        raise SolverFailed("lower bound", problem.status)
    return angles.value, np.maximum(conditions.dual_value, 0.0)


def certified_error(
    reachable: Reachable,
    desired: Array,
    reference: Array,
    multipliers: Array,
    *,
    norm: Norm,
    slack: float,
) -> float:
    """The lower bound that the multipliers prove, whoever proposed them.

    Args:
        reachable: The set.
        desired: Wanted angles, shape (n,).
        reference: Any angles at the ticks between samples, shape (ticks,).
        multipliers: lambda >= 0, shape (rows,).
        norm: Which error.
        slack: How far an angle between two samples can be from the sample before it.

    Returns:
        A number >= 0 that no trajectory of the set can go below.
    """
    point = reference.copy()
    point[reachable.sampled] = desired
    pull = reachable.matrix.T @ multipliers  # G' lambda, one entry per tick
    proved = float(multipliers @ (reachable.matrix @ point - reachable.limit))
    at_samples = pull[reachable.sampled]
    # Angles between samples are free, so there G' lambda should vanish; what is left of it counts.
    between = np.abs(pull)
    between[reachable.sampled] = 0.0
    nearest = np.repeat(desired, np.diff(reachable.sampled, append=len(point)))
    proved -= float(between @ (np.abs(point - nearest) + slack))
    if norm == "rms":
        size = np.sqrt(len(desired)) * (np.linalg.norm(at_samples) + between.sum())
    else:
        size = np.abs(at_samples).sum() + between.sum()
    return max(proved / float(size), 0.0) if size > 0.0 else 0.0


def _relative(reachable: Reachable, middle: float) -> Array:
    """The limits for angles measured from ``middle``."""
    shift: Array = reachable.matrix @ np.full(reachable.matrix.shape[1], middle)
    return reachable.limit - shift
