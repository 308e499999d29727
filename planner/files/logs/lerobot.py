"""LeRobot datasets, v2.1 and v3: the action is the request, the observation the actual angle."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidFile, InvalidInput
from planner.files.logs.joints import choose_joints
from planner.files.logs.lerobot_meta import ACTION, STATE, Dataset, find_dataset
from planner.files.logs.options import LogOptions
from planner.files.logs.parquet import read_columns
from planner.files.logs.rows import Columns, Source, make_log
from planner.files.logs.units import Scale
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.identification.log import Log

Rows = npt.NDArray[np.intp]
"""Places of rows, shape (n,)."""

MOST_EPISODES = 10**9
"""Episodes are numbered below this."""

TIME, EPISODE = "timestamp", "episode_index"
"""Columns of a row's time [s] in its episode, and of the episode's number."""


def read_lerobot(path: Path | str, options: LogOptions) -> tuple[Log, ...]:
    """Read the chosen joints of the chosen episodes of a dataset, or of one of its files.

    Raises:
        InvalidFile: It is none, or holds no such joint or episode; the message says why.
        MissingExtra: pyarrow is not installed.
    """
    dataset = find_dataset(Path(path))
    wanted = options.wanted_episodes()
    logs: list[Log] = []
    found: set[int] = set()
    for file in _files(dataset, Path(path), wanted):
        columns = read_columns(file, [TIME, EPISODE, ACTION, STATE])
        times, numbers = (_one_a_row(file, name, columns[name]) for name in (TIME, EPISODE))
        joints = _joints(dataset, file, columns)
        chosen = choose_joints(path, tuple(joints), options.joint)
        names = [tuple(joints)[k] for k in chosen]
        scales = {name: _scale(path, name, options) for name in names}
        for episode, rows in _episodes(file, numbers):
            found.add(episode)
            if wanted is None or episode in wanted:
                source = Source(path=file, part=f"episode {episode}")
                for name in names:
                    action, state = joints[name]
                    values = Columns(
                        times=times[rows],
                        requests=columns[ACTION].reshape(len(times), -1)[rows, action],
                        angles=columns[STATE].reshape(len(times), -1)[rows, state],
                        request_scale=scales[name],
                        angle_scale=scales[name],
                    )
                    logs.append(make_log(source, values, joint=name, notes=_notes(values)))
    missing = (wanted or frozenset()) - found
    if missing:
        raise _no_episode(path, min(missing), found | set(_named(dataset, Path(path))))
    if not logs:
        raise InvalidFile(path, "no row of any episode; is the file cut short?")
    return tuple(logs)


def lerobot_joints(path: Path | str, options: LogOptions) -> tuple[str, ...]:
    """Names of the joints that both the action and the observation hold."""
    dataset = find_dataset(Path(path))
    file = _files(dataset, Path(path), options.wanted_episodes())[0]
    return tuple(_joints(dataset, file, read_columns(file, [ACTION, STATE])))


def _files(dataset: Dataset, path: Path, wanted: frozenset[int] | None) -> tuple[Path, ...]:
    if not path.is_dir():
        return (path,)
    files = dataset.files(wanted)
    if not files:
        raise _no_episode(path, min(wanted or ()), dataset.episodes_named())
    return files


def _named(dataset: Dataset, path: Path) -> frozenset[int]:
    return dataset.episodes_named() if path.is_dir() else frozenset()


def _no_episode(path: Path | str, episode: int, known: Iterable[int]) -> InvalidFile:
    return InvalidFile(path, f"no episode {episode}; episodes: {_ranges(known)}")


def _joints(
    dataset: Dataset, file: Path, columns: Mapping[str, Array]
) -> dict[str, tuple[int, int]]:
    """Places in the action and in the observation of every joint that both hold."""
    places = []
    for key in (ACTION, STATE):
        values, names = columns[key], dataset.names[key]
        width = values.shape[1] if values.ndim == 2 else 1
        if names is None:
            names = tuple(str(j) for j in range(width))
        if len(names) != width:
            raise InvalidFile(
                file,
                f"'{key}' has {width} numbers a row, but meta/info.json names {len(names)}; is the "
                "file of this dataset?",
            )
        places.append({name: j for j, name in enumerate(names)})
    action, state = places
    both = {name: (action[name], state[name]) for name in action if name in state}
    if not both:
        raise InvalidFile(
            file,
            f"no joint is in both '{ACTION}' ({', '.join(action)}) and '{STATE}' "
            f"({', '.join(state)})",
        )
    return both


def _scale(path: Path | str, joint: str, options: LogOptions) -> Scale:
    try:
        scale = options.scale_of(joint)
    except InvalidInput as error:
        raise InvalidFile(path, str(error)) from error
    if scale is None:
        raise InvalidFile(
            path,
            f"LeRobot does not say the unit of '{joint}'; give --unit rad, deg, range_m100_100 "
            "(LeRobot's usual -100..100), percent (its grippers' 0..100), range or ticks",
        )
    return scale


def _one_a_row(file: Path, name: str, values: Array) -> Array:
    """Numbers of shape (n,); some versions of LeRobot write them as lists of one."""
    if values.ndim == 2 and values.shape[1] != 1:
        raise InvalidFile(file, f"'{name}' has {values.shape[1]} numbers a row, expected one")
    return values.ravel()


def _episodes(file: Path, numbers: Array) -> Iterator[tuple[int, Rows]]:
    """Each episode and the rows that it has."""
    known = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers < MOST_EPISODES)
    if not known.all():
        raise InvalidFile(file, f"'{EPISODE}': expected whole numbers from 0")
    for episode in np.unique(numbers):
        yield int(episode), np.flatnonzero(numbers == episode)


def _notes(columns: Columns) -> tuple[str, ...]:
    return (
        f"time from '{TIME}', requested from '{ACTION}' (sent at the time of its row), actual from "
        f"'{STATE}'",
        f"angles in {columns.angle_scale.name}, as --unit said",
    )


def _ranges(numbers: Iterable[int]) -> str:
    """Numbers in few words: 0-3, 7."""
    parts: list[list[int]] = []
    for number in sorted(numbers):
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in parts) or "none"
