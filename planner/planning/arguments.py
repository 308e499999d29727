"""The choices that a plan is made with: which error counts, over which models, which solver."""

from __future__ import annotations

from typing import Literal, get_args

from planner.exceptions import InvalidInput
from planner.validation import is_one_of, shown

Norm = Literal["rms", "max"]

NORMS: tuple[Norm, ...] = ("rms", "max")
"""The error that counts: the root mean square, or the largest."""

Solver = Literal["gauss-newton", "ipopt"]

SOLVERS: tuple[Solver, ...] = ("gauss-newton", "ipopt")
"""Solvers of the optimised inversion: the package's own, and IPOPT through CasADi."""

Robust = Literal["mean", "worst"]
"""Which error over several models is made small."""

Limits = tuple[float, float]
"""Smallest and largest request [rad]."""

ON_THE_LIMIT = 1e-9
"""How far beyond its limits a desired angle may lie [rad]: rounding of degrees, no more."""

NEGLIGIBLE_SAG = 1e-3
"""So much of a sag does not put a path out of reach [rad]: a fifth of a count of the ERS-210A's
sensor, and as much as an identification makes of none."""


def check_norm(norm: str) -> None:
    """Raise InvalidInput unless ``norm`` is the name of a norm."""
    if not is_one_of(norm, NORMS):
        raise InvalidInput(
            f"norm: got {shown(norm)}, expected one of {', '.join(map(repr, NORMS))}"
        )


def check_solver(solver: str) -> None:
    """Raise InvalidInput unless ``solver`` is the name of a solver."""
    if not is_one_of(solver, SOLVERS):
        expected = f"{', '.join(map(repr, SOLVERS[:-1]))} or {SOLVERS[-1]!r}"
        raise InvalidInput(f"unknown solver {shown(solver)}; expected {expected}")


def check_robust(robust: str | None) -> None:
    """Raise InvalidInput unless ``robust`` names an error over several models, or is None."""
    if robust is not None and not is_one_of(robust, get_args(Robust)):
        raise InvalidInput(f"robust: got {shown(robust)}, expected 'mean' or 'worst'")
