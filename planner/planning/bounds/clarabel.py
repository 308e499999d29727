"""The conic solver Clarabel; its multipliers are made feasible, so that they prove a bound."""

from __future__ import annotations

import logging
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
        has_multipliers: Whether they are finite: they then prove a bound, however it ended.
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
    """Minimises ``linear @ z + z @ curvature @ z / 2`` over ``limits - matrix @ z`` in the cones.

    Set-up takes several times as long as a small problem's solution: problems whose matrices have
    their entries at the same places share one.
    """

    def __init__(
        self,
        linear: Array,
        matrix: sparse.csr_array | sparse.csc_array,
        limits: Array,
        cones: Cones,
        *,
        curvature: Array | sparse.csc_array | None = None,
        tolerance: float,
    ) -> None:
        """Set up a problem.

        Args:
            linear: Linear part of the objective, shape (unknowns,).
            matrix: Matrix of the conditions, shape (rows, unknowns).
            limits: Their right-hand sides, shape (rows,).
            cones: What the rows of ``limits - matrix @ z`` are.
            curvature: Upper triangle of a matrix, or the diagonal of one, shape (unknowns,); None
                for none.
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
        if curvature is None:
            curvature = np.zeros(matrix.shape[1])
        if isinstance(curvature, np.ndarray):
            curvature = sparse.diags_array(curvature).tocsc()
        self._cones = cones
        self._solver = clarabel.DefaultSolver(
            curvature, linear, matrix.tocsc(), limits, kinds, settings
        )

    def update(
        self,
        linear: Array,
        *,
        entries: Array | None = None,
        limits: Array | None = None,
        curvature_entries: Array | None = None,
    ) -> None:
        """Change the problem: its linear part, and what else is not None.

        Args:
            linear: As above.
            entries: The matrix's stored entries, column by column.
            limits: As above.
            curvature_entries: The stored entries of the curvature, column by column.
        """
        parts = {"P": curvature_entries, "q": linear, "A": entries, "b": limits}
        self._solver.update(**{name: part for name, part in parts.items() if part is not None})

    def solve(self) -> ConicSolution:
        """The solver's answer; multipliers outside the dual cones, or not finite, prove nothing."""
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
