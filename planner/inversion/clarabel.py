"""The conic solver Clarabel; its multipliers are made feasible, so that they prove a bound."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from planner.trajectory import Array


class Cones(NamedTuple):
    """What the rows of ``limits - matrix @ unknowns`` are, in order.

    Attributes:
        zero: So many vanish.
        at_most: So many are at least zero.
        ball: So many, if any, have their first at least the length of the others.
    """

    zero: int
    at_most: int
    ball: int = 0


class ConicSolution(NamedTuple):
    """Where the solver stopped, and multipliers within the dual cones.

    Attributes:
        unknowns: The solver's point, shape (unknowns,).
        multipliers: One for each row; all zero where the solver has none.
        status: The solver's own word for how it ended.
        usable: Whether it has multipliers.
    """

    unknowns: Array
    multipliers: Array
    status: str
    usable: bool


def minimise_over_cones(
    slopes: Sequence[Array],
    matrix: sparse.csr_array | sparse.csc_array,
    limits: Array,
    cones: Cones,
    *,
    curvature: Array | sparse.csc_array | None = None,
    tolerance: float,
) -> list[ConicSolution]:
    """Minimise ``slope @ z + z @ curvature @ z / 2`` over ``limits - matrix @ z`` in the cones.

    The conditions are set up once for all slopes.

    Args:
        slopes: Linear parts of the objectives, each of shape (unknowns,).
        matrix: Matrix of the conditions, shape (rows, unknowns).
        limits: Their right-hand sides, shape (rows,).
        cones: What the rows of ``limits - matrix @ z`` are.
        curvature: Upper triangle of a matrix, or the diagonal of one, shape (unknowns,); None for
            none.
        tolerance: Clarabel's absolute and relative gap, and its feasibility.

    Returns:
        An answer for each slope.
    """
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.direct_solve_method = "qdldl"
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    kinds: list[Any] = [clarabel.ZeroConeT(cones.zero), clarabel.NonnegativeConeT(cones.at_most)]
    if cones.ball:
        kinds.append(clarabel.SecondOrderConeT(cones.ball))
    if curvature is None:
        curvature = np.zeros(matrix.shape[1])
    if isinstance(curvature, np.ndarray):
        curvature = sparse.diags_array(curvature).tocsc()
    solver = clarabel.DefaultSolver(
        curvature,
        slopes[0],
        matrix.tocsc(),
        limits,
        kinds,
        settings,
    )
    answers: list[ConicSolution] = []
    for slope in slopes:
        if answers:
            solver.update(q=slope)
        solution = solver.solve()
        answers.append(_feasible(solution, cones))
    logging.getLogger(__name__).debug(
        "Clarabel: %s after %d iterations", solution.status, solution.iterations
    )
    return answers


def _feasible(solution: Any, cones: Cones) -> ConicSolution:
    """The solver's answer; multipliers outside the dual cones, or not finite, prove nothing."""
    unknowns, multipliers = np.nan_to_num(solution.x), np.array(solution.z)
    usable = bool(np.all(np.isfinite(multipliers)))
    if not usable:
        multipliers = np.zeros(len(multipliers))
    end = cones.zero + cones.at_most
    multipliers[cones.zero : end] = np.maximum(multipliers[cones.zero : end], 0.0)
    if cones.ball:
        length = float(np.linalg.norm(multipliers[end + 1 :]))
        multipliers[end] = max(multipliers[end], length)
    return ConicSolution(unknowns, multipliers, str(solution.status), usable)
