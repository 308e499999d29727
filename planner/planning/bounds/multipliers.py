"""Lower bounds by Lagrange multipliers: weak duality on the linear conditions, (9) of math.md.

The solver, Clarabel, only proposes multipliers. The bound that they prove is computed here, so that
it is valid for any multipliers at all, and at the optimal ones it equals the distance from the set.
"""

from __future__ import annotations

import logging
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.exceptions import SolverFailed
from planner.planning.bounds.reachable_set import (
    BoundProblem,
    Level,
    ReachableSet,
    farthest_per_period,
    linearised_set,
    reachable_set,
)
from planner.planning.task import Norm
from planner.trajectory import Array

BOUND_TOLERANCE = 1e-10
"""Clarabel's gap and residuals, in units of the desired range or of a tick at top speed [-]. The
bound is valid at any; at 1e-8 a bound of 1e-4 of the range loses 2e-3 of itself, and below 1e-10
nothing is gained."""


def linear_bound(problem: BoundProblem, level: Level) -> float:
    """The distance of the desired angles from the joint's reachable set [rad], proved by (9).

    It is 0 where a smooth motion through the desired angles is within the set, and with the
    integral of a speed loop, for which none of the conditions holds. The level "slope" is condition
    1 alone, any other the envelope of conditions 1 to 3.

    Raises:
        SolverFailed: The solver proposed no multipliers.
    """
    if problem.model.exceeds_v_max:
        return 0.0
    sets = [reachable_set(problem, level)]
    if problem.model.most_pose_sag > 0.0 and not problem.model.has_inertia:
        levels: tuple[Level, ...] = ("slope",) if level == "slope" else ("slope", "envelope")
        sets += [linearised_set(problem, each) for each in levels]
    return max(bound_of(each, problem) for each in sets)


def bound_of(reachable: ReachableSet, problem: BoundProblem) -> float:
    """The distance of the desired angles from a reachable set [rad], proved by (9) or (9c)."""
    desired, norm = problem.desired, problem.norm
    if not np.any(reachable.matrix @ interpolated(desired, problem) > reachable.limits):
        return 0.0
    slack = farthest_per_period(problem.model, problem.load)
    answer = nearest_motion(reachable, desired, norm=norm, speed=slack / problem.model.hold)
    if not answer.has_multipliers:
        raise SolverFailed("lower bound", answer.status)
    return certified_error(reachable, desired, answer.multipliers, norm=norm, slack=slack)


def interpolated(desired: Array, problem: BoundProblem) -> Array:
    """A smooth motion through the desired angles at every tick, cubic in between, (ticks,)."""
    hold, cyclic = problem.model.hold, problem.cyclic
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


