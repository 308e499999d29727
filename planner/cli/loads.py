"""From settings to the torques on joints: by the columns of a path or log, or the leg's URDF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from planner.cli import settings
from planner.cli.faults import BadSetting, Key, Remark
from planner.trajectory import Array

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.cli.desired import Desired
    from planner.model.joint import JointModel
    from planner.planning.load_of_pose import LoadOfPose
    from planner.recording.recorded_path import RecordedPath

Load = Array | Callable[[Array], Array]
"""Torques [N m], shape (n, k), or a function of poses [rad], shape (n, k), that returns them."""


def load_of(plan: settings.Plan, desired: Desired) -> Load | None:
    """The torques on the joints of a path; None if the settings have no load.

    Of ``urdf-dynamics`` inertia counts along the desired path and gravity in the predicted pose:
    differences of a prediction would not settle.

    Raises:
        BadSetting: The path or the leg does not have the load, or no joint feels it.
        KinematicsError: The URDF has no masses.
    """
    if plan.load is None:
        return None
    key = Key("plan.load", plan.load)
    _check_felt(key, desired.models)
    if plan.load == "column":
        if desired.loads is None:
            raise BadSetting(key, ": the path has no columns <joint>_load_Nm")
        return desired.loads
    leg = desired.leg
    if leg is None or set(leg.joint_names) != set(desired.names):
        raise BadSetting(
            key, ": needs a path of all joints of a leg; name it with ", Key("leg.name")
        )
    poses = desired.angles[:, [desired.names.index(name) for name in leg.joint_names]]
    return _load_of_masses(
        plan.load, leg, desired.names, poses, period=desired.period, cyclic=desired.cyclic
    )


def with_load(plan: settings.Plan, path: RecordedPath, leg: Leg | None) -> RecordedPath:
    """A recording with the load of the settings, or by default the load in its logs.

    The leg's joints that are not planned are where they were recorded.

    Raises:
        BadSetting: The recording or the leg does not have the load, or no joint feels it.
    """
    if plan.load is None:
        return path
    key, planned = Key("plan.load", plan.load), path.planned
    _check_felt(key, [each.model for each in planned if each.model])
    if plan.load == "column":
        if not any(each.load is not None for each in planned):
            raise BadSetting(key, ": the recording has no torque of a joint that feels it")
        return path
    if leg is None:
        raise BadSetting(key, ": needs the leg or arm; name it with ", Key("leg.urdf"))
    by_name = {each.name: each for each in path.joints}
    for name in leg.joint_names:
        if name not in by_name:
            joints = ", ".join(by_name)
            raise BadSetting(
                key, f": the recording has no joint '{name}', which the leg has; joints: {joints}; "
                "name it with ", Key("replay.urdf_joints")
            )  # fmt: skip
        if by_name[name].unit != "rad":
            raise BadSetting(
                key, f": {name} is in shares of its range, and a pose needs angles; choose its "
                "unit with --unit"
            )  # fmt: skip
    form, names = plan.load, [each.name for each in planned]

    def load_at(moments: Array) -> LoadOfPose:
        poses = [
            each.at(moments, each.angles if each.model is None else each.followed)
            for each in (by_name[name] for name in leg.joint_names)
        ]
        return _load_of_masses(
            form, leg, names, np.column_stack(poses), period=path.period, cyclic=False
        )

    load_at(path.moments(1.0))  # refuses a URDF without masses before anything is planned
    return replace(path, load_at=load_at)


def _check_felt(key: Key, models: Sequence[JointModel]) -> None:
    if not any(model.feels_load for model in models):
        raise BadSetting(
            key,
            " has no effect: compliance and speed_per_torque of the models are 0; identify them "
            "from logs with a load, or leave the load out",
        )


def _load_of_masses(
    form: Literal["urdf", "urdf-dynamics"],
    leg: Leg,
    names: Sequence[str],
    poses: Array,
    *,
    period: float,
    cyclic: bool,
) -> Callable[[Array], Array]:
    """Torques on joints by their angles; the leg's other joints follow the desired poses.

    Args:
        form: Gravity alone, or inertia along the desired path, too.
        leg: The leg, whose masses count.
        names: The joints; joints outside the leg carry no load.
        poses: Desired angles of the leg's joints [rad], shape (n, m).
        period: Time between poses [s].
        cyclic: Whether they repeat.
    """
    inside = [j for j, name in enumerate(names) if name in leg.joint_names]
    places = [leg.joint_names.index(names[j]) for j in inside]
    gravity = leg.load_torques(poses)
    inertia = np.zeros_like(gravity)
    if form == "urdf-dynamics":
        inertia = leg.load_torques(poses, dynamics=True, period=period, cyclic=cyclic) - gravity

    def torques(angles: Array) -> Array:
        pose, loads = poses.copy(), np.zeros(angles.shape)
        pose[:, places] = angles[:, inside]
        loads[:, inside] = (leg.load_torques(pose) + inertia)[:, places]
        return loads

    return torques


def unused(plan: settings.Plan, desired: Desired) -> tuple[Remark, ...]:
    """A remark on a path whose load the settings do not use."""
    if desired.loads is None or plan.load is not None:
        return ()
    key = Key("plan.load", "column")
    return (Remark("the load in the path's columns is not used: ask for it with ", key),)
