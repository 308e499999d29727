"""The conic solver Clarabel; its multipliers are made feasible, so that they prove a bound."""

from __future__ import annotations

import logging
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from planner.trajectory import Array


class Cones(NamedTuple):
    """Numbers of rows of ``limits - matrix @ unknowns`` in each cone, in order.

    Attributes:
        zero: Rows that vanish.
        at_most: Rows that are at least zero.
        ball: Rows of a second-order cone: the first is at least the length of the rest.
    """

    zero: int
    at_most: int
    ball: int = 0


class ConicSolution(NamedTuple):
    """The solver's last point, and multipliers within the dual cones.

    Attributes:
        unknowns: The solver's point, shape (unknowns,).
        multipliers: One for each row; all zero where the solver has none.
        status: The solver's status.
        has_multipliers: Whether they are finite: they then prove a bound at any status.
    """

    unknowns: Array
    multipliers: Array
    status: str
    has_multipliers: bool

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
        matrix: sparse.csr_array,
        limits: Array,
        cones: Cones,
        *,
        curvature: Array | None = None,
        tolerance: float,
    ) -> None:
        """Set up problems.

        Args:
            matrix: Matrix of the conditions, shape (rows, unknowns).
            limits: Their right-hand sides, shape (rows,).
            cones: Cones of the rows of ``limits - matrix @ z``.
            curvature: Shape (unknowns,), 0 or more; None for none.
            tolerance: Clarabel's absolute and relative gap, and its feasibility.
        """
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False
        settings.direct_solve_method = "qdldl"
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        kinds: list[Any] = [
            clarabel.ZeroConeT(cones.zero),
            clarabel.NonnegativeConeT(cones.at_most),
        ]
        if cones.ball:
            kinds.append(clarabel.SecondOrderConeT(cones.ball))
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
        if cones.ball:
            length = float(np.linalg.norm(multipliers[end + 1 :]))
            multipliers[end] = max(multipliers[end], length)
        return ConicSolution(unknowns, multipliers, str(solution.status), finite)
