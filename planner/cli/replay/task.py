"""From settings and a recording to its replay, and the answers about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.cli import settings
from planner.cli.console import BadSetting, Key
from planner.cli.desired import check_felt, load_of_masses
from planner.cli.models import find_leg, load_leg, model_words
from planner.cli.planning import off_by, search_options
from planner.files.joint_model import read_model_file
from planner.files.logs import Recording
from planner.files.logs.lerobot import find_dataset
from planner.identification.log import Log
from planner.model.evidence import refusal
from planner.model.joint import JointModel
from planner.recording.models import JointModels, first_logs, models_from
from planner.recording.recorded_path import (
    RecordedPath,
    check_length,
    is_gripper,
    recorded_path,
)
from planner.recording.replaying import Replay, replay_at
from planner.recording.retiming import Fastest, Measure, fastest_at
from planner.report.replay_page import LOG_UNITS
from planner.trajectory import Array, error_norm

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.planning.inversion import LoadOfPose

ROUNDING = 1e-9
"""Share of a tolerance by which rounding may miss it."""


@dataclass(frozen=True, kw_only=True)
class ReplayTask:
    """One recording to replay: a unit of work that can be sent to another process.

    A ``rate`` of None is that of the recording.
    """

    recording: Recording
    models: JointModels
    replay: settings.Replay
    run_settings: settings.Run = field(default_factory=settings.Run)
    rate: float | None = None

    def path(self) -> RecordedPath:
        """Read the recording."""
        logs = self.recording.read()
        chosen = self.replay
        path = recorded_path(
            logs,
            self.models.by_joint,
            track=chosen.track,
            joints=chosen.joints,
            begin=chosen.begin_s,
            end=chosen.end_s,
            rate=chosen.rate_hz or self.rate,
            limits=_limits(self.run_settings.limits, logs),
        )
        return replace(path, name=self.recording.name)

    def run(self, progress: Callable[[str], None] = lambda _: None) -> Replay:
        """Read the recording and plan its replay."""
        if self.replay.fastest:
            return self.fastest(progress).replay
        path, speed = _with_load(self.run_settings.plan, self.path(), self.arm()), self.replay.speed
        return replay_at(
            path, path.moments(speed), speed=speed, progress=progress, **self.options(path)
        )

    def fastest(self, progress: Callable[[str], None] = lambda _: None) -> Fastest:
        """Read the recording and find the fastest replay within the tolerance."""
        arm, tolerance = self.arm(), self.run_settings.tolerance
        path = _with_load(self.run_settings.plan, self.path(), arm)
        joints = None if tolerance.deg is None else math.radians(tolerance.deg)
        foot = None if tolerance.cm is None else 0.01 * tolerance.cm
        measure = Measure.of(path, joints, foot, arm)
        retime = self.replay.retime
        return fastest_at(path, measure, retime=retime, progress=progress, **self.options(path))

    def arm(self) -> Leg | None:
        """The leg or arm of the settings, with the recording's joint names."""
        leg = load_leg(find_leg(self.run_settings.leg, self.recording.folder))
        if leg is None:
            return None
        recorded_names = {name: joint for joint, name in self.replay.urdf_joints.items()}
        names = tuple(recorded_names.get(name, name) for name in leg.joint_names)
        return replace(leg, joint_names=names)

    def options(self, path: RecordedPath) -> dict[str, Any]:
        """Arguments of :func:`planner.plan` beside models, path and limits."""
        plan = self.run_settings.plan
        units = {each.name: LOG_UNITS[each.unit][1] for each in path.planned}
        solver = {"solver": plan.solver or "gauss-newton"}
        return search_options(plan, path.period, units=units) | solver


