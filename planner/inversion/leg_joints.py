"""What is said about every joint of a leg: its models and the limits of their requests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from planner.exceptions import InvalidInput
from planner.given import as_reals, shown
from planner.inversion.limits import checked_limits
from planner.model.joint import JointModel
from planner.trajectory import Array


def checked_leg(leg: object) -> Leg:
    """The leg, or InvalidInput where it is none."""
    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {shown(leg)}, expected a kinematics.Leg")
    return leg


def one_for_each(models: JointModel | Sequence[JointModel], leg: Leg) -> tuple[JointModel, ...]:
    """The models of the leg's joints; raise InvalidInput where they do not fit."""
    count = len(leg.joint_names)
    try:
        joints = (models,) * count if isinstance(models, JointModel) else tuple(models)
    except TypeError:
        joints = ()
    if len(joints) != count or not all(isinstance(model, JointModel) for model in joints):
        raise InvalidInput(
            f"models: got {len(joints)} of them, expected one JointModel, or one for each of the "
            f"leg's joints ({', '.join(leg.joint_names)})"
        )
    periods = sorted({model.period for model in joints})
    if len(periods) > 1:
        raise InvalidInput(
            f"models: their periods are {', '.join(f'{p:g}' for p in periods)} s, expected one "
            "period: the requests of a leg are sent together"
        )
    return joints


def each_limit(limits: tuple[npt.ArrayLike, npt.ArrayLike] | None, leg: Leg) -> tuple[Array, Array]:
    """Smallest and largest request of every joint [rad], each of shape (k,)."""
    names = leg.joint_names
    given = leg.limits if limits is None else limits
    try:
        lower, upper = (np.broadcast_to(as_reals(limit), len(names)) for limit in given)
    except (TypeError, ValueError):
        raise InvalidInput(
            f"limits: got {shown(limits)}, "
            "expected (lower, upper) [rad], each a number or one for each "
            f"of the leg's joints ({', '.join(names)})"
        ) from None
    for name, *pair in zip(names, lower, upper, strict=True):
        checked_limits((pair[0], pair[1]), of=f"limits of {name}")
    return lower.copy(), upper.copy()
