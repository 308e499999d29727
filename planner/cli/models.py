"""From settings to one model per joint of a path, or of recordings, which may bring their own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from planner.cli import settings
from planner.cli.console import BadSetting, Key
from planner.exceptions import InvalidFile, InvalidInput, PlannerError, nearest
from planner.files.joint_model import read_model_file
from planner.model.evidence import refusal, with_reasons
from planner.model.joint import JointModel, joint_of_top_speed

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.files.logs.read import Recording
    from planner.identification.log import Log


def models_of(
    model: settings.Model,
    joints: Sequence[str],
    leg: Leg | None = None,
    folder: str = "",
    *,
    rate_hz: float | None = None,
) -> tuple[JointModel, ...]:
    """One model per joint, all with the same time between requests, by default the models' own."""
    models = _by_settings(model, joints, leg, folder)
    if rate_hz is not None:
        return tuple(each.requested_every(1.0 / rate_hz) for each in models)
    for name, each in zip(joints, models, strict=True):
        if abs(each.period - models[0].period) > 1e-9 * models[0].period:
            raise InvalidFile(
                beside(folder, model.file),
                f"'{name}' takes a request every {each.period:g} s and '{joints[0]}' every "
                f"{models[0].period:g} s, expected one rate; plan them one by one",
            )
    return models


def verdict_document(model: JointModel) -> dict[str, str]:
    """The verdict on a model and its reason, for machines; empty if unknown."""
    evidence = model.evidence
    if evidence is None or evidence.verdict is None:
        return {}
    return {"verdict": evidence.verdict, "verdict_reason": evidence.reason}


def model_words(model: settings.Model) -> str:
    """The joint model of an answer, in words."""
    words = {
        settings.SHIPPED_MODEL: f"{settings.SHIPPED_MODEL}, a joint of the Sony Aibo",
        settings.FROM_URDF: "a joint of the Sony Aibo, with the top speeds of the URDF",
    }
    return f"model: {words.get(model.file, model.file)}"


def beside(folder: str, name: str) -> str:
    """The path of a file that the settings name relative to their own folder."""
    return str(Path(folder) / name) if folder else name


def check_joints(key: str, by_joint: Mapping[str, object], joints: Sequence[str]) -> None:
    """Make sure that settings of single joints are about joints of the path."""
    for joint in by_joint:
        if joint not in joints:
            raise BadSetting(
                Key(key, joint=joint),
                f": no such joint in the path{nearest(joint, joints)}; joints: {', '.join(joints)}",
            )


def _by_settings(
    model: settings.Model, joints: Sequence[str], leg: Leg | None, folder: str
) -> tuple[JointModel, ...]:
    if model.file == settings.SHIPPED_MODEL:
        return (JointModel.ers210a(),) * len(joints)
    if model.file != settings.FROM_URDF:
        file = beside(folder, model.file)
        if not Path(file).suffix and not Path(file).exists():
            raise BadSetting(
                Key("model.file"),
                f": got '{model.file}', expected '{settings.SHIPPED_MODEL}', "
                f"'{settings.FROM_URDF}', or a file that exists, such as joint.toml",
            )
        return read_model_file(file).for_joints(joints)
    if leg is None or leg.speeds is None:
        raise BadSetting(
            Key("model.file", settings.FROM_URDF),
            " takes speeds from a leg's URDF: name it with ",
            Key("leg.name"),
        )
    speeds = dict(zip(leg.joint_names, leg.speeds.tolist(), strict=True))
    for joint in joints:
        if math.isnan(speeds.get(joint, math.nan)):
            raise BadSetting(
                Key("model.file", settings.FROM_URDF),
                f": the URDF has no usable top speed of joint '{joint}'; give a model file, as "
                "`identify` writes it",
            )
    return tuple(joint_of_top_speed(speeds[joint]) for joint in joints)


@dataclass(frozen=True, kw_only=True)
class JointModels:
    """The models of a replay, the default under the key ""; their origin in words, and remarks."""

    by_joint: Mapping[str, JointModel]
    words: str = ""
    remarks: tuple[str, ...] = ()


