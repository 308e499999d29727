"""Lower bounds by Lagrange multipliers: weak duality on the linear conditions, (9) of math.md.

The solver, Clarabel, only proposes multipliers. The bound that they prove is computed here, so that
it is valid for any multipliers at all, and at the optimal ones it equals the distance from the set.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.arrays import Array
from planner.exceptions import SolverFailed
from planner.model.response import farthest_per_period
from planner.planning.bounds.reachable_set import (
    Level,
    ReachableSet,
    reachable_set,
)
from planner.planning.task import Norm, Task


def linear_bound(joint: Task, level: Level) -> float:
    """The distance of the desired angles from the joint's reachable set [rad], proved by (9).

    0 where a smooth motion through them is within the set, and with the integral of a speed loop,
    for which no condition holds. "slope" is condition 1 alone, others the envelope of 1 to 3.
    """
    (model,) = joint.nominal
    if model.exceeds_v_max:
        return 0.0
    sets = [reachable_set(joint, level)]
    if model.most_pose_sag > 0.0 and not model.has_inertia:
        levels: tuple[Level, ...] = ("slope",) if level == "slope" else ("slope", "envelope")
        sets += [reachable_set(joint, each, linearised=True) for each in levels]
    return max(bound_of(each, joint) for each in sets)


def bound_of(reachable: ReachableSet, joint: Task) -> float:
    """The distance of the desired angles from a reachable set [rad], proved by (9) or (9c)."""
    if not np.any(reachable.matrix @ interpolated(joint) > reachable.limits):
        return 0.0
    answer = nearest_motion(reachable, joint)
    if not answer.has_multipliers:
        raise SolverFailed("lower bound", answer.status)
    return certified_error(reachable, joint, answer.multipliers)


def interpolated(joint: Task) -> Array:
    """A smooth motion through the desired angles at every tick, cubic in between, (ticks,)."""
    hold, cyclic, desired = joint.nominal[0].hold, joint.cyclic, joint.desired[:, 0]
    ends = np.append(desired, desired[0]) if cyclic else desired
    slopes = np.gradient(ends)
    if cyclic:
        slopes[[0, -1]] = (desired[1] - desired[-1]) / 2.0
    share = np.arange(hold)[:, np.newaxis] / hold
    rest = 1.0 - share
    motion = rest**2 * ((1.0 + 2.0 * share) * ends[:-1] + share * slopes[:-1])
    motion += share**2 * ((1.0 + 2.0 * rest) * ends[1:] - rest * slopes[1:])
    ticks = motion.T.ravel()
    return ticks if cyclic else np.append(ticks, desired[-1])


def nearest_motion(reachable: ReachableSet, joint: Task) -> ConicSolution:
    """The motion of a set whose samples are nearest to the desired angles.

    The unknowns are the angles that are sampled or that a condition is about, and the speeds, in
    units of the largest one per tick. In the angles alone, whose second differences conditions are
    then about, motions with inertia take some five times as many iterations.
    """
    of_angles, steps = reachable.of_angles, reachable.steps
    sampled, desired, (model,) = reachable.sampled, joint.desired[:, 0], joint.nominal
    speed = farthest_per_period(model, joint.loads[0]) / model.hold
    speeds, ticks = steps.shape
    knots = np.union1d(sampled, of_angles.indices)
    # The speeds between two knots sum to the difference of their angles.
    interval = np.searchsorted(knots, np.arange(ticks - speeds, ticks))  # ends at this knot
    interval = interval % len(knots) if speeds == ticks else interval - 1
    sums = sparse.csr_array((np.ones(speeds), (interval, np.arange(speeds))))
    moved, equations = sparse.csr_array(sums @ steps)[:, knots], sums.shape[0]
    # Angles are counted from their middle, in units of their range.
    middle, unit = float(np.mean(desired)), max(float(np.ptp(desired)), speed * float(sampled[1]))
    moved, counted = moved * (unit / speed), of_angles[:, knots] * (unit / speed)
    matrix = sparse.block_array([[moved, -sums], [counted, reachable.of_speeds]])
    limits = (reachable.limits - middle * of_angles.sum(axis=1)) / speed
    answer = nearest_point(
        sparse.csr_array(matrix),
        np.concatenate([np.zeros(equations), limits]),
        np.searchsorted(knots, sampled),
        (desired - middle) / unit,
        norm=joint.norm,
        equations=equations,
    )
    angles, own = np.split(answer.unknowns, [len(knots)])
    unknowns = np.append(middle + unit * angles, own)
    return answer._replace(unknowns=unknowns, multipliers=answer.multipliers[equations:])


def nearest_point(
    matrix: sparse.csr_array,  # G, shape (rows, unknowns)
    limits: Array,  # b, shape (rows,)
    sampled: npt.NDArray[np.int_],  # which unknowns are compared, shape (n,)
    desired: Array,  # D, shape (n,)
    *,
    norm: Norm,  # "rms" for a QP on the squared distance, "max" for an LP on the largest
    equations: int = 0,  # the first so many rows hold with equality
) -> ConicSolution:
    """The z with ``matrix @ z <= limits`` whose samples are nearest to the desired angles."""
    rows, unknowns = matrix.shape
    origin = np.zeros(unknowns)  # unknowns are counted from D, so that no digits cancel
    origin[sampled] = desired
    right = limits - matrix @ origin
    objective, curvature = np.zeros(unknowns), np.zeros(unknowns)
    if norm == "rms":
        curvature[sampled] = 2.0
    else:  # one more unknown, the largest error, is at least each of them
        picked = sparse.eye_array(unknowns, format="csr")[sampled]
        largest = sparse.csr_array(-np.ones((len(sampled), 1)))
        blocks: list[list[Any]] = [[matrix, None], [picked, largest], [-picked, largest]]
        matrix = sparse.csr_array(sparse.block_array(blocks))
        right = np.concatenate([right, np.zeros(2 * len(sampled))])
        objective, curvature = np.append(objective, 1.0), np.append(curvature, 0.0)
    (answer,) = conic_solutions(
        matrix,
        right,
        [objective],
        equations=equations,
        curvature=curvature,
        # Valid at any; at 1e-8 a bound of 1e-4 of the range loses 2e-3 of itself.
        tolerance=1e-10,
    )
    return answer._replace(
        unknowns=origin + answer.unknowns[:unknowns], multipliers=answer.multipliers[:rows]
    )


def dual_value(
    matrix: sparse.csr_array, limits: Array, multipliers: Array, reference: Array, room: Array
) -> tuple[float, Array]:
    """The numerator of (9): ``lambda (G y - b) - |G' lambda| room``, and ``G' lambda``.

    y is the reference; ``room`` is the largest distance from it of each unknown without a desired
    value, 0 for the others.
    """
    gradient = matrix.T @ multipliers
    value = float(multipliers @ (matrix @ reference - limits) - np.abs(gradient) @ room)
    return value, gradient


def certified_error(reachable: ReachableSet, joint: Task, multipliers: Array) -> float:
    """The error of every trajectory of the set that any multipliers >= 0 prove, by (9) or (9c)."""
    matrix, samples, (model,) = reachable.matrix, len(joint.desired), joint.nominal
    farthest = farthest_per_period(model, joint.loads[0])
    speeds, ticks = reachable.steps.shape
    sample, after = np.divmod(np.arange(ticks), model.hold)
    between = after > 0
    # An angle between samples is within the error and the farthest move of the desired one before.
    room = np.where(between, farthest, 0.0)
    desired = joint.desired[sample, 0]
    value, gradient = dual_value(matrix, reachable.limits, multipliers, desired, room)
    at_samples, rest = gradient[~between], float(np.sum(np.abs(gradient[between])))
    of_error, of_square = np.zeros(samples), np.zeros(samples)
    if reachable.curvature > 0.0:
        at = np.arange(ticks - speeds, ticks) - 1  # before the ticks, in a cycle the last one too
        weights = multipliers[-2 * speeds :].reshape(2, speeds).sum(axis=0) * reachable.curvature
        away = after[at] * (farthest / model.hold)
        value -= float(weights @ away**2)
        of_error += np.bincount(sample[at], 2.0 * weights * away, samples)
        of_square += np.bincount(sample[at], weights, samples)
    if joint.norm == "rms":
        size = np.linalg.norm(at_samples) + rest + np.linalg.norm(of_error)
        size, quadratic = np.sqrt(samples) * size, float(samples * np.max(of_square))
    else:
        size, quadratic = np.abs(at_samples).sum() + rest + of_error.sum(), float(of_square.sum())
    if value <= 0.0 or size + quadratic <= 0.0:
        return 0.0
    # value <= size * error + quadratic * error^2
    return 2.0 * value / float(size + np.sqrt(size**2 + 4.0 * quadratic * value))


class ConicSolution(NamedTuple):
    """The solver's last point, and multipliers within the dual cones."""

    unknowns: Array  # the solver's point, shape (unknowns,)
    multipliers: Array  # one for each row; all zero where the solver has none
    status: str
    has_multipliers: bool  # whether they are finite: they then prove a bound at any status

    @property
    def solved(self) -> bool:
        """Whether the point is a solution, at least to a reduced accuracy."""
        return self.status in ("Solved", "AlmostSolved")


