"""Many recordings replayed in parallel into one dataset, resumable."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.cli import settings
from planner.cli.desired import find_leg
from planner.cli.replay.files import lerobot_episode
from planner.cli.replay.task import RESENT, UNITS, ReplayTask
from planner.exceptions import PlannerError
from planner.files.lerobot_export import Layout, lerobot_dataset
from planner.files.logs.lerobot import ACTION
from planner.files.logs.read import Recording
from planner.files.results import Results, Task, digest_of, finished, made_from
from planner.files.text import to_json
from planner.parallel import carry_out
from planner.recording.recorded_path import WHY
from planner.recording.replaying import Replay
from planner.report.table import number, text_table
from planner.trajectory import Array, error_norm

HEAD = "head"
"""The array of an encoded episode that holds all but its rows, as JSON."""

ABOUT = "replay.json"
"""The file of a planned dataset with its settings and errors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """A replayed recording as a dataset takes it; small, and it can be sent between processes.

    Attributes:
        rows: Its rows by feature, shape (n, k) each, in the numbers of the recording.
        task: The task that it shows, in words.
        layout: The features and the rate of the dataset that takes it.
        figures: Its row in a table of many recordings: :func:`episode_figures`.
    """

    rows: Mapping[str, Array]
    task: str
    layout: Layout
    figures: Mapping[str, Any]


@dataclass(frozen=True)
class Replayed:
    """The result of replaying many recordings.

    Attributes:
        document: The answer for machines: :func:`episodes_document`.
        kept: The folder with the results of the written recordings, if some failed.
        nothing_missing: Whether the dataset was already complete.
    """

    document: Mapping[str, Any]
    kept: Path | None = None
    nothing_missing: bool = False


def replayed_before(
    output: str, run: settings.Run, replay: settings.Replay, recordings: Sequence[Recording]
) -> Replayed | None:
    """The replay of the same recordings, if the dataset is there and whole."""
    document = finished(output, ABOUT, _origin(run, replay, recordings))
    return None if document is None else Replayed(document, nothing_missing=True)


def replay_many(
    recordings: Sequence[ReplayTask],
    output: str,
    executor: Executor,
    *,
    resume: bool = False,
    progress: Callable[[Task], None] = lambda _: None,
) -> Replayed:
    """Replay recordings, and write those that have a plan as one LeRobot dataset.

    The planned episodes are kept in a hidden folder beside the dataset, ``.NAME.results``, which is
    removed once the dataset is written, unless a recording failed. Memory does not grow with the
    number of recordings, but for their figures.

    Args:
        recordings: The recordings, and how to replay them.
        output: The folder of the dataset.
        executor: The executor for the replays.
        resume: Use the results of an earlier call that was killed, or in which some failed.
        progress: Called with each recording that is finished or has failed.

    Raises:
        PlannerError: None of them can be replayed, or the dataset cannot be written.
    """
    results = Results(output, _settings(recordings[0]), resume=resume)
    tasks = [Task(each.recording.name, each, _inputs(each.recording)) for each in recordings]
    failed = carry_out(replayed, tasks, results, executor, progress=progress)
    if len(failed) == len(recordings):
        results.remove()
        first = next(iter(failed.values()))
        raise PlannerError(f"none of {len(recordings)} recordings can be replayed: {first}")
    figures = []
    about: dict[str, str] = {}
    with ExitStack() as outputs:
        layout, add = None, None
        for task in tasks:
            content = results.read(task)
            if content is None:
                continue
            episode = decoded(content)
            if layout is None or add is None:
                layout = episode.layout
                add = outputs.enter_context(lerobot_dataset(output, layout, beside=about))
            if episode.layout.features != layout.features:
                failed[task.name] = (
                    f"its actions are {', '.join(episode.layout.features[ACTION])}, those of the "
                    f"dataset {', '.join(layout.features[ACTION])}; replay it on its own"
                )
                continue
            add(episode.rows, episode.task)
            figures.append(episode.figures)
        first_task = recordings[0]
        document = episodes_document(figures, failed, first_task)
        if not failed:
            every = [each.recording for each in recordings]
            document |= made_from(
                _origin(first_task.run_settings, first_task.replay, every), document
            )
        about[ABOUT] = to_json(document)
    if failed:
        return Replayed(document, kept=results.folder)
    results.remove()
    return Replayed(document)


def replay_episode(task: ReplayTask) -> Episode:
    """Read a recording, plan its replay, and make rows of it: a pure function of its task.

    Raises:
        PlannerError: The recording cannot be read, or there is no plan.
    """
    replay = task.run()
    layout, rows, words = lerobot_episode(task.recording, replay)
    return Episode(rows=rows, task=words, layout=layout, figures=episode_figures(replay))


