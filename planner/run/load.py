"""From settings to the torques on the joints of a path: by its columns or the leg's URDF."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from planner.run.faults import BadSetting, Key, Remark
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.run import settings
    from planner.run.desired import Desired

Load = Array | Callable[[Array], Array]
"""Torques [N m], shape (n, k), or those in poses [rad], shape (n, k)."""


def load_of(given: settings.Plan, desired: Desired) -> Load | None:
    """What the joints of a path carry; None where the settings ask for no load.

    Of ``urdf-dynamics`` inertia counts along the desired path and gravity in the predicted pose:
    differences of a prediction would not settle.

    Raises:
        BadSetting: The path or the leg does not tell, or no joint feels it.
        KinematicsError: The URDF has no masses.
    """
    if given.load is None:
        return None
    key = Key("plan.load", given.load)
    if not any(model.feels_load for model in desired.models):
        raise BadSetting(
            key,
            " has no effect: compliance and speed_per_torque of the models are 0; identify them "
            "from logs with a load, or leave the load out",
        )
    if given.load == "column":
        if desired.loads is None:
            raise BadSetting(key, ": the path has no columns <joint>_load_Nm")
        return desired.loads
    leg = desired.leg
    if leg is None or set(leg.joint_names) != set(desired.names):
        raise BadSetting(
            key, ": needs a path of all joints of a leg; name it with ", Key("leg.name")
        )
    to_leg = [desired.names.index(name) for name in leg.joint_names]
    to_path = np.argsort(to_leg)

    def gravity(angles: Array) -> Array:
        torques: Array = leg.load_torques(angles[:, to_leg])[:, to_path]
        return torques

    in_rest = gravity(desired.angles)  # refuses a URDF without masses before anything is planned
    if given.load == "urdf":
        return gravity
    moving = leg.load_torques(
        desired.angles[:, to_leg], dynamics=True, period=desired.period, cyclic=desired.cyclic
    )
    inertia = moving[:, to_path] - in_rest
    return lambda angles: gravity(angles) + inertia


def unused(given: settings.Plan, desired: Desired) -> tuple[Remark, ...]:
    """What to say of a path whose load is not asked for."""
    if desired.loads is None or given.load is not None:
        return ()
    asked = Key("plan.load", "column")
    return (Remark("the load in the path's columns is not used: ask for it with ", asked),)
