"""Many recordings replayed in parallel into one dataset, resumable."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import PlannerError
from planner.files.exports.lerobot import Layout, lerobot_dataset
from planner.run.replay import Episode, ReplayTask, replay_episode
from planner.run.tasks import Engine, Results, Task, carry_out, results_beside

HEAD = "head"
"""The array of an encoded episode that holds all but its rows, as JSON."""


@dataclass(frozen=True)
class Replayed:
    """What became of many recordings.

    Attributes:
        figures: Of every episode that is written, in order: a line of a table.
        failed: Why the others are left out, by the name of the recording.
        kept: The folder with the results of the written ones, where others failed.
    """

    figures: tuple[Mapping[str, Any], ...]
    failed: Mapping[str, str]
    kept: Path | None


def replay_many(
    recordings: Sequence[ReplayTask],
    output: str,
    engine: Engine,
    *,
    resume: bool = False,
    progress: Callable[[Task], None] = lambda _: None,
) -> Replayed:
    """Replay recordings, and write those that have a plan as one LeRobot dataset.

    The planned episodes wait in a hidden folder beside the dataset, ``.NAME.results``, which is
    removed once the dataset is written, unless a recording failed. What is kept in memory does not
    grow with the number of recordings, but for their figures.

    Args:
        recordings: The recordings, and how to replay them.
        output: The folder of the dataset.
        engine: What they are replayed on.
        resume: Use the results of an earlier call that was killed, or in which some failed.
        progress: Called with each recording that is finished or has failed.

    Raises:
        PlannerError: None of them can be replayed, or the dataset cannot be written.
    """
    results = results_beside(output, _settings(recordings[0]), resume=resume)
    tasks = [Task(each.recording.name, each, _inputs(each)) for each in recordings]
    failures = carry_out(replayed, tasks, results, engine, progress=progress)
    failed = {each.task: each.reason for each in failures}
    if len(failed) == len(recordings):
        results.remove()
        first = next(iter(failed.values()))
        raise PlannerError(f"none of {len(recordings)} recordings can be replayed: {first}")
    figures = []
    with ExitStack() as outputs:
        add = None
        for episode in _episodes(tasks, results):
            if add is None:
                add = outputs.enter_context(lerobot_dataset(output, episode.layout))
            add(episode.rows, episode.task)
            figures.append(episode.figures)
    if failed:
        return Replayed(tuple(figures), failed, results.folder)
    results.remove()
    return Replayed(tuple(figures), failed, None)


def replayed(task: ReplayTask) -> bytes:
    """An episode, encoded: a task of :mod:`planner.run.tasks`."""
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


def _episodes(tasks: Sequence[Task], results: Results) -> Iterator[Episode]:
    """The episodes with a result, in the order of the recordings."""
    return (decoded(results.read(task)) for task in tasks if task in results)


def _settings(task: ReplayTask) -> dict[str, Any]:
    """What every episode depends on, beside its recording."""
    return {
        "models": {name: repr(model) for name, model in task.models.by_joint.items()},
        **{name: getattr(task, name).values() for name in ("replay", "limits", "plan")},
        "rate": task.rate,
    }


def _inputs(task: ReplayTask) -> str:
    """What identifies the content of a recording: of each of its files the size and the time."""
    recording = task.recording
    path = Path(recording.path)
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    states = [
        (str(file), state.st_size, state.st_mtime_ns)
        for file in files
        if file.is_file() and (state := file.stat())
    ]
    return repr((recording.options, states))