def replayed(task: ReplayTask) -> bytes:
    """An episode, encoded: a task of :mod:`planner.parallel`."""
    return encoded(replay_episode(task))


def encoded(episode: Episode) -> bytes:
    """An episode as the bytes of an NPZ file, from which it is made again to the last bit."""
    head = {"task": episode.task, "layout": asdict(episode.layout), "figures": episode.figures}
    stream = io.BytesIO()
    np.savez(stream, **{HEAD: np.array(json.dumps(head))}, **episode.rows)  # type: ignore[arg-type]
    return stream.getvalue()


def decoded(content: bytes) -> Episode:
    """The episode that was encoded."""
    with np.load(io.BytesIO(content)) as arrays:
        head = json.loads(str(arrays[HEAD]))
        rows = {name: arrays[name] for name in arrays.files if name != HEAD}
    layout = head["layout"]
    layout["features"] = {name: tuple(each) for name, each in layout["features"].items()}
    return Episode(rows=rows, task=head["task"], layout=Layout(**layout), figures=head["figures"])


def episode_figures(replay: Replay) -> dict[str, Any]:
    """The row of a recording in a table of many: the joint with the largest error of its plan."""
    worst = max(
        replay.planned,
        key=lambda each: UNITS[each.path.unit][1] * error_norm(each.errors["planned"], "rms"),
    )
    unit, factor = UNITS[worst.path.unit]
    return {
        "recording": replay.path.name,
        "requests": len(replay.moments),
        "duration_s": (len(replay.moments) - 1) * replay.period,
        "speed": replay.speed,
        "worst_joint": worst.name,
        "unit": unit,
        **{f"{kind}_rms": factor * error_norm(each, "rms") for kind, each in worst.errors.items()},
        "expected_on_robot_rms": factor * worst.expected,
        "lower_bound": factor * worst.lower_bound,
        "recorded_requests_may_serve": worst in replay.resent_may_serve,
        "remarks": list(replay.path.remarks),
    }


def episodes_document(
    figures: Sequence[Mapping[str, Any]], failed: Mapping[str, str], task: ReplayTask
) -> dict[str, Any]:
    """Many recordings for machines."""
    return {
        "track": task.replay.track,
        "why": WHY[task.replay.track],
        "models": task.models.words,
        "speed": None if task.replay.fastest else task.replay.speed,
        "recordings": [dict(each) for each in figures],
        "left_out": dict(failed),
        "remarks": [*task.models.remarks, *_resent_words(figures)],
    }


def episodes_line(document: Mapping[str, Any]) -> str:
    """One line about the replay: track, number of recordings, speed and models."""
    rows, speed = document["recordings"], document["speed"]
    requests = sum(row["requests"] for row in rows)
    how = "as fast as the tolerance allows" if speed is None else f"at {speed:.4g} times the speed"
    return (
        f"follows {document['why']}; {len(rows)} recordings, {requests} requests {how}; "
        f"{document['models']}"
    )


def episodes_text(document: Mapping[str, Any]) -> str:
    """Many recordings for people: a line each, about the joint with the largest planned error."""
    fastest = document["speed"] is None
    header = [
        *("recording", "requests", *(["speed"] if fastest else []), "worst joint"),
        *("as recorded", "path as it is", "best shift", "plan", "on the robot", "lower bound"),
    ]
    kinds = ("resent_rms", "direct_rms", "shifted_rms", "planned_rms")
    cells = [
        [
            str(row["recording"]),
            f"{row['requests']}",
            *([f"{row['speed']:.3g}"] if fastest else []),
            f"{row['worst_joint']} [{row['unit']}]",
            *(f"{row[kind]:.3f}" for kind in kinds),
            number(row["expected_on_robot_rms"], 3),
            number(row["lower_bound"], 3),
        ]
        for row in document["recordings"]
    ]
    words = _resent_words(document["recordings"])
    return "\n".join([episodes_line(document), text_table(header, cells), *words])


def _resent_words(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The number of recordings whose own requests may be better, with the errors of one example."""
    of = [row for row in rows if row["recorded_requests_may_serve"]]
    if not of:
        return []
    first = of[0]
    errors = f"{first['expected_on_robot_rms']:.3f} and {first['resent_rms']:.3f} {first['unit']}"
    where = f"such as {errors} rms in {first['recording']}"
    return [f"in {len(of)} of {len(rows)} recordings {RESENT}, {where}"]


def _settings(task: ReplayTask) -> dict[str, Any]:
    """The inputs of every episode beside its recording."""
    models = {name: repr((each, each.evidence)) for name, each in task.models.by_joint.items()}
    return {"models": models, "rate": task.rate, **_chosen(task.run_settings, task.replay)}


def _origin(
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