def joint_models(
    model: settings.Model,
    replay: settings.Replay,
    recordings: Sequence[Recording],
    progress: Callable[[str], None],
) -> JointModels:
    """The models that the settings name, or models identified from the recordings."""
    key = Key("model.file")
    if model.file == settings.SHIPPED_MODEL and "file" not in model.keys_set:
        raise BadSetting(
            key,
            " is missing: name a file that `identify` wrote, or identify the joints from the "
            "recording itself with ",
            Key("model.file", settings.FROM_LOG),
        )
    if model.file == settings.FROM_URDF:
        raise BadSetting(Key("model.file", settings.FROM_URDF), " has no effect on a replay")
    if model.file == settings.SHIPPED_MODEL:
        words = f"model: {settings.SHIPPED_MODEL}, a joint of the Sony Aibo"
        return JointModels(by_joint={"": JointModel.ers210a()}, words=words)
    if model.file == settings.FROM_LOG:
        return _models_from_recordings(replay, recordings, progress)
    from planner.recording.recorded_path import is_gripper

    file = read_model_file(model.file)
    models = {**({} if file.common is None else {"": file.common}), **file.by_joint}
    recorded = [log.joint for log in first_logs(recordings)]
    used = replay.joints or [name for name in recorded if not is_gripper(name)] or recorded
    of_joints = {name: models.get(name, file.common) for name in used}
    words = refusal({name: each.evidence for name, each in of_joints.items() if each})
    return JointModels(
        by_joint=models, words=f"model: {file.path}", remarks=(words,) if words else ()
    )


def first_logs(recordings: Sequence[Recording]) -> Sequence[Log]:
    """The logs of the first recording that can be read."""
    for recording in recordings:
        with suppress(PlannerError):  # reported when it is planned
            return recording.read()
    return []


def _models_from_recordings(
    replay: settings.Replay, recordings: Sequence[Recording], progress: Callable[[str], None]
) -> JointModels:
    from planner.identification.identify import identify
    from planner.recording.recorded_path import is_gripper

    used = recordings[:10]  # more of the same robot add little, and time grows with each
    by_joint: dict[str, list[Log]] = {}
    for recording in used:
        # With several, an error is reported when the recording is planned.
        with suppress(PlannerError) if len(recordings) > 1 else nullcontext():
            for log in recording.read():
                by_joint.setdefault(log.joint or "joint", []).append(log)
    for name in replay.joints:
        if by_joint and name not in by_joint:
            raise BadSetting(
                Key("replay.joints"),
                f": no joint '{name}'{nearest(name, list(by_joint))}; joints: "
                + ", ".join(by_joint),
            )
    joints = [name for name in by_joint if not is_gripper(name)] or list(by_joint)
    models: dict[str, JointModel] = {}
    remarks: list[str] = []
    refused: dict[str, str] = {}
    failure: PlannerError = InvalidInput("no recording could be read")
    for name in replay.joints or joints:
        if name not in by_joint:
            continue
        progress(f"identifying {name}")
        try:
            identification = identify(by_joint[name])
        except PlannerError as error:
            remarks.append(f"{name}: no model: {error}")
            failure = error
            continue
        if identification.accepted:
            models[name] = identification.model
        else:
            refused[name] = identification.reason
            words = "no model of any joint fits the recording; identify the joints from better logs"
            failure = InvalidInput(words)
    if not models:
        raise failure
    if refused:
        of = "its model describes" if len(refused) == 1 else "their models describe"
        remarks.append(
            f"{with_reasons(refused)}: left at the recorded requests, {of} the recording too badly"
        )
    words = "the recording"
    if len(recordings) > 1:
        first = f"first {len(used)} of " if len(used) < len(recordings) else ""
        words = f"the {first}{len(recordings)} recordings"
    return JointModels(
        by_joint=models,
        words=f"models: identified from {words}",
        remarks=tuple(remarks),
    )
