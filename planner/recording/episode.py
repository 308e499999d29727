"""A replay as an episode of a LeRobot dataset, and as bytes, for a process that writes it later."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Literal

import numpy as np

from planner.arrays import Array
from planner.files.exports import LEROBOT_TASK, Layout, frame_rate, lerobot_dataset
from planner.files.logs import Recording
from planner.files.logs.lerobot import ACTION, STATE, find_dataset, read_episode
from planner.files.paths import write_joint_path, write_samples
from planner.recording.replaying import JointReplay, Replay

HEAD = "head"  # the array of an encoded episode that holds all but its rows, as JSON

# Layout of a dataset, rows of an episode by feature, and its task in words.
Episode = tuple[Layout, dict[str, Array], str]


def lerobot_episode(recording: Recording, replay: Replay) -> Episode:
    """A planned episode in the layout that was read: actions planned, observations re-timed."""
    rate = frame_rate(replay.period)
    if not recording.is_episode:
        action = [as_written(joint, joint.requests) for joint in replay.joints]
        state = [as_written(joint, joint.recorded_angles) for joint in replay.joints]
        values = {ACTION: np.column_stack(action), STATE: np.column_stack(state)}
        return Layout(features=dict.fromkeys(values, replay.names), rate=rate), values, LEROBOT_TASK
    dataset, rows = find_dataset(recording.file), read_episode(recording.file, recording.episode)
    arrays = {ACTION: rows.action, STATE: rows.state}
    features = {key: dataset.written[key] or dataset.names_of(key, rows) for key in arrays}
    layout = Layout(features=features, rate=rate, robot_type=dataset.robot_type)
    whole = ~np.isnan(np.column_stack([rows.times, rows.action, rows.state])).any(axis=1)
    times = rows.times[whole]
    moments = replay.moments + times[0]
    values = {
        key: np.column_stack([np.interp(moments, times, column) for column in each[whole].T])
        for key, each in arrays.items()
    }
    names = dataset.names_of(ACTION, rows)
    for joint in replay.planned:
        values[ACTION][:, names.index(joint.name)] = as_written(joint, joint.requests)
    return layout, values, rows.task or LEROBOT_TASK


def left_out(recording: Recording) -> str:
    """The parts of the read dataset that the planned one leaves out, in words; "" if complete."""
    if not recording.is_episode:
        return ""
    dataset = find_dataset(recording.file)
    words = []
    if dataset.others:
        words.append(f"{', '.join(dataset.others)} left out: the frames are of other moments")
    if dataset.task_file and not dataset.tasks():
        words.append(f"{dataset.task_file} cannot be read: the task is called '{LEROBOT_TASK}'")
    return "; ".join(words)


def as_written(joint: JointReplay, values: Array) -> Array:
    """Angles of a joint in the numbers of the file that it was read from, shape (n,)."""
    written = joint.path.log.written
    if written is None:
        return values
    return np.asarray((values - written.shift) / written.factor)


def encoded(episode: Episode, figures: Mapping[str, Any]) -> bytes:
    """An episode and figures about it as the bytes of an NPZ file."""
    layout, rows, task = episode
    head = json.dumps({"task": task, "layout": asdict(layout), "figures": figures})
    stream = io.BytesIO()
    np.savez(stream, **{HEAD: np.array(head)}, **rows)  # type: ignore[arg-type]
    return stream.getvalue()


def decoded(content: bytes) -> tuple[Layout, dict[str, Array], dict[str, Any]]:
    """Layout and rows of such a file, by feature, and ``task`` and ``figures``: to the last bit."""
    with np.load(io.BytesIO(content)) as arrays:
        head = json.loads(str(arrays[HEAD]))
        rows = {name: arrays[name] for name in arrays.files if name != HEAD}
    layout = head["layout"]
    layout["features"] = {name: tuple(each) for name, each in layout["features"].items()}
    return Layout(**layout), rows, head


def write_replay(
    file: str, recording: Recording, replay: Replay, form: Literal["csv", "joints", "lerobot"]
) -> None:
    """Write requests as in the recording (csv), as ``plan`` does, or as a dataset."""
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
        values = np.column_stack([as_written(joint, joint.requests) for joint in replay.joints])
        write_samples(file, columns, values, period=replay.period)
    else:
        units = ["deg" if joint.path.unit == "rad" else "percent" for joint in replay.joints]
        shares = np.array([joint.path.unit == "1" for joint in replay.joints])
        angles = np.where(shares, np.radians(100.0 * requests), requests)
        write_joint_path(file, names, angles, period=replay.period, units=units)
