"""Arguments of the inversions: norm, solver, limits, tolerance; models and loads of each joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from planner.exceptions import Infeasible, InvalidInput, angle_text
from planner.model.joint import JointModel
from planner.model.load import checked_load
from planner.trajectory import Array
from planner.validation import as_number, as_positive, as_reals, is_one_of, shown

Norm = Literal["rms", "max"]

NORMS: tuple[Norm, ...] = ("rms", "max")
"""The error that counts: the root mean square, or the largest."""

Solver = Literal["gauss-newton", "ipopt"]

SOLVERS: tuple[Solver, ...] = ("gauss-newton", "ipopt")
"""Solvers of the optimised inversion: the package's own, and IPOPT through CasADi."""

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


MOST_SMOOTHNESS = 1e6
"""Largest rise that is taken [-]: requests that do not move at all are reached long before."""


def checked_smoothness(smoothness: float | None) -> float:
    """The relative rise of the error that smoother requests may cost [-].

    Raises:
        InvalidInput: It is no number from 0 to :data:`MOST_SMOOTHNESS`.
    """
    if smoothness is None:
        return SMOOTHNESS
    number = as_number(smoothness)
    if not 0.0 <= number <= MOST_SMOOTHNESS:
        raise InvalidInput(
            f"smoothness: got {shown(smoothness)}, expected the share of the error that may be "
            f"added, from 0 to {MOST_SMOOTHNESS:g}; 0.005 is half a per cent"
        )
    return number


def checked_tolerance(tolerance: float | None) -> float | None:
    """The tolerance as a float, None where none is asked for; raise InvalidInput for no number."""
    if tolerance is None:
        return None
    return as_positive("tolerance", tolerance, "a finite number above 0")


def model_of_each(
    models: JointModel | Sequence[JointModel], count: int, *, given_as: str, joints: str
) -> tuple[JointModel, ...]:
    """A model for every joint; raise InvalidInput where they do not fit.

    Args:
        models: One for all of them, or one for each.
        count: How many joints there are.
        given_as: What the caller calls the models.
        joints: What has a joint each, in words.
    """
    try:
        each = (models,) * count if isinstance(models, JointModel) else tuple(models)
    except TypeError:
        each = ()
    if len(each) != count or not all(isinstance(model, JointModel) for model in each):
        raise InvalidInput(
            f"{given_as}: got {len(each)} of them for {count} joints, expected one JointModel, or "
            f"one for each of the {joints}"
        )
    periods = sorted({model.period for model in each})
    if len(periods) > 1:
        raise InvalidInput(
            f"{given_as}: their periods are {', '.join(f'{p:g}' for p in periods)} s, expected one "
            "period: joints that are requested at different rates are not planned together"
        )
    return each


def range_of_each(
    limits: tuple[npt.ArrayLike, npt.ArrayLike], count: int, *, joints: str
) -> tuple[Array, Array]:
    """Smallest and largest request of every joint [rad], each of shape (count,), not yet compared.

    Raises:
        InvalidInput: They are no pair of numbers, or of as many as there are joints.
    """
    try:
        lower, upper = (np.broadcast_to(as_reals(limit), count).copy() for limit in limits)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"limits: got {shown(limits)}, "
            f"expected (lower, upper) [rad], each a number or one for each of the {joints}"
        ) from error
    return lower, upper


def steps_of_each(max_step: npt.ArrayLike | None, count: int, *, joints: str) -> Array:
    """Largest change of every joint's request [rad], shape (count,), inf where there is no limit.

    Raises:
        InvalidInput: They are not above 0, or not as many as there are joints.
    """
    if max_step is None:
        return np.full(count, np.inf)
    try:
        steps = np.broadcast_to(as_reals(max_step), count)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"max_step: got {shown(max_step)}, expected an angle above 0 [rad], or one for each of "
            f"the {joints}"
        ) from error
    return np.array([checked_max_step(step) for step in steps.tolist()])


def load_of_each(
    load: npt.ArrayLike | None, models: Sequence[JointModel], samples: int, *, joints: str
) -> tuple[Array | None, ...]:
    """The torque on every joint [N m], (samples,), or None where it changes nothing.

    Args:
        load: A number, one of each joint, or one of each joint at every sample; for one joint also
            shape (samples,).
        models: The joints.
        samples: Number of samples.
        joints: What has a joint each, in words.
    """
    if load is None:
        return (None,) * len(models)
    try:
        given = as_reals(load)
        if len(models) == 1 and given.ndim == 1:
            given = given.reshape(-1, 1)
        torques = np.broadcast_to(given, (samples, len(models)))
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"load: got {shown(load)}, expected a torque [N m], one for each of the {joints}, or "
            f"{samples} rows of them"
        ) from error
    columns = zip(torques.T, models, strict=True)
    return tuple(checked_load(column, model, samples) for column, model in columns)
