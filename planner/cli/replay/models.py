"""The models of a replay: from a file, or identified from the recordings themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from planner.cli import settings
from planner.cli.faults import BadSetting, Key
from planner.exceptions import InvalidInput, PlannerError, nearest
from planner.files.joint_model import ModelFile, read_model_file
from planner.files.logs.read import Recording
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.model.evidence import refusal, with_reasons
from planner.model.joint import JointModel
from planner.recording.recorded_path import is_gripper

MOST_IDENTIFIED = 10
"""Most recordings from which models are identified with ``--model from-log``: further ones of the
same robot add little information, and time grows with each."""


@dataclass(frozen=True, kw_only=True)
class JointModels:
    """The models of a replay.

    Attributes:
        by_joint: The models; the key "" holds the default model.
        words: Their origin.
        remarks: Remarks for the user.
    """

    by_joint: Mapping[str, JointModel]
    words: str = ""
    remarks: tuple[str, ...] = ()


def joint_models(
    model: settings.Model,
    replay: settings.Replay,
    recordings: Sequence[Recording],
    progress: Callable[[str], None],
) -> JointModels:
    """The models that the settings name, or models identified from the recordings.

    Raises:
        BadSetting: No model is named, or a joint that is not there.
        InvalidInput: The models cannot be read, or none can be identified.
    """
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
    return _of_file(read_model_file(model.file), replay, recordings)


def _of_file(
    file: ModelFile, replay: settings.Replay, recordings: Sequence[Recording]
) -> JointModels:
    """The models of a file, with a remark on rejected models among the used ones."""
    common = {} if file.common is None else {"": file.common}
    models = {**common, **file.by_joint}
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
    used = recordings[:MOST_IDENTIFIED]
    by_joint: dict[str, list[Log]] = {}
    for log in _readable(used):
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
        if not identification.accepted:
            refused[name] = identification.reason
            failure = InvalidInput(
                "no model of any joint fits the recording; identify the joints from better logs"
            )
            continue
        models[name] = identification.model
    if not models:
        raise failure
    if refused:
        of = "its model describes" if len(refused) == 1 else "their models describe"
        remarks.append(
            f"{with_reasons(refused)}: left at the recorded requests, {of} the recording too badly"
        )
    several = f"the first {len(used)} of {len(recordings)} recordings"
    words = "the recording" if len(recordings) == 1 else several
    if len(used) == len(recordings) > 1:
        words = f"the {len(recordings)} recordings"
    return JointModels(
        by_joint=models,
        words=f"models: identified from {words}",
        remarks=tuple(remarks),
    )


def _readable(recordings: Sequence[Recording]) -> Iterator[Log]:
    """The logs of the readable recordings; errors of unreadable ones are reported in planning.

    The error of a single recording is raised here.
    """
    for recording in recordings:
        try:
            yield from recording.read()
        except PlannerError:
            if len(recordings) == 1:
                raise
