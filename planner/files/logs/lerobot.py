"""LeRobot datasets, v2.1 and v3: the action is the request, the observation the actual angle."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, Indices, Mask, as_number, read_only
from planner.exceptions import InvalidFile, importing, nearest
from planner.files.columns import scale
from planner.files.logs.rows import LogOptions, Recorded, Rows
from planner.files.staging import reason
from planner.files.table import Source
from planner.files.text import read_json, read_text

ACTION, STATE = "action", "observation.state"  # features of the requested and the actual angles
INFO = Path("meta", "info.json")  # the description of a dataset
_EPISODE = re.compile(r"episode_(\d+)\.parquet", re.ASCII)
# Columns of every dataset that count rows, and their types: a row's time [s] in its episode, the
# number of the episode, and that of its task, are read.
TIME, EPISODE, TASK = "timestamp", "episode_index", "task_index"
COUNTED = {TIME: "float32"} | dict.fromkeys(("frame_index", EPISODE, "index", TASK), "int64")
MOST_BYTES = 2**28  # unfolded columns of one file [bytes]: 22 hours at 30 Hz of 6 joints


class EpisodeRows(NamedTuple):
    """The rows of an episode in the units of its dataset; the task is in words, "" for none."""

    file: Path
    number: int
    times: Array  # [s], shape (n,)
    action: Array  # shape (n, k)
    state: Array  # shape (n, k)
    task: str = ""


def read_lerobot(path: Path | str, options: LogOptions) -> Iterator[Recorded]:
    """Read the chosen episodes of a dataset, or of one of its files."""
    dataset = find_dataset(Path(path))
    for file, numbers in _chosen(Path(path), options.episode_numbers()):
        episodes = _read_episodes(file, numbers)
        joints = _joints(dataset, episodes[0])
        for episode in episodes:
            yield {
                joint: partial(_rows, path, options, episode, joint, *places)
                for joint, places in joints.items()
            }


def _rows(
    path: Path | str, options: LogOptions, rows: EpisodeRows, joint: str, action: int, state: int
) -> Rows:
    unit = options.unit_of(joint)
    if unit is None:
        raise InvalidFile(
            path,
            f"LeRobot does not say the unit of '{joint}'; give --unit rad, deg, range_m100_100 "
            "(LeRobot's usual -100..100), percent (its grippers' 0..100), range or ticks",
        )
    own = scale(unit, options.ticks_per_turn, partial(InvalidFile, path))
    return Rows(
        source=Source(path=rows.file, part=f"episode {rows.number}"),
        joint=joint,
        times=rows.times,
        requests=rows.action[:, action],
        angles=rows.state[:, state],
        scales=(own, own),
        episode=rows.number,
        notes=(
            f"time from '{TIME}', requested from '{ACTION}' (sent at the time of its row), "
            f"actual from '{STATE}'",
            f"angles in {own.name}, as --unit said",
        ),
    )


def lerobot_episodes(path: Path | str, options: LogOptions) -> list[tuple[Path, int | None]]:
    """Files and numbers of chosen episodes, in order; None of unreadable files without one."""
    find_dataset(Path(path))  # or the error that there is none
    files = _chosen(Path(path), options.episode_numbers())
    places = [(file, number) for file, numbers in files for number in numbers]
    return sorted(places, key=lambda each: (each[1] is None, each[1] or 0))


def _chosen(path: Path, chosen: frozenset[int] | None) -> Iterator[tuple[Path, list[int | None]]]:
    """Files and the chosen episodes in each, then InvalidFile if a chosen one is in no file."""
    files, known = [path], set[int | None]()
    if path.is_dir() and not (files := sorted(path.glob("data/chunk-*/*.parquet"))):
        raise InvalidFile(path, "no data/chunk-*/*.parquet; download the dataset's data")
    for file in files:
        match = _EPISODE.fullmatch(file.name)  # v3 names no file by its episode
        numbers: list[int | None] = [int(match[1]) if match else None]
        if not path.is_dir() or not match or chosen is None or chosen & {*numbers}:
            with suppress(InvalidFile):  # of an unreadable file, which may hold any
                numbers = [*np.unique(_episodes_in(file)).tolist()]
            if there := [each for each in numbers if chosen is None or each in {None, *chosen}]:
                yield file, there
        known.update(numbers)
    if None not in known and (missing := (chosen or frozenset()) - known):
        every = sorted(each for each in known if each is not None)
        runs = np.split(every, np.flatnonzero(np.diff(every) != 1) + 1) if every else []
        words = [f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs]
        raise InvalidFile(path, f"no episode {min(missing)}; episodes: {', '.join(words)}")


def read_episode(file: Path, number: int | None) -> EpisodeRows:
    """The rows of an episode as they are written, and its task."""
    (rows,) = _read_episodes(file, [number])
    with suppress(ValueError):  # InvalidFile, or a row without a task
        (tasks,) = _read(file, TASK, rows=_episodes_in(file) == number)
        rows = rows._replace(task=find_dataset(file).tasks().get(int(tasks[0]), ""))
    return rows


def _read_episodes(file: Path, numbers: Sequence[int | None]) -> list[EpisodeRows]:
    """These episodes of a file, in order; by one sort, as it may hold thousands."""
    places = _episodes_in(file)
    rows = np.isin(places, [each for each in numbers if each is not None])
    if not rows.any():
        raise InvalidFile(file, f"no episode {numbers[0]}; did the dataset change meanwhile?")
    times, action, state = _read(file, TIME, ACTION, STATE, rows=rows)
    episodes, counts = np.unique(places[rows], return_counts=True)
    order = np.split(np.argsort(places[rows], kind="stable"), np.cumsum(counts)[:-1])
    return [
        EpisodeRows(file, episode, times[own], action[own], state[own])
        for episode, own in zip(episodes.tolist(), order, strict=True)
    ]


def _joints(dataset: Dataset, episode: EpisodeRows) -> dict[str, tuple[int, int]]:
    """Places in the action and in the observation of every joint that both hold."""
    action, state = (
        {name: j for j, name in enumerate(dataset.names_of(key, episode))}
        for key in (ACTION, STATE)
    )
    if both := {name: (action[name], state[name]) for name in action if name in state}:
        return both
    there = f"'{ACTION}' ({', '.join(action)}) and '{STATE}' ({', '.join(state)})"
    raise InvalidFile(episode.file, f"no joint is in both {there}")


def _read(file: Path, *names: str, rows: Mask | None = None) -> list[Array]:
    """Columns of a file, NaN in empty cells: features of shape (n, width), others (n,).

    Of ``rows`` only the true ones, without the row groups that hold none of them.
    """
    with importing("reading Parquet", "parquet"):
        import pyarrow as pa
        from pyarrow import parquet
    try:
        with parquet.ParquetFile(file) as parts:
            present = parts.schema_arrow.names
            for name in names:
                problem = f"{present.count(name)} columns '{name}', expected one"
                if name not in present:
                    hint = nearest(name, present)
                    problem = f"no column '{name}'{hint}; columns: {', '.join(present)}"
                if present.count(name) != 1:
                    raise InvalidFile(file, problem)
            groups, batches, size, begin = None, list[Any](), 0, 0
            if rows is not None:
                counts = [parts.metadata.row_group(k).num_rows for k in range(parts.num_row_groups)]
                pieces = np.split(rows, np.cumsum(counts)[:-1])
                groups = [k for k, own in enumerate(pieces) if own.any()]
                rows = np.concatenate([pieces[k] for k in groups])
            # Rows are unfolded some at a time, as a small file cannot fill all of the memory. The
            # size in its description is not used: pyarrow ends the process where that is damaged.
            for batch in parts.iter_batches(8192, groups, [*names], use_threads=False):
                own = slice(begin, begin := begin + len(batch))
                batches.append(batch if rows is None else batch.filter(pa.array(rows[own])))
                size += batches[-1].nbytes
                if size > MOST_BYTES:
                    words = f"more than {MOST_BYTES >> 20} MiB of angles and times; split it"
                    raise InvalidFile(file, words)
            if not sum(map(len, batches)):
                raise InvalidFile(file, "no rows; is the file cut short?")
            return [
                _numbers(file, pa.concat_arrays([batch.column(name) for batch in batches]), name)
                for name in names
            ]
    except InvalidFile:
        raise
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        why = " ".join(str(error).split())[:120]
        words = f"not Parquet that can be read ({why}); is the file cut short?"
        raise InvalidFile(file, words) from error


def _episodes_in(file: Path) -> Indices:
    """The number of the episode of each row of a file, shape (n,), read-only."""
    try:
        written = file.stat().st_mtime_ns
        is_new = time.time_ns() - written < 1_000_000_000  # and may change in the same clock tick
        return (_numbered.__wrapped__ if is_new else _numbered)(file, written)
    except OSError as error:
        words = f"cannot be read ({reason(error)}); check the name and the folder"
        raise InvalidFile(file, words) from error


@lru_cache(maxsize=2)  # one file may hold many episodes, which are read one by one
def _numbered(file: Path, _: int) -> Indices:
    (numbers,) = _read(file, EPISODE)
    valid = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers < 10**9)
    if not valid.all():
        raise InvalidFile(file, f"'{EPISODE}': expected whole numbers from 0")
    return read_only(numbers.astype(np.intp))


@dataclass(frozen=True)
class Dataset:
    """A dataset as its meta/info.json describes it."""

    root: Path  # the folder that holds `meta` and `data`

    # names of the columns of `action` and of `observation.state`, as they are written; None where a
    # feature does not name its joints
    written: Mapping[str, tuple[str, ...] | None]
    others: tuple[str, ...] = ()  # other features, without the columns that count rows
    rate: float | None = None  # rows per second; None where the dataset does not say
    robot_type: str | None = None  # the robot, as LeRobot calls it

    def names_of(self, key: str, rows: EpisodeRows) -> tuple[str, ...]:
        """Names in a feature without ``main_`` and ``.pos``, if they stay distinct; or numbers."""
        width, names = (rows.action if key == ACTION else rows.state).shape[1], self.written[key]
        plain = tuple(name.removesuffix(".pos").removeprefix("main_") for name in names or ())
        names = plain if len(set(plain)) == len(plain) and all(plain) else names
        names = names or tuple(map(str, range(width)))
        if len(names) != width:
            named = f"but meta/info.json names {len(names)}; is the file of this dataset?"
            raise InvalidFile(rows.file, f"'{key}' has {width} numbers a row, {named}")
        return names

    @property
    def task_file(self) -> Path | None:
        """The file with the texts of its tasks; None where there is none."""
        names = ("tasks.jsonl", "tasks.parquet")
        return next((f for name in names if (f := self.root / "meta" / name).is_file()), None)

    def tasks(self) -> dict[int, str]:
        """Texts of its tasks by number: JSON up to v2.1, then Parquet; {} of an unreadable file."""
        from pyarrow import ArrowException, parquet

        file, entries = self.task_file, list[Any]()
        try:
            if file is not None and file.suffix == ".jsonl":
                entries = [
                    json.loads(line) for line in read_text(file).splitlines() if line.strip()
                ]
            elif file is not None:
                entries = parquet.read_table(file).to_pylist()
        except (OSError, ValueError, RecursionError, ArrowException):
            return {}
        words = ("task", "__index_level_0__")
        return {
            entry[TASK]: next((str(entry[key]) for key in words if key in entry), "")
            for entry in entries
            if isinstance(entry, dict) and isinstance(entry.get(TASK), int)
        }


def is_dataset(path: Path) -> bool:
    """Whether a folder is a LeRobot dataset."""
    return (path / INFO).is_file()


def find_dataset(path: Path) -> Dataset:
    """The dataset in a folder, or the one that a Parquet file belongs to."""
    places = [path] if path.is_dir() else list(path.absolute().parents)[:3]
    root = next((place for place in places if is_dataset(place)), None)
    if root is None:
        raise InvalidFile(
            path,
            "no meta/info.json, which names the joints, in the folders above; keep the file in "
            "its LeRobot dataset, or give the log as CSV",
        )
    info = read_json(root / INFO, what="a log")
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version not in (versions := ("v2.0", "v2.1", "v3.0")):
        raise InvalidFile(
            root / INFO,
            f"codebase_version: got {version!r:.20}, expected one of {', '.join(versions)}; "
            "convert the dataset with LeRobot's own scripts",
        )
    features = each if isinstance(each := info.get("features"), dict) else {}
    written: dict[str, tuple[str, ...] | None] = {}
    for key in (ACTION, STATE):
        feature = features.get(key)
        if not isinstance(feature, dict):
            keys = ", ".join(features) or "none"
            raise InvalidFile(root / INFO, f"no feature '{key}'; features: {keys}")
        flat = tuple(_flat(feature.get("names")))
        shape = feature.get("shape", [len(flat)])
        # some datasets name the axis ("motors") and not the joints on it
        written[key] = flat if flat and shape == [len(flat)] else None
    rate, robot = as_number(info.get("fps")), info.get("robot_type")
    return Dataset(
        root,
        written,
        tuple(key for key in features if key not in (ACTION, STATE, *COUNTED)),
        rate if rate > 0.0 else None,
        robot if isinstance(robot, str) else None,
    )


def _flat(names: Any) -> list[str]:
    """Names in a list, in lists within, or in an object ({"motors": [...]} or name: place)."""
    if isinstance(names, str):
        return [names]
    if isinstance(names, dict):
        if names and all(isinstance(place, int) for place in names.values()):
            return sorted(names, key=lambda name: names[name])
        names = list(names.values())
    return [name for item in names for name in _flat(item)] if isinstance(names, list) else []


def _numbers(file: Path, array: Any, name: str) -> Array:
    """Numbers of a column, of which a cell may be a list: of one, in some versions of LeRobot."""
    import pyarrow as pa
    from pyarrow import compute

    kind, values, lengths = array.type, array.drop_null(), [1]
    if pa.types.is_nested(kind) and hasattr(kind, "value_type"):
        lengths = compute.list_value_length(values).unique().to_pylist() or [0]
        values = values.flatten()
    problem = ""
    if len(lengths) > 1:
        problem = f"lists of {min(lengths)} to {max(lengths)} numbers, expected one length"
    elif lengths == [0]:
        problem = "empty in every row, expected numbers"
    elif not (pa.types.is_floating(values.type) or pa.types.is_integer(values.type)):
        problem = f"got {kind}, expected numbers"
    elif name not in (ACTION, STATE) and lengths != [1]:
        problem = f"got {lengths[0]} numbers a row, expected one"
    if problem:
        raise InvalidFile(file, f"column '{name}': {problem}")
    rows = np.full((len(array), lengths[0]), np.nan)  # a cell that is empty as a whole has none
    filled = array.is_valid().to_numpy(zero_copy_only=False)
    rows[filled] = values.to_numpy(zero_copy_only=False).reshape(-1, lengths[0])
    return rows if name in (ACTION, STATE) else rows.ravel()
