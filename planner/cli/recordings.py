"""Replays of recordings by settings: one, or many as one dataset, resumable."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from planner.arrays import Array, error_norm
from planner.cli import desired as loading
from planner.cli import settings
from planner.cli.console import BadSetting, marked
from planner.cli.export import FOLDERS, check_place, exported
from planner.cli.planning import search_options
from planner.exceptions import PlannerError
from planner.files.exports import Schedule, check_installed, lerobot_dataset
from planner.files.joint_model import read_model_file
from planner.files.logs import Recording
from planner.files.logs.lerobot import ACTION, find_dataset
from planner.files.results import Results, Task, digest_of, made_from
from planner.files.staging import check_writable, claimed
from planner.files.text import to_json
from planner.model.evidence import refusal
from planner.model.joint import JointModel
from planner.parallel import carry_out
from planner.recording import episode, recorded_path
from planner.recording.recorded_path import JointModels, RecordedPath
from planner.recording.replaying import Replay, replay_at
from planner.recording.retiming import Fastest, Search
from planner.report.plan_results import off_by
from planner.report.replay_page import episode_results, findings_of_many, told
from planner.report.wording import UNITS

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.identification.log import Log
    from planner.planning.task import LoadOfPose


@dataclass(frozen=True, kw_only=True)
class ReplayTask:
    """One recording to replay: a unit of work that can be sent to another process."""

    recording: Recording
    models: JointModels
    settings: settings.ReplayRun
    rate: float | None = None  # None for that of the recording

    def run(
        self, progress: Callable[[str], None] = lambda _: None
    ) -> tuple[Replay, Fastest | None]:
        """Read the recording and plan its replay, if asked for the fastest within the tolerance."""
        run, replay, speed = self.settings, self.settings.replay, self.settings.path.speed or 1.0
        logs, limits = self.recording.read(), {}
        self.check_arm(logs)
        factors = {log.joint or "joint": UNITS[log.unit].factor for log in logs}
        for name, span in loading.values_by_joint("limits", run.limits, [*factors]).items():
            limits[name] = span[0] / factors[name], span[1] / factors[name]
        path = recorded_path.recorded_path(
            logs,
            self.models.by_joint,
            track=replay.track,
            joints=run.path.joints,
            begin=replay.begin_s,
            end=replay.end_s,
            rate=run.path.rate_hz or self.rate,
            limits=limits or None,
        )
        path = _with_load(run.plan, replace(path, name=self.recording.name), self.arm)
        units = {each.name: UNITS[each.unit].factor for each in path.planned}
        options = search_options(run.plan, path.period, units)
        options |= {"solver": run.plan.solver, "progress": progress}
        if not replay.fastest:
            return replay_at(path, path.moments(speed), speed=speed, **options), None
        fastest = self.search(path, **options).fastest(replay.retime)
        return fastest.replay, fastest

    def search(self, path: RecordedPath, **options: Any) -> Search:
        """The search for the fastest replay within the tolerance that the settings have."""
        degrees, centimetres = self.settings.tolerance.deg, self.settings.tolerance.cm
        joints = None if degrees is None else math.radians(degrees)
        foot = None if centimetres is None else 0.01 * centimetres
        return Search(path, joints, foot, self.arm, **options)

    @cached_property
    def arm(self) -> Leg | None:
        """The leg or arm of the settings, with the recording's joint names."""
        if (leg := loading.leg_of(self.settings)) is None:
            return None
        recorded_names = {name: joint for joint, name in self.settings.replay.urdf_joints.items()}
        names = tuple(recorded_names.get(name, name) for name in leg.joint_names)
        return replace(leg, joint_names=names)

    def check_arm(self, logs: Sequence[Log]) -> None:
        """Refuse a leg with joints that the logs have no angles of, and names of other joints."""
        renamed, known = self.settings.replay.urdf_joints, self.arm.joint_names if self.arm else ()
        if unknown := [of_leg for name, of_leg in renamed.items() if name not in known]:
            expected = (
                f"expected one of {', '.join(known)}"
                if known
                else "but no leg; give the leg with ‹leg.name›"
            )
            raise BadSetting(f"‹replay.urdf_joints›: got joint '{unknown[0]}', {expected}")
        angles = [log.joint or "joint" for log in logs if log.unit == "rad"]
        if missing := [name for name in known if name not in angles]:
            words = f"the recording has no angles of '{missing[0]}', which the leg has"
            advice = "name it with ‹replay.urdf_joints›, or choose its unit with --unit"
            raise BadSetting(f"‹leg.name›: {words}; angles: {', '.join(angles)}; {advice}")


