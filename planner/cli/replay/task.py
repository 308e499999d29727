"""From settings and a recording to its replay, and the answers about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.cli import settings
from planner.cli.console import BadSetting, Key
from planner.cli.desired import find_leg, load_leg
from planner.cli.models import JointModels, first_logs, joint_models
from planner.cli.planning import errors_document, off_by, search_options, with_load
from planner.files.logs.lerobot import find_dataset
from planner.files.logs.read import Recording
from planner.identification.grid import measured_speed
from planner.identification.log import Log
from planner.model.evidence import OPEN_TOP_SPEED
from planner.recording.recorded_path import WHY, RecordedPath, check_length, recorded_path
from planner.recording.replaying import Replay, replay_at
from planner.recording.retiming import Fastest, Measure, fastest_at
from planner.report.replay import LOG_UNITS, joints_table, requests_table
from planner.trajectory import error_norm

if TYPE_CHECKING:
    from kinematics import Leg


ROUNDING = 1e-9
"""Share of a tolerance by which rounding may miss it."""

RESENT = (
    "the recorded requests may serve better than the plan, as they have moved the robot along this "
    "path: the error to expect of the plan is not clearly smaller than that of the requests as "
    "recorded"
)
"""A remark on replays at the recorded speed."""


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
        path, speed = with_load(self.run_settings.plan, self.path(), self.arm()), self.replay.speed
        return replay_at(
            path, path.moments(speed), speed=speed, progress=progress, **self.options(path)
        )

    def fastest(self, progress: Callable[[str], None] = lambda _: None) -> Fastest:
        """Read the recording and find the fastest replay within the tolerance."""
        arm, tolerance = self.arm(), self.run_settings.tolerance
        path = with_load(self.run_settings.plan, self.path(), arm)
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
        rate = find_dataset(recordings[0].place.file).rate
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


def first_line(replay: Replay, models: JointModels) -> str:
    """One line about the replay: track, requests, speed and models."""
    path = replay.path
    count, seconds = len(replay.moments), (len(replay.moments) - 1) * replay.period
    load = "; loaded by the masses of the URDF" if path.load_at else ""
    return (
        f"follows {WHY[path.track]}; {count} requests at {1.0 / replay.period:.4g} Hz, "
        f"{seconds:.4g} s for {path.duration:.4g} s at {replay.speed:.3g} times the speed; "
        f"{models.words}{load}"
    )


def summary(replay: Replay, models: JointModels, fastest: Fastest | None = None) -> str:
    """A replay for people: each joint's errors, rms, and how its requests move."""
    lines = [first_line(replay, models)]
    if fastest is not None:
        lines.append(fastest_text(fastest))
    lines.append(replace(joints_table(replay), about="rms [deg]").text())
    lines += ["", requests_table(replay).text()]
    fast = {each.name for each in replay.planned if each.too_fast}
    if unknown := sorted(replay.path.open_top_speeds & fast):
        lines.append(f"faster by the model only of {', '.join(unknown)}: {OPEN_TOP_SPEED}")
    if refuted := refuted_joints(replay):
        lines.append(
            f"the recording contradicts the model of {', '.join(refuted)}: it moved faster than "
            "the top speed of the model; identify it from this recording too"
        )
    if words := resent_words(replay):
        lines.append(words)
    if fastest is None and (untested := replay.untested):
        lines.append(f"outside what the models were tested on: {untested}")
    return "\n".join(lines)


def resent_words(replay: Replay) -> str:
    """A remark on joints whose recorded requests may be better than the plan; "" if none."""
    errors = []
    for each in replay.resent_may_serve:
        unit, factor = LOG_UNITS[each.path.unit]
        resent = factor * error_norm(each.error_of("resent"), "rms")
        errors.append(f"{each.name} ({factor * each.expected:.3f} and {resent:.3f} {unit} rms)")
    if not errors:
        return ""
    return f"{RESENT}, {', '.join(errors)}"


def refuted_joints(replay: Replay) -> list[str]:
    """The joints that moved faster in the replayed part of the recording than their models can."""
    names = []
    for each in replay.planned:
        assert each.path.model is not None, "planned joints have models"
        inside = (each.path.times >= replay.path.first) & (each.path.times <= replay.path.last)
        part = replace(each.path.log, torque_on=each.path.log.torque_on & inside)
        limits = each.path.model.speed_limits(0.0, part.angles)
        # by a load a joint may exceed the top speed of its model a little
        if measured_speed(part) > 1.05 * max(np.max(np.abs(limit)) for limit in limits):
            names.append(each.name)
    return names