def nearest_motion(
    reachable: ReachableSet, desired: Array, *, norm: Norm, speed: float
) -> ConicSolution:
    """The motion of a set whose samples are nearest to the desired angles.

    The unknowns are the angles that are sampled or that a condition is about, and the speeds, in
    units of ``speed``, the largest one per tick. In the angles of all ticks alone the conditions
    are second differences: motions of 100 to 2,000 samples with inertia took 70 to 200 iterations,
    now 16 to 39. The answer has a multiplier for each row of the set.
    """
    (of_angles, of_speeds), steps = reachable.parts, reachable.steps
    sampled = reachable.sampled
    speeds, ticks = steps.shape
    knots = np.union1d(sampled, of_angles.indices)
    # The speeds between two knots sum to the difference of their angles.
    interval = np.searchsorted(knots, np.arange(ticks - speeds, ticks))  # ends at this knot
    interval = interval % len(knots) if speeds == ticks else interval - 1
    sums = sparse.csr_array((np.ones(speeds), (interval, np.arange(speeds))))
    moved, equations = sparse.csr_array(sums @ steps)[:, knots], sums.shape[0]
    # Angles are counted from their middle, in units of their range.
    middle, unit = float(np.mean(desired)), max(float(np.ptp(desired)), speed * float(sampled[1]))
    matrix = sparse.block_array(
        [
            [moved * (unit / speed), -sums],
            [of_angles[:, knots] * (unit / speed), of_speeds],
        ]
    )
    limits = (reachable.limits - middle * of_angles.sum(axis=1)) / speed
    answer = nearest_point(
        sparse.csr_array(matrix),
        np.concatenate([np.zeros(equations), limits]),
        np.searchsorted(knots, sampled),
        (desired - middle) / unit,
        norm=norm,
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
    """Minimise the distance of z[sampled] from the desired angles over ``matrix @ z <= limits``.

    Returns:
        The nearest z and a multiplier for each row.
    """
    rows, unknowns = matrix.shape
    origin = np.zeros(unknowns)  # unknowns are counted from D, so that no digits cancel
    origin[sampled] = desired
    right = limits - matrix @ origin
    cones = Cones(equations, rows - equations)
    if norm == "rms":
        curvature = np.zeros(unknowns)
        curvature[sampled] = 2.0
        answer = ConicSolver(
            matrix, right, cones, curvature=curvature, tolerance=BOUND_TOLERANCE
        ).solve(np.zeros(unknowns))
        return answer._replace(unknowns=origin + answer.unknowns)
    # One more unknown, the largest error, is at least each of them.
    picked = sparse.eye_array(unknowns, format="csr")[sampled]
    largest = sparse.csr_array(-np.ones((len(sampled), 1)))
    blocks: list[list[Any]] = [[matrix, None], [picked, largest], [-picked, largest]]
    answer = ConicSolver(
        sparse.csr_array(sparse.block_array(blocks)),
        np.concatenate([right, np.zeros(2 * len(sampled))]),
        cones._replace(at_most=cones.at_most + 2 * len(sampled)),
        tolerance=BOUND_TOLERANCE,
    ).solve(np.append(np.zeros(unknowns), 1.0))
    return answer._replace(
        unknowns=origin + answer.unknowns[:-1], multipliers=answer.multipliers[:rows]
    )


def dual_value(
    matrix: sparse.csr_array, limits: Array, multipliers: Array, reference: Array, room: Array
) -> tuple[float, Array]:
    """The numerator of (9): ``lambda (G y - b) - |G' lambda| room``, and ``G' lambda``.

    The product of the second with y - z is at least the first for all z of the set ``G z <= b``,
    with multipliers of at least 0 where a row is an inequality. y is the reference; ``room`` is the
    largest distance from it of each unknown without a desired value, 0 for the others.
    """
    gradient = matrix.T @ multipliers
    value = float(multipliers @ (matrix @ reference - limits) - np.abs(gradient) @ room)
    return value, gradient


def certified_error(
    reachable: ReachableSet,
    desired: Array,  # desired angles D, shape (n,)
    multipliers: Array,  # lambda >= 0, shape (rows,)
    *,
    norm: Norm,
    slack: float,  # largest distance of an angle between two samples from the sample before it
) -> float:
    """The lower bound that any multipliers prove by (9), or with linearised conditions by (9c).

    Returns:
        Lower bound on the error of every trajectory of the set, at least 0.
    """
    matrix, sampled = reachable.matrix, reachable.sampled
    ticks = matrix.shape[1]
    before = np.repeat(desired, np.diff(sampled, append=ticks))
    between = np.ones(ticks, dtype=np.bool_)
    between[sampled] = False
    # An angle between samples is within the error and the slack of the desired one before it.
    room = np.where(between, slack, 0.0)
    value, gradient = dual_value(matrix, reachable.limits, multipliers, before, room)
    at_samples, rest = gradient[sampled], float(np.sum(np.abs(gradient[between])))
    of_error: Array = np.zeros(len(desired))
    quadratic = 0.0
    if reachable.curvature is not None:
        rows, factors, samples, between_samples = reachable.curvature
        weights = multipliers[rows] * factors
        value -= float(weights @ between_samples**2)
        of_error += np.bincount(samples, 2.0 * weights * between_samples, len(desired))
        of_square = np.bincount(samples, weights, len(desired))
        quadratic = float(len(desired) * np.max(of_square) if norm == "rms" else of_square.sum())
    if norm == "rms":
        size = np.sqrt(len(desired)) * (np.linalg.norm(at_samples) + rest)
        size += np.sqrt(len(desired)) * np.linalg.norm(of_error)
    else:
        size = np.abs(at_samples).sum() + rest + of_error.sum()
    if value <= 0.0 or size + quadratic <= 0.0:
        return 0.0
    if quadratic == 0.0:
        return float(value / float(size))
    # value <= size * error + quadratic * error^2
    return 2.0 * value / float(size + np.sqrt(size**2 + 4.0 * quadratic * value))


class Cones(NamedTuple):
    """Numbers of rows of ``limits - matrix @ unknowns`` in each cone, in order."""

    zero: int  # rows that vanish
    at_most: int  # rows that are at least zero
    # rows of second-order cones: the first of each is at least the length of the rest
    balls: tuple[int, ...] = ()


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


class ConicSolver:
    """Minimises ``linear @ z + z @ (curvature * z) / 2`` over ``limits - matrix @ z`` in the cones.

    Set-up takes several times as long as the solution of a small problem: problems that differ in
    their linear part alone share a solver.
    """

    def __init__(
        self,
        matrix: sparse.csr_array,  # matrix of the conditions, shape (rows, unknowns)
        limits: Array,  # their right-hand sides, shape (rows,)
        cones: Cones,  # cones of the rows of ``limits - matrix @ z``
        *,
        curvature: Array | None = None,  # shape (unknowns,), 0 or more; None for none
        tolerance: float,  # Clarabel's absolute and relative gap, and its feasibility
    ) -> None:
        """Set up problems."""
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False
        settings.direct_solve_method = "qdldl"
        # Refined steps take 1.6 times as long; of 293 bounds none is 2e-5 of itself better.
        settings.iterative_refinement_enable = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        kinds: list[Any] = [
            clarabel.ZeroConeT(cones.zero),
            clarabel.NonnegativeConeT(cones.at_most),
        ]
        kinds += map(clarabel.SecondOrderConeT, cones.balls)
        flat = np.zeros(matrix.shape[1])
        curved = sparse.diags_array(flat if curvature is None else curvature).tocsc()
        self._cones = cones
        self._solver = clarabel.DefaultSolver(curved, flat, matrix.tocsc(), limits, kinds, settings)

    def solve(self, linear: Array) -> ConicSolution:
        """The answer for a linear part, shape (unknowns,).

        Multipliers outside the dual cones are projected on them; multipliers that are not finite
        become zero.
        """
        self._solver.update(q=linear)
        solution, cones = self._solver.solve(), self._cones
        logging.getLogger(__name__).debug(
            "Clarabel: %s after %d iterations", solution.status, solution.iterations
        )
        unknowns, multipliers = np.nan_to_num(solution.x), np.array(solution.z)
        finite = bool(np.all(np.isfinite(multipliers)))
        if not finite:
            multipliers = np.zeros(len(multipliers))
        end = cones.zero + cones.at_most
        multipliers[cones.zero : end] = np.maximum(multipliers[cones.zero : end], 0.0)
        for size in cones.balls:
            length = float(np.linalg.norm(multipliers[end + 1 : end + size]))
            multipliers[end] = max(multipliers[end], length)
            end += size
        return ConicSolution(unknowns, multipliers, str(solution.status), finite)