def conic_solutions(
    matrix: sparse.csr_array,  # G, shape (rows, unknowns)
    limits: Array,  # b, shape (rows,)
    objectives: Sequence[Array],  # linear parts c of the problems, each (unknowns,)
    *,
    equations: int = 0,  # the first so many rows of b - G z vanish; others are 0 or more
    balls: Sequence[int] = (),  # sizes of second-order cones, the last rows; first >= |the others|
    curvature: Array | None = None,  # q, shape (unknowns,), 0 or more; None for none
    tolerance: float,  # Clarabel's absolute and relative gap, and its feasibility
) -> list[ConicSolution]:
    """Minimise ``c @ z + z @ (q * z) / 2`` with ``b - G z`` in the cones, for every objective c.

    Multipliers outside the dual cones are projected on them; those not finite become zero.
    """
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.direct_solve_method = "qdldl"
    # Refined steps take 1.6 times as long; of 293 bounds none is 2e-5 of itself better.
    settings.iterative_refinement_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    end = len(limits) - sum(balls)
    kinds: list[Any] = [
        clarabel.ZeroConeT(equations),
        clarabel.NonnegativeConeT(end - equations),
        *map(clarabel.SecondOrderConeT, balls),
    ]
    flat = np.zeros(matrix.shape[1])
    curved = sparse.diags_array(flat if curvature is None else curvature).tocsc()
    solver = clarabel.DefaultSolver(curved, flat, matrix.tocsc(), limits, kinds, settings)
    answers = []
    for objective in objectives:
        solver.update(q=objective)
        solution = solver.solve()
        logging.getLogger(__name__).debug(
            "Clarabel: %s after %d iterations", solution.status, solution.iterations
        )
        unknowns, multipliers = np.nan_to_num(solution.x), np.array(solution.z)
        finite = bool(np.all(np.isfinite(multipliers)))
        if not finite:
            multipliers = np.zeros(len(multipliers))
        multipliers[equations:end] = np.maximum(multipliers[equations:end], 0.0)
        first = end
        for size in balls:
            length = float(np.linalg.norm(multipliers[first + 1 : first + size]))
            multipliers[first] = max(multipliers[first], length)
            first += size
        answers.append(ConicSolution(unknowns, multipliers, str(solution.status), finite))
    return answers