def tasks_of(
    run: settings.Run,
    replay: settings.Replay,
    recordings: Sequence[Recording],
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[ReplayTask, ...]:
    """A task for every recording."""
    _check_tolerance(run, replay)
    rate = None  # that of the recording
    if recordings[0].dataset:
        rate = find_dataset(recordings[0].file).rate
    elif len(recordings) > 1 and (logs := first_logs(recordings)):
        rate = 1.0 / float(np.median([log.period for log in logs]))
    if len(recordings) == 1:  # of several, recordings of unsuitable length are left out
        check_length(
            recordings[0].read(),
            speed=replay.speed,
            begin=replay.begin_s,
            end=replay.end_s,
            rate=replay.rate_hz or rate,
        )
    models = joint_models(run.model, replay, recordings, progress)
    folder = str(Path.cwd()) if len(recordings) > 1 else ""  # workers have another folder
    return tuple(
        ReplayTask(
            recording=replace(each, folder=folder),
            models=models,
            replay=replay,
            run_settings=run,
            rate=rate,
        )
        for each in recordings
    )


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
        return JointModels(by_joint={"": JointModel.ers210a()}, words=model_words(model))
    if model.file == settings.FROM_LOG:
        return models_from(recordings, replay.joints, progress)
    file = read_model_file(model.file)
    models = {**({} if file.common is None else {"": file.common}), **file.by_joint}
    recorded = [log.joint for log in first_logs(recordings)]
    used = replay.joints or [name for name in recorded if not is_gripper(name)] or recorded
    of_joints = {name: models.get(name, file.common) for name in used}
    words = refusal({name: each.evidence for name, each in of_joints.items() if each})
    return JointModels(
        by_joint=models, words=f"model: {file.path}", remarks=(words,) if words else ()
    )


def _with_load(plan: settings.Plan, path: RecordedPath, leg: Leg | None) -> RecordedPath:
    """A recording with the load of the settings, or by default the load in its logs.

    The leg's joints that are not planned are where they were recorded.
    """
    if plan.load is None:
        return path
    key, planned = Key("plan.load", plan.load), path.planned
    check_felt(key, [each.model for each in planned if each.model])
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
                key,
                f": the recording has no joint '{name}', which the leg has; joints: {joints}; "
                "name it with ",
                Key("replay.urdf_joints"),
            )
        if by_name[name].unit != "rad":
            raise BadSetting(
                key,
                f": {name} is in shares of its range, and a pose needs angles; choose its "
                "unit with --unit",
            )
    form, names = plan.load, [each.name for each in planned]

    def load_at(moments: Array) -> LoadOfPose:
        poses = [
            each.at(moments, each.angles if each.model is None else each.followed)
            for each in (by_name[name] for name in leg.joint_names)
        ]
        return load_of_masses(
            form, leg, names, np.column_stack(poses), period=path.period, cyclic=False
        )

    load_at(path.moments(1.0))  # refuses a URDF without masses before anything is planned
    return replace(path, load_at=load_at)


def missed(task: ReplayTask, replay: Replay) -> list[str]:
    """Messages about the tolerances that a replay misses, in the plan's norm."""
    tolerance, messages = task.run_settings.tolerance, []
    norm = "max" if task.replay.fastest else task.run_settings.plan.norm or "rms"
    if tolerance.deg is not None:
        for joint in replay.planned:
            unit, factor = LOG_UNITS[joint.path.unit]
            error = factor * error_norm(joint.errors["planned"], norm)
            if error > tolerance.deg * (1.0 + ROUNDING):
                messages.append(off_by(joint.name, error, unit, norm, tolerance.deg))
    if tolerance.cm is not None:
        measure = Measure.of(replay.path, None, 0.01 * tolerance.cm, task.arm())
        ratio = error_norm(measure.errors(replay, "planned"), norm)
        if ratio > 1.0 + ROUNDING:
            messages.append(off_by("the foot", ratio * tolerance.cm, "cm", norm, tolerance.cm))
    return messages


def _check_tolerance(run: settings.Run, replay: settings.Replay) -> None:
    """Refuse settings of the fastest replay that do not go together."""
    degrees, centimetres = Key("tolerance.deg"), Key("tolerance.cm")
    both = run.tolerance.deg is not None, run.tolerance.cm is not None
    if all(both):
        raise BadSetting(degrees, " and ", centimetres, ": expected one of them; leave one out")
    if run.tolerance.cm is not None and find_leg(run.leg) is None:
        raise BadSetting(centimetres, " is for a foot: name its leg or arm with ", Key("leg.urdf"))
    if replay.fastest and not any(both):
        raise BadSetting(Key("replay.fastest", True), " needs ", degrees, " or ", centimetres)
    if replay.retime != "constant" and not replay.fastest:
        key = Key("replay.retime", replay.retime)
        raise BadSetting(key, " has no effect without ", Key("replay.fastest", True))
    if replay.fastest and "speed" in replay.keys_set:
        raise BadSetting(Key("replay.speed"), " is what ", Key("replay.fastest", True), " finds")


def _limits(limits: settings.Limits, logs: Sequence[Log]) -> dict[str, tuple[float, float]] | None:
    """Limits by joint in the units of the logs: degrees, or percent of a range."""
    by_joint = {}
    for log in logs:
        span = limits.joints.get(log.joint, limits.deg)
        if span is not None:
            _, factor = LOG_UNITS[log.unit]
            by_joint[log.joint or "joint"] = (span[0] / factor, span[1] / factor)
    for name in limits.joints:
        if name not in {log.joint for log in logs}:
            by_joint[name] = (0.0, 0.0)  # refused with the joints that there are
    return by_joint or None
