"""Arguments about a leg: the leg, limits of its joints, weights of the axes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from planner.exceptions import InvalidInput
from planner.planning.arguments import checked_limits, range_of_each
from planner.trajectory import Array
from planner.validation import shown


def checked_leg(leg: object) -> Leg:
    """The leg, or InvalidInput where it is none."""
    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {shown(leg)}, expected a kinematics.Leg")
    return leg


def axis_scales(weights: Array) -> Array:
    """Factors of the three axes, the heaviest 1: the root of each weight, shape (3,)."""
    scales: Array = np.sqrt(weights / np.max(weights))
    return scales


def foot_motion(leg: Leg, angles: Array, weights: Array) -> float:
    """How far a radian of a joint moves the foot [m/rad], rms over joints, axes and samples."""
    jacobians = leg.jacobians(angles) * axis_scales(weights)[:, np.newaxis]
    return float(np.sqrt(np.mean(jacobians**2)))


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
