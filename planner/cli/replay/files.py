"""Output files of a replay: CSV like the recording, a path, ROS messages, a LeRobot dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from planner.cli import settings
from planner.cli.faults import BadSetting, Key
from planner.cli.rows import FOLDERS, write_rows
from planner.cli.settings import ReplayFormat
from planner.exceptions import InvalidInput
from planner.files.columns import TIME
from planner.files.exports import check_format
from planner.files.lerobot_export import TASK, Layout, frame_rate, lerobot_dataset
from planner.files.logs.lerobot import ACTION, STATE, find_dataset, read_episode
from planner.files.paths import write_joint_path
from planner.files.table import write_table
from planner.robot.schedule import Schedule
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.files.logs.read import Recording
    from planner.recording.replaying import JointReplay, Replay


def check_writing(form: ReplayFormat, recordings: Sequence[Recording], output: str) -> None:
    """Refuse outputs that cannot be written, before anything is computed.

    Raises:
        BadSetting: The format does not go with the output, or holds one recording only.
        MissingExtra: The format needs a package that is not installed.
    """
    key = Key("replay.write_as", form)
    if form in FOLDERS and output == "-":
        raise BadSetting(key, " is a folder: name it with --output")
    if form != "lerobot" and len(recordings) > 1:
        raise BadSetting(
            f"{len(recordings)} recordings, and ",
            key,
            " holds one: choose one (--episodes 0), or write them all with ",
            Key("replay.write_as", "lerobot"),
        )
    if form not in ("csv", "joints"):
        check_format(form, Schedule(("joint",), np.zeros((3, 1)), 0.02))


def write_replay(file: str, recording: Recording, replay: Replay, form: ReplayFormat) -> None:
    """Write the requests of one recording."""
    names, requests = replay.names, replay.requests
    if form == "lerobot":
        layout, rows, task = lerobot_episode(recording, replay)
        with lerobot_dataset(file, layout) as add:
            add(rows, task)
    elif form == "csv":
        columns = [column_of(joint) for joint in replay.joints]
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
        write_rows(file, export, Schedule(names, requests, replay.period))


def lerobot_episode(recording: Recording, replay: Replay) -> tuple[Layout, dict[str, Array], str]:
    """Layout of a planned dataset, as in the dataset that was read; rows and task of an episode.

    Actions are planned, observations re-timed.

    Raises:
        InvalidInput: The episode has other columns than the rest of the dataset.
    """
    rate = frame_rate(replay.period)
    if not recording.dataset:
        layout = Layout(features={ACTION: replay.names, STATE: replay.names}, rate=rate)
        action = [as_written(joint, joint.requests) for joint in replay.joints]
        state = [as_written(joint, joint.recorded_angles) for joint in replay.joints]
        return layout, {ACTION: np.column_stack(action), STATE: np.column_stack(state)}, TASK
    dataset, rows = find_dataset(recording.place.file), read_episode(recording.place)
    arrays = {ACTION: rows.action, STATE: rows.state}
    numbers = {key: tuple(map(str, range(each.shape[1]))) for key, each in arrays.items()}
    features = {key: dataset.written[key] or numbers[key] for key in arrays}
    layout = Layout(features=features, rate=rate, robot_type=dataset.robot_type)
    whole = ~np.isnan(np.column_stack([rows.times, rows.action, rows.state])).any(axis=1)
    times = rows.times[whole]
    moments = replay.moments + times[0]
    values = {
        key: np.column_stack([np.interp(moments, times, column) for column in each[whole].T])
        for key, each in arrays.items()
    }
    names = dataset.names[ACTION] or numbers[ACTION]
    if len(names) != len(numbers[ACTION]):
        raise InvalidInput(
            f"{recording.name}: {len(numbers[ACTION])} actions, expected {len(names)}"
        )
    for joint in replay.planned:
        values[ACTION][:, names.index(joint.name)] = as_written(joint, joint.requests)
    return layout, values, rows.task or TASK


def left_out(recording: Recording) -> str:
    """The parts of the read dataset that the planned one leaves out, in words; "" if complete."""
    if not recording.dataset:
        return ""
    dataset = find_dataset(recording.place.file)
    words = []
    if dataset.others:
        words.append(f"{', '.join(dataset.others)} left out: the frames are of other moments")
    if dataset.task_file and not dataset.tasks():
        words.append(f"{dataset.task_file} cannot be read: the task is called '{TASK}'")
    return "; ".join(words)


def as_written(joint: JointReplay, values: Array) -> Array:
    """Angles of a joint in the numbers of the file that it was read from, shape (n,)."""
    written = joint.path.log.written
    if written is None:
        return values
    return np.asarray((values - written.shift) / written.factor)


def column_of(joint: JointReplay) -> str:
    """The column of a joint's requests in CSV: the recording's, or its name and unit."""
    log = joint.path.log
    if log.written is not None and log.written.column:
        return log.written.column
    unit = log.written.unit if log.written is not None else {"rad": "rad", "1": "range"}[log.unit]
    return f"{log.joint or 'requested'}_{unit}"
