"""From the tables ``[model]`` of a run file to the models of its joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from planner.cli.models import FROM_URDF, SHIPPED, load_models
from planner.exceptions import InvalidModel
from planner.files.joint_model import REQUIRED, ModelFile, read_models
from planner.files.schema import Settings
from planner.files.table import nearest
from planner.model.joint import JointModel

if TYPE_CHECKING:
    from kinematics import Leg

TABLES_OF_JOINTS = ("limits.joints", "start.joints", "model.joints")
"""Tables whose keys are names of joints."""


@dataclass(frozen=True)
class ModelsOfRun(ModelFile):
    """The models of a run.

    Attributes:
        settings: The run.
    """

    settings: Settings

    def for_joints(self, names: Sequence[str]) -> tuple[JointModel, ...]:
        """The model of each named joint; every table of a joint must be about one of them."""
        check_joints(self.settings, names)
        return super().for_joints(names)


def models_of_run(settings: Settings, beside: Callable[[str], str], leg: Leg | None) -> ModelFile:
    """The models that a run file names or holds.

    Args:
        settings: The run.
        beside: Where a file is that the run names.
        leg: The leg, whose description may tell how fast the joints are.

    Raises:
        InvalidFile: A model file is unusable, parameters describe no joint, or they contradict.
    """
    base = _for_all(settings, beside, leg)
    by_joint = dict(base.by_joint)
    for joint, table in settings["model.joints"].items():
        by_joint[joint] = _of_joint(settings, base, joint, table, beside)
    return ModelsOfRun(base.path, base.common, by_joint, settings)


def check_joints(settings: Settings, joints: Sequence[str]) -> None:
    """Make sure that tables of single joints are about joints of the path.

    Raises:
        InvalidFile: One is not.
    """
    for table in TABLES_OF_JOINTS:
        for joint in settings[table]:
            if joint not in joints:
                raise settings.fault(
                    f"{table}.{joint}",
                    f"no such joint in the path{nearest(joint, joints)}; joints: "
                    f"{', '.join(joints)}",
                )


def _for_all(settings: Settings, beside: Callable[[str], str], leg: Leg | None) -> ModelFile:
    path = settings.file.path
    if "model.parameters" not in settings.given:
        if settings["model.file"] == SHIPPED:
            return ModelFile(path, JointModel.ers210a(), {})
        if settings["model.file"] == FROM_URDF:
            joints = () if leg is None else leg.joint_names
            made = zip(joints, load_models(FROM_URDF, joints, leg), strict=True)
            return ModelFile(path, None, dict(made))
        return read_models(beside(settings["model.file"]))
    if "model.file" in settings.given:
        raise settings.fault(
            "model.parameters", "stands beside model.file, expected one of them; remove the other"
        )
    prefix = "model.parameters."
    given = {
        name.removeprefix(prefix): value
        for name, value in settings.values.items()
        if name.startswith(prefix) and value is not None
    }
    missing = [key for key in REQUIRED if key not in given]
    if missing:
        raise settings.fault(
            "model.parameters",
            f"no {', '.join(missing)}; expected {', '.join(REQUIRED)} in rad/s, rad, s, s",
        )
    return ModelFile(path, _made(settings, "model.parameters", JointModel, given), {})


def _of_joint(
    settings: Settings,
    base: ModelFile,
    joint: str,
    table: Mapping[str, Any],
    beside: Callable[[str], str],
) -> JointModel:
    name = f"model.joints.{joint}"
    given = {key: value for key, value in table.items() if value is not None}
    if "file" in given:
        others = [key for key in given if key != "file"]
        if others:
            raise settings.fault(
                name, f"file stands beside {', '.join(others)}, expected a file or parameters"
            )
        return read_models(beside(given["file"])).for_joints([joint])[0]
    (start,) = base.for_joints([joint])
    return _made(settings, name, partial(replace, start), given)


def _made(
    settings: Settings, name: str, make: Callable[..., JointModel], given: Mapping[str, Any]
) -> JointModel:
    try:
        return make(**given)
    except InvalidModel as error:
        raise settings.fault(name, str(error)) from error
