"""Output of replays: files of one recording, and many recordings in one dataset, resumable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from planner.cli import settings
from planner.cli.console import BadSetting, Key
from planner.cli.export import FOLDERS, check_rows, write_rows
from planner.cli.models import find_leg
from planner.cli.replay.task import ReplayTask
from planner.cli.settings import ReplayFormat
from planner.exceptions import PlannerError
from planner.files.columns import TIME
from planner.files.exports import check_installed, lerobot_dataset
from planner.files.logs import Recording
from planner.files.logs.lerobot import ACTION
from planner.files.paths import write_joint_path
from planner.files.results import Results, Task, digest_of, made_from
from planner.files.table import write_table
from planner.files.text import to_json
from planner.parallel import carry_out
from planner.recording.episode import as_written, decoded, encoded, lerobot_episode
from planner.recording.recorded_path import WHY
from planner.recording.replaying import Replay
from planner.report.episodes_page import resent_words
from planner.report.replay_results import episode_results
from planner.robot.schedule import Schedule


def check_writing(form: ReplayFormat, recordings: Sequence[Recording], output: str) -> None:
    """Refuse outputs that cannot be written, before anything is computed."""
    key = Key("replay.write_as", form)
    if form in FOLDERS and output == "-":
        raise BadSetting(key, " is a folder: name it with --output")
    if form != "lerobot" and len(recordings) > 1:
        raise BadSetting(
            f"{len(recordings)} recordings, and ",
            key,
            " holds one: name one file, or one episode (--episodes 0), or write them all with ",
            Key("replay.write_as", "lerobot"),
        )
    check_installed(form)


def write_replay(file: str, recording: Recording, replay: Replay, form: ReplayFormat) -> None:
    """Write the requests of one recording."""
    names, requests = replay.names, replay.requests
    if form == "lerobot":
        layout, rows, task = lerobot_episode(recording, replay)
        with lerobot_dataset(file, layout) as add:
            add(rows, task)
    elif form == "csv":
        columns = []
        for log in (joint.path.log for joint in replay.joints):
            unit = log.written.unit if log.written else {"rad": "rad", "1": "range"}[log.unit]
            own = log.written.column if log.written else ""
            columns.append(own or f"{log.joint or 'requested'}_{unit}")
        times = np.arange(len(requests)) * replay.period
        values = np.column_stack([as_written(joint, joint.requests) for joint in replay.joints])
        write_table(file, [TIME, *columns], np.column_stack([times, values]))
    elif form == "joints":
        units = ["deg" if joint.path.unit == "rad" else "percent" for joint in replay.joints]
        shares = np.array([joint.path.unit == "1" for joint in replay.joints])
        angles = np.where(shares, np.radians(100.0 * requests), requests)
        write_joint_path(file, names, angles, period=replay.period, units=units)
    else:
        export = settings.Export(format=form, file=file)
        schedule = Schedule(names, requests, replay.period)
        check_rows(export, schedule)
        write_rows(file, export, schedule)


ABOUT = "replay.json"
"""The file of a planned dataset with its settings and errors."""


def replay_many(
    recordings: Sequence[ReplayTask],
    output: str,
    executor: Executor,
    *,
    resume: bool = False,
    progress: Callable[[Task], None] = lambda _: None,
) -> tuple[Mapping[str, Any], Path]:
    """Replay recordings, and write those that have a plan as one LeRobot dataset.

    The planned episodes are kept in a hidden folder beside the dataset, ``.NAME.results``, which is
    removed once the dataset is written, unless a recording failed. Memory does not grow with the
    number of recordings, but for their figures. Returns the answer for machines, and that folder.
    """
    first = recordings[0]
    models = {name: repr((each, each.evidence)) for name, each in first.models.by_joint.items()}
    inputs = {"models": models, "rate": first.rate, **_chosen(first.run_settings, first.replay)}
    results = Results(output, inputs, resume=resume)
    tasks = [Task(each.recording.name, each, _inputs(each.recording)) for each in recordings]
    failed = carry_out(replayed, tasks, results, executor, progress=progress)
    if len(failed) == len(recordings):
        results.remove()
        reason = next(iter(failed.values()))
        raise PlannerError(f"none of {len(recordings)} recordings can be replayed: {reason}")
    figures = []
    about: dict[str, str] = {}
    with ExitStack() as outputs:
        layout, add = None, None
        for task in tasks:
            content = results.read(task)
            if content is None:
                continue
            of_episode, rows, head = decoded(content)
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
        document: dict[str, Any] = {
            "track": first.replay.track,
            "why": WHY[first.replay.track],
            "models": first.models.words,
            "speed": None if first.replay.fastest else first.replay.speed,
            "recordings": figures,
            "left_out": failed,
            "remarks": [*first.models.remarks, *resent_words(figures)],
        }
        if not failed:
            every = [each.recording for each in recordings]
            document |= made_from(origin_of(first.run_settings, first.replay, every), document)
        about[ABOUT] = to_json(document)
    if not failed:
        results.remove()
    return document, results.folder


def replayed(task: ReplayTask) -> bytes:
    """A replayed recording as the bytes of an NPZ file: a task of :mod:`planner.parallel`."""
    replay = task.run()
    return encoded(lerobot_episode(task.recording, replay), episode_results(replay))


def origin_of(
    run: settings.Run, replay: settings.Replay, recordings: Sequence[Recording]
) -> dict[str, Any]:
    """The inputs of a dataset, before any recording is read or identified."""
    return {
        "model": digest_of(run.model.file),
        **_chosen(run, replay),
        "recordings": [[each.name, _inputs(each)] for each in recordings],
    }


def _chosen(run: settings.Run, replay: settings.Replay) -> dict[str, Any]:
    """The settings of a replay, and the content of the URDF that they name."""
    leg = find_leg(run.leg)
    return {
        "replay": replay.values(),
        **{name: getattr(run, name).values() for name in ("limits", "plan", "tolerance", "leg")},
        "urdf": None if leg is None else digest_of(leg.urdf),
    }


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
