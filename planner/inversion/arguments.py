"""Arguments of the inversions: the norm of the error, the solver, limits, a tolerance."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from planner.exceptions import Infeasible, InvalidInput
from planner.model.joint import JointModel
from planner.trajectory import Array
from planner.validation import as_number, is_one_of, shown

Norm = Literal["rms", "max"]

NORMS: tuple[Norm, ...] = ("rms", "max")
"""The error that counts: the root mean square, or the largest."""

Solver = Literal["gauss-newton", "ipopt", "fatrop"]

SOLVERS: tuple[Solver, ...] = ("gauss-newton", "ipopt", "fatrop")
"""What solves the problem of the optimised inversion: the package's own, or CasADi's."""

Limits = tuple[float, float]

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


def checked_limits(limits: tuple[float, float], *, of: str = "limits") -> Limits:
    """The limits as floats.

    Raises:
        InvalidInput: The limits are not two numbers.
        Infeasible: The lower limit is above the upper one.
    """
    try:
        lower, upper = (as_number(limit, infinite=True) for limit in limits)
    except (TypeError, ValueError):
        lower = upper = math.nan
    if math.isnan(lower) or math.isnan(upper):
        raise InvalidInput(
            f"{of}: got {shown(limits)}, "
            "expected (lower, upper) [rad]; use -inf or inf for no limit"
        )
    if lower > upper:
        raise Infeasible(
            f"{of}: the lower one, {lower:g} rad, is above the upper one, {upper:g} rad; "
            "swap them, or check their units"
        )
    return lower, upper


def check_within(limits: Limits, *, desired: Array, start: float | None, model: JointModel) -> None:
    """Raise Infeasible where the start or a desired angle is one that no request can hold.

    A negligible sag is left out of it: the joint then stays that little short of the limit.
    """
    lower, upper = limits
    angles = desired if start is None else np.append(desired, start)
    beyond = np.maximum(lower - (angles - model.offset), (angles - model.offset) - upper)
    worst = int(np.argmax(beyond))
    if beyond[worst] > ON_THE_LIMIT + min(abs(model.offset), NEGLIGIBLE_SAG):
        what = f"desired: sample {worst}" if worst < len(desired) else "start: it"
        raise Infeasible(
            f"{what} is {angles[worst]:.6g} rad, {beyond[worst]:.3g} rad beyond the angles "
            f"{lower + model.offset:.6g} to {upper + model.offset:.6g} rad where the limits on the "
            "requests let the joint rest; clip the trajectory, or widen the limits"
        )


def checked_tolerance(tolerance: float | None) -> float | None:
    """The tolerance as a float, None where none is asked for; raise InvalidInput for no number."""
    if tolerance is None:
        return None
    return positive("tolerance", tolerance, "a finite number above 0")


def positive(name: str, value: float, expected: str) -> float:
    """The value as a float, if it is finite and above 0; else raise InvalidInput."""
    number = as_number(value)
    if not number > 0.0:
        raise InvalidInput(f"{name}: got {shown(value)}, expected {expected}")
    return number
