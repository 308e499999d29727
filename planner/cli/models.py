"""From the option ``--model`` to one model per joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.files.joint_model import ModelFile
    from planner.model.joint import JointModel

SHIPPED = "ers210a"
"""The model that needs no file."""


def load_models(option: str | ModelFile, joints: Sequence[str]) -> tuple[JointModel, ...]:
    """One model per joint, shipped or from TOML, all with the same time between requests.

    Args:
        option: The option, or models that have been read already.
        joints: The joints.

    Raises:
        InvalidFile: The file is unusable, or its joints are requested at different rates.
    """
    from planner.exceptions import InvalidFile
    from planner.files.joint_model import read_models
    from planner.model.joint import JointModel

    if option == SHIPPED:
        return (JointModel.ers210a(),) * len(joints)
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
