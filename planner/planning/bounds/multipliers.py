"""Lower bounds by Lagrange multipliers: weak duality on the linear conditions, (9) of math.md.

The solver only proposes multipliers. The bound that they prove is computed here, so that it is
valid for any multipliers at all, and at the optimal ones it equals the distance from the set.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.exceptions import SolverFailed
from planner.planning.arguments import Norm
from planner.planning.bounds.clarabel import Cones, ConicSolution, ConicSolver
from planner.planning.bounds.reachable_set import (
    BoundProblem,
    Level,
    ReachableSet,
    farthest_per_period,
    reachable_set,
)
from planner.trajectory import Array

BOUND_TOLERANCE = 1e-10
"""Clarabel's gap and residuals, in units of the desired range or of a tick at top speed [-]. What
is proved is valid at any; at 1e-8 a bound of 2e-3 of the range loses 1e-5 of itself, and below
1e-10 nothing is gained."""


def linear_bound(problem: BoundProblem, level: Level) -> float:
    """The distance of the desired angles from the joint's reachable set [rad], proved by (9).

    Args:
        problem: The joint, and what is desired of it.
        level: "slope" for condition 1, otherwise the "envelope" of conditions 1 to 3.

    Raises:
        SolverFailed: The solver proposed no multipliers.
    """
    desired, norm = problem.desired, problem.norm
    middle, slack = float(np.mean(desired)), farthest_per_period(problem.model, problem.load)
    scale = max(float(np.ptp(desired)), slack)
    reachable = reachable_set(problem, level)
    matrix, sampled = reachable.matrix, reachable.sampled
    limits = (reachable.limits - matrix @ np.full(matrix.shape[1], middle)) / scale
    centred = (desired - middle) / scale
    answer = nearest_point(matrix, limits, sampled, centred, norm=norm)
    if not answer.has_multipliers:
        raise SolverFailed("lower bound", answer.status)
    scaled = ReachableSet(matrix, limits, sampled)
    proved = certified_error(
        scaled, centred, answer.unknowns, answer.multipliers, norm=norm, slack=slack / scale
    )
    return scale * proved


def nearest_point(
    matrix: sparse.csr_array,
    limits: Array,
    sampled: npt.NDArray[np.int_],
    desired: Array,
    *,
    norm: Norm,
    equations: int = 0,
) -> ConicSolution:
    """Minimise the distance of z[sampled] from the desired angles over ``matrix @ z <= limits``.

    Args:
        matrix: G, shape (rows, unknowns).
        limits: b, shape (rows,).
        sampled: Which unknowns are compared, shape (n,).
        desired: D, shape (n,).
        norm: "rms" for a QP on the squared distance, "max" for an LP on the largest.
        equations: The first so many rows hold with equality.

    Returns:
        The nearest z and a multiplier for each row.
    """
    rows, unknowns = matrix.shape
    origin = np.zeros(unknowns)  # unknowns are counted from D, so that no digits cancel
    origin[sampled] = desired
    left = limits - matrix @ origin
    cones = Cones(equations, rows - equations)
    if norm == "rms":
        curvature = np.zeros(unknowns)
        curvature[sampled] = 2.0
        answer = ConicSolver(
            matrix, left, cones, curvature=curvature, tolerance=BOUND_TOLERANCE
        ).solve(np.zeros(unknowns))
        return answer._replace(unknowns=origin + answer.unknowns)
    # One more unknown, the largest error, is at least each of them.
    picked = sparse.eye_array(unknowns, format="csr")[sampled]
    largest = sparse.csr_array(-np.ones((len(sampled), 1)))
    blocks: list[list[Any]] = [[matrix, None], [picked, largest], [-picked, largest]]
    answer = ConicSolver(
        sparse.csr_array(sparse.block_array(blocks)),
        np.concatenate([left, np.zeros(2 * len(sampled))]),
        cones._replace(at_most=cones.at_most + 2 * len(sampled)),
        tolerance=BOUND_TOLERANCE,
    ).solve(np.append(np.zeros(unknowns), 1.0))
    return answer._replace(
        unknowns=origin + answer.unknowns[:-1], multipliers=answer.multipliers[:rows]
    )


class DualValue(NamedTuple):
    """What multipliers prove: ``gradient @ (reference - z) >= value`` for all z of a set."""

    value: float
    gradient: Array


def dual_value(
    matrix: sparse.csr_array, limits: Array, multipliers: Array, reference: Array, room: Array
) -> DualValue:
    """The numerator of (9): ``lambda (G y - b) - |G' lambda| room``, and ``G' lambda``.

    Args:
        matrix: G, shape (rows, unknowns).
        limits: b, shape (rows,).
        multipliers: lambda, shape (rows,): at least 0 where a row is an inequality.
        reference: y, shape (unknowns,).
        room: How far an unknown that is compared with nothing can be from y, shape (unknowns,); 0
            where it is compared.
    """
    gradient = matrix.T @ multipliers
    value = float(multipliers @ (matrix @ reference - limits) - np.abs(gradient) @ room)
    return DualValue(value, gradient)


def certified_error(
    reachable: ReachableSet,
    desired: Array,
    reference: Array,
    multipliers: Array,
    *,
    norm: Norm,
    slack: float,
) -> float:
    """The lower bound that any multipliers prove by (9).

    Args:
        reachable: The set.
        desired: Desired angles D, shape (n,).
        reference: Any angles at the ticks between samples, shape (ticks,).
        multipliers: lambda >= 0, shape (rows,).
        norm: Which error.
        slack: How far an angle between two samples can be from the sample before it.

    Returns:
        A number >= 0 that no trajectory of the set can go below.
    """
    point = reference.copy()
    point[reachable.sampled] = desired
    before = np.repeat(desired, np.diff(reachable.sampled, append=len(point)))
    between = np.ones(len(point), dtype=np.bool_)
    between[reachable.sampled] = False
    # An angle between samples is within the error and the slack of the desired one before it.
    room = np.where(between, np.abs(point - before) + slack, 0.0)
    value, gradient = dual_value(reachable.matrix, reachable.limits, multipliers, point, room)
    at_samples, rest = gradient[reachable.sampled], float(np.sum(np.abs(gradient[between])))
    if norm == "rms":
        size = np.sqrt(len(desired)) * (np.linalg.norm(at_samples) + rest)
    else:
        size = np.abs(at_samples).sum() + rest
    return max(value / float(size), 0.0) if size > 0.0 else 0.0
