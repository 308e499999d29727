"""Arguments about several joints: a model and limits on the requests of each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from planner.exceptions import InvalidInput
from planner.inversion.arguments import checked_limits, checked_max_step
from planner.model.joint import JointModel
from planner.model.load import checked_load
from planner.trajectory import Array
from planner.validation import as_reals, shown


def checked_leg(leg: object) -> Leg:
    """The leg, or InvalidInput where it is none."""
    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {shown(leg)}, expected a kinematics.Leg")
    return leg


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


def axis_scales(weights: Array) -> Array:
    """Factors of the three axes, the heaviest 1: the root of each weight, shape (3,)."""
    scales: Array = np.sqrt(weights / np.max(weights))
    return scales


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


def limits_of(limits: tuple[npt.ArrayLike, npt.ArrayLike] | None, leg: Leg) -> tuple[Array, Array]:
    """Smallest and largest request of a leg's joints [rad], each of shape (k,); else its own."""
    names = leg.joint_names
    lower, upper = range_of_each(
        leg.limits if limits is None else limits, len(names), joints=joints_of(leg)
    )
    for name, low, high in zip(names, lower, upper, strict=True):
        checked_limits((low, high), of=f"limits of {name}")
    return lower, upper


def joints_of(leg: Leg) -> str:
    """The joints of a leg, in words."""
    return f"leg's joints ({', '.join(leg.joint_names)})"