def document(replay: Replay, models: JointModels) -> dict[str, Any]:
    """A replay for machines, in degrees or percent; missing values are null."""
    joints = {}
    for joint in replay.joints:
        unit, factor = LOG_UNITS[joint.path.unit]
        plan = joint.inversion
        entry: dict[str, Any] = {
            "planned": plan is not None,
            "reason": joint.path.reason or None,
            "unit": unit,
            "recorded": errors_document(joint.recorded_errors, unit, factor),
            f"requests_{unit}": (factor * joint.requests).tolist(),
        }
        if plan is not None:
            assert joint.predicted is not None, "a planned joint is simulated"
            entry |= {
                **{
                    kind: errors_document(each, unit, factor) for kind, each in joint.errors.items()
                },
                "best_shift_s": joint.lead,
                f"expected_on_robot_rms_{unit}": factor * joint.expected,
                "norm": plan.norm,
                f"lower_bound_{unit}": factor * joint.lower_bound,
                f"largest_step_{unit}": factor * plan.largest_step,
                "recorded_requests_may_serve": joint in replay.resent_may_serve,
                "untested": list(joint.untested),
                "top_speed_known": joint.name not in replay.path.open_top_speeds,
                "faster_than_the_joint_s": [list(span) for span in joint.too_fast],
                f"desired_{unit}": (factor * joint.desired).tolist(),
                f"predicted_{unit}": (factor * joint.predicted).tolist(),
            }
        joints[joint.name] = entry
    return {
        "recording": replay.path.name,
        "track": replay.path.track,
        "why": WHY[replay.path.track],
        "models": models.words,
        "speed": replay.speed,
        "period_s": replay.period,
        "requests": len(replay.moments),
        "recorded_s": replay.path.duration,
        "joints": joints,
        "remarks": [*replay.path.remarks, *models.remarks],
    }


def fastest_text(fastest: Fastest) -> str:
    """The largest speed of the recording, and the proof that no much larger one is possible."""
    factor = 100.0 if fastest.foot else math.degrees(1.0)
    allowed = factor * fastest.tolerance
    size = f"{allowed:.3g} cm"
    if not fastest.foot:
        size = f"{allowed:.3g} degree{'s' * (f'{allowed:.3g}' != '1')}"
    speed = f"{fastest.speed:.3g} times the speed"
    if fastest.retime == "varying":
        low, high = float(np.min(fastest.factors)), float(np.max(fastest.factors))
        speed += f" in all, {low:.3g} to {high:.3g} along it ({fastest.constant:.3g} constant)"
    words = f"within {size} (largest error {fastest.largest * allowed:.3g}) at {speed}"
    if untested := fastest.replay.untested:
        words += f" by the models, but outside what these were tested on: {untested}"
    if fastest.contradicted:
        names = ", ".join(fastest.contradicted)
        plural = "models" if len(fastest.contradicted) > 1 else "model"
        return (
            f"{words}; the recording contradicts the {plural} of {names}: at its own speed, from "
            f"rest, no requests would keep {names} within {size}, but the robot did it: no "
            "limit on the speed is known; identify from this recording too, or begin where it rests"
        )
    if fastest.impossible is None:
        proof = (
            "there is no lower bound for a foot" if fastest.foot else "no speed is proved too high"
        )
        return f"{words}; {proof}"
    proof = f"at {fastest.impossible.speed:.3g} times the speed no requests keep "
    proof += f"{fastest.impossible.joint} within {size}"
    if fastest.impossible.of_model_only:
        proof += f", which holds for its model only: {OPEN_TOP_SPEED}"
    return f"{words}; {proof}"


def fastest_document(fastest: Fastest) -> dict[str, Any]:
    """The fastest replay for machines; errors over speed are the largest, times the tolerance."""
    factor = 100.0 if fastest.foot else math.degrees(1.0)
    unit = "cm" if fastest.foot else "deg"
    allowed = factor * fastest.tolerance
    impossible = fastest.impossible and {
        "speed": fastest.impossible.speed,
        "joint": fastest.impossible.joint,
        f"lower_bound_{unit}": allowed * fastest.impossible.bound,
        "of_model_only": fastest.impossible.of_model_only,
    }
    curve = [
        {
            "speed": each.speed,
            **{
                f"{kind}_max_{unit}": allowed * ratio
                for kind, ratio in zip(each._fields[1:], each[1:], strict=True)
            },
        }
        for each in fastest.curve
    ]
    return {
        f"tolerance_{unit}": allowed,
        "retime": fastest.retime,
        "speed": fastest.speed,
        "constant_speed": fastest.constant,
        "least_factor": float(np.min(fastest.factors)),
        "largest_factor": float(np.max(fastest.factors)),
        f"largest_error_{unit}": allowed * fastest.largest,
        "impossible": impossible,
        "contradicted": list(fastest.contradicted),
        "errors_by_speed": curve,
    }


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


def replay_report(
    task: ReplayTask, replay: Replay, fastest: Fastest | None, page: str, output: str
) -> str:
    """The page about a replay, to be written to ``page``, with links to its files."""
    from planner.report.page import sentence, sources_of
    from planner.report.replay import replay_page

    arm = task.arm()
    if arm is not None and not set(arm.joint_names) <= set(replay.names):
        arm = None
    origins = [("recording", task.recording.name), ("track", replay.path.track)]
    named = [("recording", task.recording.path), ("requests", output)]
    return replay_page(
        replay,
        title=PurePath(task.recording.name).name,
        words=first_line(replay, task.models),
        fastest=fastest,
        verdict="" if fastest is None else fastest_text(fastest),
        arm=arm,
        missed=missed(task, replay),
        remarks=[*map(sentence, filter(None, [resent_words(replay)])), *task.models.remarks],
        sources=sources_of(page, origins, named),
    )


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
