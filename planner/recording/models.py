"""The models of the joints of recordings: given, or identified from the recordings themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from planner.exceptions import InvalidInput, PlannerError, nearest
from planner.files.logs import Recording
from planner.identification.log import Log
from planner.model.evidence import with_reasons
from planner.model.joint import JointModel
from planner.recording.recorded_path import is_gripper


@dataclass(frozen=True, kw_only=True)
class JointModels:
    """The models of a replay, the default under the key ""; their origin in words, and remarks."""

    by_joint: Mapping[str, JointModel]
    words: str = ""
    remarks: tuple[str, ...] = ()


def first_logs(recordings: Sequence[Recording]) -> Sequence[Log]:
    """The logs of the first recording that can be read."""
    for recording in recordings:
        with suppress(PlannerError):  # reported when it is planned
            return recording.read()
    return []


def models_from(
    recordings: Sequence[Recording], joints: Sequence[str], progress: Callable[[str], None]
) -> JointModels:
    """Models of these joints, or of all but grippers, identified from the recordings themselves.

    Raises:
        InvalidInput: No recording of a joint, or no model fits it.
    """
    from planner.identification.identify import identify  # slow to import

    used = recordings[:10]  # more of the same robot add little, and time grows with each
    by_joint: dict[str, list[Log]] = {}
    failure: PlannerError = InvalidInput("no recording could be read")
    for recording in used:
        try:
            for log in recording.read():
                by_joint.setdefault(log.joint or "joint", []).append(log)
        except PlannerError as error:  # where others are read it is reported in its plan
            failure = error
    if not by_joint:
        raise failure
    for name in joints:
        if name not in by_joint:
            raise InvalidInput(
                f"joints: no joint '{name}'{nearest(name, list(by_joint))}; joints: "
                + ", ".join(by_joint)
            )
    chosen = joints or [name for name in by_joint if not is_gripper(name)] or list(by_joint)
    models: dict[str, JointModel] = {}
    remarks: list[str] = []
    refused: dict[str, str] = {}
    for name in chosen:
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