def tasks_of(
    run: settings.ReplayRun,
    recordings: Sequence[Recording],
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[ReplayTask, ...]:
    """A task for every recording."""
    replay, tolerance, fastest = run.replay, run.tolerance, "‹replay.fastest = true›"
    if tolerance.deg is not None and tolerance.cm is not None:
        raise BadSetting("‹tolerance.deg› and ‹tolerance.cm›: expected one of them; leave one out")
    if tolerance.cm is not None and loading.find_leg(run) is None:
        raise BadSetting("‹tolerance.cm› is for a foot: name its leg or arm with ‹leg.name›")
    if replay.fastest and tolerance.deg is None and tolerance.cm is None:
        raise BadSetting(f"{fastest} needs ‹tolerance.deg› or ‹tolerance.cm›")
    if replay.retime != "constant" and not replay.fastest:
        key = marked("replay.retime", replay.retime)
        raise BadSetting(f"{key} has no effect without {fastest}")
    if replay.fastest and run.path.speed is not None:
        raise BadSetting(f"‹path.speed› is what {fastest} finds")
    rate, folder, logs = None, "", next(recorded_path.readable_logs(recordings), ())
    if recordings[0].is_episode:
        rate = find_dataset(recordings[0].file).rate
    elif len(recordings) > 1 and logs:
        rate = 1.0 / float(np.median([log.period for log in logs]))
    if len(recordings) > 1:
        run.folder = folder = str(Path.cwd())  # workers have another one
    none = JointModels(by_joint={})
    task = ReplayTask(recording=recordings[0], models=none, settings=run, rate=rate)
    if logs:  # else the fault is reported where it is planned
        task.check_arm(logs)
    models = _models_of(run, recordings, logs, progress)
    recordings = [replace(each, folder=folder) for each in recordings]
    return tuple(replace(task, recording=each, models=models) for each in recordings)


def _models_of(
    run: settings.ReplayRun,
    recordings: Sequence[Recording],
    logs: Sequence[Log],
    progress: Callable[[str], None],
) -> JointModels:
    """The models that the settings name, or models identified from the recordings."""
    model, joints = run.model, run.path.joints
    if model.file == settings.SHIPPED_MODEL:
        if "file" not in model.keys_set:
            raise BadSetting(
                "‹model.file› is missing: name a file that `identify` wrote, or identify the "
                f"joints from the recording itself with {marked('model.file', settings.FROM_LOG)}"
            )
        return JointModels(by_joint={"": JointModel.ers210a()}, words=loading.model_words(model))
    if model.file == settings.FROM_URDF:
        raise BadSetting(f"{marked('model.file', model.file)} has no effect on a replay")
    if model.file == settings.FROM_LOG:
        return recorded_path.models_from(recordings, joints, progress)
    file = read_model_file(model.file)
    used = joints or recorded_path.without_grippers(log.joint for log in logs)
    models = {name: file.models.get(name, file.models.get("")) for name in used}
    words = refusal({name: each.evidence for name, each in models.items() if each})
    remarks = (words,) if words else ()
    return JointModels(by_joint=file.models, words=f"model: {file.path}", remarks=remarks)


def _with_load(plan: settings.Plan, path: RecordedPath, leg: Leg | None) -> RecordedPath:
    """A recording with the load of the settings, or by default the load in its logs.

    The leg's joints that are not planned are where they were recorded.
    """
    if plan.load is None:
        return path
    key, planned = marked("plan.load", plan.load), path.planned
    loading.check_felt(key, [each.model for each in planned if each.model])
    if plan.load == "column":
        if not any(each.load is not None for each in planned):
            raise BadSetting(f"{key}: the recording has no torque of a joint that feels it")
        return path
    if leg is None:
        raise BadSetting(f"{key}: needs the leg or arm; name it with ‹leg.name›")
    by_name = {each.name: each for each in path.joints}
    names = [each.name for each in planned]

    def load_at(moments: Array) -> LoadOfPose:
        poses = [
            each.at(moments, each.angles if each.model is None else each.followed)
            for each in (by_name[name] for name in leg.joint_names)
        ]
        return leg.load_of_pose(
            names,
            np.column_stack(poses),
            dynamics=plan.load == "urdf-dynamics",
            period=path.period,
            cyclic=False,
        )

    load_at(path.moments(1.0))  # refuses a URDF without masses before anything is planned
    return replace(path, load_at=load_at)


def missed(task: ReplayTask, replay: Replay) -> list[str]:
    """Messages about the tolerances that a replay misses, in the plan's norm."""
    tolerance = task.settings.tolerance
    norm = "max" if task.settings.replay.fastest else task.settings.plan.norm
    errors: list[tuple[str, float, str, float]] = []  # of what, how large, in which unit, allowed
    if tolerance.deg is not None:
        for joint in replay.planned:
            unit = UNITS[joint.path.unit]
            error = unit.factor * error_norm(joint.errors["planned"], norm)
            errors.append((joint.name, error, unit.words, tolerance.deg))
    if tolerance.cm is not None:
        ratio = error_norm(task.search(replay.path).errors(replay, "planned"), norm)
        errors.append(("the foot", ratio * tolerance.cm, "cm", tolerance.cm))
    return [
        off_by(subject, error, unit, norm, allowed)
        for subject, error, unit, allowed in errors
        if error > allowed * (1.0 + 1e-9)  # rounding
    ]


# Many recordings, and what is written.


def check_writing(form: str, recordings: Sequence[Recording], output: str) -> None:
    """Refuse outputs that cannot be written, before anything is computed; claim those that can."""
    if form in FOLDERS:
        check_place("replay.write_as", form, output)
    if form != "lerobot" and len(recordings) > 1:
        raise BadSetting(
            f"{len(recordings)} recordings, and {marked('replay.write_as', form)} holds one: name "
            "one file, or one episode (--episodes 0), or write them all with ‹replay.write_as = "
            '"lerobot"›'
        )
    if form not in ("csv", "joints"):
        check_installed(form)
    if form in FOLDERS:
        click.get_current_context().with_resource(claimed(output))
    else:
        check_writable(output)


def write(file: str, task: ReplayTask, replay: Replay) -> None:
    """Write the requests of one recording."""
    form = task.settings.replay.write_as
    if form in ("csv", "joints", "lerobot"):
        episode.write_replay(file, task.recording, replay, form)
        return
    export = settings.Export(format=form, file=file)
    units = tuple(joint.path.unit for joint in replay.joints)
    *_, write_rows = exported(export, Schedule(replay.names, replay.requests, replay.period, units))
    write_rows(file)


ABOUT = "replay.json"  # the file of a planned dataset with its settings and errors


def replay_many(
    recordings: Sequence[ReplayTask],
    output: str,
    executor: Executor,
    *,
    resume: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Mapping[str, Any], Path]:
    """Replay recordings, and write those that have a plan as one LeRobot dataset.

    The planned episodes are kept in a hidden folder beside the dataset, ``.NAME.results``, unless
    all are written. Memory does not grow with the number of recordings, but for their figures.
    Returns the answer for machines, and that folder.
    """
    first = recordings[0]
    run = first.settings
    models = {name: repr((each, each.evidence)) for name, each in first.models.by_joint.items()}
    results = Results(output, {"models": models, "rate": first.rate, **_chosen(run)}, resume=resume)
    tasks = [Task(each.recording.name, each, _inputs(each.recording)) for each in recordings]
    failed = carry_out(replayed, tasks, results, executor, progress=progress)
    if len(failed) == len(recordings):
        results.remove()
        reason = next(iter(failed.values()))
        raise PlannerError(f"none of {len(recordings)} recordings can be replayed: {reason}")
    figures, findings = [], dict[str, Mapping[str, str]]()
    about: dict[str, str] = {}
    with ExitStack() as outputs:
        layout, add = None, None
        for task in tasks:
            content = results.read(task)
            if content is None:
                continue
            of_episode, rows, head = episode.decoded(content)
            if layout is None or add is None:
                layout = of_episode
                add = outputs.enter_context(lerobot_dataset(output, layout, beside=about))
            if of_episode.features != layout.features:
                failed[task.name] = (
                    f"its actions are {', '.join(of_episode.features[ACTION])}, those of the "
                    f"dataset {', '.join(layout.features[ACTION])}; replay it on its own"
                )
                continue
            add(rows, head["task"])
            figures.append(head["figures"])
            findings[task.name] = head["figures"].pop("findings", {})
        document: dict[str, Any] = {
            "track": run.replay.track,
            "why": recorded_path.WHY[run.replay.track],
            "models": first.models.words,
            "speed": None if run.replay.fastest else run.path.speed or 1.0,
            "recordings": figures,
            "left_out": failed,
            **told(findings_of_many(findings), *first.models.remarks),
        }
        if not failed:
            document |= made_from(origin_of(run, [each.recording for each in recordings]), document)
        about[ABOUT] = to_json(document)
    if not failed:
        results.remove()
    return document, results.folder


def replayed(task: ReplayTask) -> bytes:
    """A replayed recording as the bytes of an NPZ file: a task of :mod:`planner.parallel`."""
    replay, _ = task.run()
    content = episode.lerobot_episode(task.recording, replay)
    return episode.encoded(content, episode_results(replay, task.models))


def origin_of(run: settings.ReplayRun, recordings: Sequence[Recording]) -> dict[str, Any]:
    """The inputs of a dataset, before any recording is read or identified."""
    return {
        "model": digest_of(run.model.file),
        **_chosen(run),
        "recordings": [[each.name, _inputs(each)] for each in recordings],
    }


def _chosen(run: settings.ReplayRun) -> dict[str, Any]:
    """The settings of a replay, and the content of the URDF that they name."""
    leg, names = loading.find_leg(run), ("replay", "path", "limits", "plan", "tolerance", "leg")
    chosen = {name: getattr(run, name).values() for name in names}
    return {**chosen, "urdf": None if leg is None else digest_of(leg.urdf)}


def _inputs(recording: Recording) -> str:
    """An identifier of a recording's content: size and time of each of its files."""
    path = Path(recording.path)
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    states = [
        (file.name, state.st_size, state.st_mtime_ns)
        for file in files
        if file.is_file() and (state := file.stat())
    ]
    return repr((recording.options, states))
