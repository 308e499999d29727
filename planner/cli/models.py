"""From the option ``--model`` to one model per joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.files.joint_model import ModelFile
    from planner.model.joint import JointModel

SHIPPED = "ers210a"
"""The model that needs no file."""


FROM_URDF = "urdf"
"""The models that stand in for servos of which no more than the top speed is known."""


def load_models(
    option: str | ModelFile, joints: Sequence[str], leg: Leg | None = None
) -> tuple[JointModel, ...]:
    """One model per joint, shipped or from TOML, all with the same time between requests.

    Args:
        option: The option, or models that have been read already.
        joints: The joints.
        leg: The leg that they are on, whose URDF may tell how fast they are.

    Raises:
        click.UsageError: The leg's URDF should tell how fast they are, and does not.
        InvalidFile: The file is unusable, or its joints are requested at different rates.
    """
    from planner.exceptions import InvalidFile
    from planner.files.joint_model import read_models
    from planner.model.joint import JointModel

    if option == SHIPPED:
        return (JointModel.ers210a(),) * len(joints)
    if option == FROM_URDF:
        return _assumed_joints(joints, leg)
    file = read_models(option) if isinstance(option, str) else option
    models = file.for_joints(joints)
    for name, model in zip(joints, models, strict=True):
        if abs(model.period - models[0].period) > 1e-9 * models[0].period:
            raise InvalidFile(
                file.path,
                f"'{name}' takes a request every {model.period:g} s and '{joints[0]}' every "
                f"{models[0].period:g} s, expected one rate; plan them one by one with --joint",
            )
    return models


def _assumed_joints(joints: Sequence[str], leg: Leg | None) -> tuple[JointModel, ...]:
    import math

    from planner.model.joint import joint_of_top_speed

    if leg is None or leg.speeds is None:
        raise click.UsageError("--model urdf takes speeds from a leg's URDF: name it with --leg.")
    speeds = dict(zip(leg.joint_names, leg.speeds.tolist(), strict=True))
    for joint in joints:
        if math.isnan(speeds.get(joint, math.nan)):
            raise click.UsageError(
                f"--model urdf: the URDF has no top speed of joint '{joint}' that can be meant; "
                "give a model file, as `identify` writes it."
            )
    return tuple(joint_of_top_speed(speeds[joint]) for joint in joints)
