"""Arguments of the inversions: the norm of the error, the solver, limits, a tolerance."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from planner.exceptions import Infeasible, InvalidInput, angle_text
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
            f"{of}: the lower one, {angle_text(lower)}, is above the upper one, "
            f"{angle_text(upper)}; swap them, or check their units"
        )
    return lower, upper


def check_within(
    limits: Limits,
    *,
    desired: Array,
    start: float | None,
    model: JointModel,
    load: Array | None = None,
) -> None:
    """Raise Infeasible where the start or a desired angle is one that no request can hold.

    A negligible sag is left out of it: the joint then stays that little short of the limit. Dry
    friction holds the joint wherever the request is within the dead band.
    """
    lower, upper = limits
    angles, torques = desired, np.zeros(len(desired)) if load is None else load
    if start is not None:
        angles, torques = np.append(desired, start), np.append(torques, torques[0])
    sags = model.sag(torques)
    beyond = np.maximum(lower - (angles - sags), (angles - sags) - upper) - model.dead_band
    worst = int(np.argmax(beyond - np.minimum(np.abs(sags), NEGLIGIBLE_SAG)))
    sag = float(sags[worst])
    if beyond[worst] > ON_THE_LIMIT + min(abs(sag), NEGLIGIBLE_SAG):
        what = f"desired: sample {worst}" if worst < len(desired) else "start: it"
        raise Infeasible(
            f"{what} is {angle_text(angles[worst])}, {angle_text(beyond[worst])} beyond the angles "
            f"{angle_text(lower + sag - model.dead_band, upper + sag + model.dead_band)} where the "
            "limits on the requests let the joint rest; clip the trajectory, or widen the limits"
        )


def checked_max_step(max_step: float | None) -> float:
    """The largest change from one request to the next [rad], inf where there is no limit.

    Raises:
        InvalidInput: It is no number above 0.
    """
    if max_step is None:
        return math.inf
    number = as_number(max_step, infinite=True)
    if not number > 0.0:
        raise InvalidInput(
            f"max_step: got {shown(max_step)}, expected an angle above 0 [rad], the largest change "
            "from one request to the next; leave it out for no limit"
        )
    return number


SMOOTHNESS = 0.005
"""Relative rise of the error that smoother requests may cost where nothing else is asked for [-].
"""


def checked_smoothness(smoothness: float | None) -> float:
    """The relative rise of the error that smoother requests may cost [-].

    Raises:
        InvalidInput: It is no finite number, or below 0.
    """
    if smoothness is None:
        return SMOOTHNESS
    number = as_number(smoothness)
    if not number >= 0.0:
        raise InvalidInput(
            f"smoothness: got {shown(smoothness)}, expected the share of the error that may be "
            "added, 0 or more; 0.005 is half a per cent"
        )
    return number


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
