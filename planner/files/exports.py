"""Requests of some joints at even times, at the rate and in the formats of robots."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from planner.arrays import MOST_SAMPLES, Array
from planner.exceptions import InvalidInput, MissingExtra, importing
from planner.files.columns import JOINT_UNITS, SHARES, TIME
from planner.files.logs.lerobot import COUNTED
from planner.files.paths import write_samples
from planner.files.staging import cannot_write, output_folder
from planner.files.table import DECIMALS, csv_text
from planner.files.text import write_text

if TYPE_CHECKING:
    from planner.robot.arm import Servo

# By format: the package that writes it, its name in messages, and the extra with the package.
NEEDS = {
    "yaml": ("yaml", "a trajectory as YAML", "yaml"),
    "bag": ("rosbags", "a ROS 2 bag", "bags"),
    "mcap": ("rosbags", "a ROS 2 bag", "bags"),
    "lerobot": ("pyarrow", "a LeRobot dataset", "parquet"),
}

NANOSECONDS = 10**9  # nanoseconds in a second, the resolution of ROS times
ON_TIME = 1e-6  # part of a period by which a row may be early for a request: clocks are rounded

TYPE = "trajectory_msgs/msg/JointTrajectory"  # the message's type in ROS 2
TOPIC = "/joint_trajectory_controller/joint_trajectory"  # where ros2_control's controller listens
LEROBOT_VERSION = "v3.0"  # version of the layout
LEROBOT_TASK = "follow the planned requests"  # default task of an episode

# Quantiles by which some policies normalise, under LeRobot's names.
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


class Schedule(NamedTuple):
    """Requests, one row every period, each held until the next."""

    names: tuple[str, ...]  # the joints
    requests: Array  # requests for them [rad], shape (n, k); a percent is carried as a degree
    period: float  # time between rows [s]
    units: tuple[str, ...] = ()  # as of a path; () where all are angles

    @property
    def in_shares(self) -> list[str]:
        """The joints in shares of their range."""
        return [name for name, unit in zip(self.names, self.units, strict=False) if unit in SHARES]

    def written(self, unit: str = "rad") -> tuple[list[str], Array]:
        """Titles and requests in rad, with shares of a range from 0 to 1, or in deg and percent."""
        share = "range" if unit == "rad" else "percent"
        units = [share if name in self.in_shares else unit for name in self.names]
        titles = [f"{name}_{own}" for name, own in zip(self.names, units, strict=True)]
        return titles, self.requests / [JOINT_UNITS[own] for own in units]

    @property
    def times(self) -> Array:
        """When each row is due [s], shape (n,); the first at 0."""
        return np.asarray(np.arange(len(self.requests)) * self.period, dtype=np.float64)

    @property
    def duration(self) -> float:
        """Until the last row has been held for its period [s]."""
        return len(self.requests) * self.period


def repeated(schedule: Schedule, cycles: int) -> Schedule:
    """The schedule, ``cycles`` times in a row; InvalidInput beyond :data:`.MOST_SAMPLES` rows."""
    _check_length(len(schedule.requests) * cycles, f"{cycles} cycles", "fewer cycles")
    return schedule._replace(requests=np.tile(schedule.requests, (cycles, 1)))


def resampled(schedule: Schedule, rate: float) -> Schedule:
    """The schedule as a controller with another rate sends it.

    Rows are at 0, 1/rate, 2/rate ... as long as the schedule lasts, the rate in Hz; each repeats
    the last request. A rate at which some requests would never be sent is refused.
    """
    _check_length(
        schedule.duration * rate, f"{schedule.duration:g} s at {rate:g} Hz", "a lower rate"
    )
    count = len(schedule.requests)
    # where the rows fall among the requests, in periods from the first one
    places = np.arange(max(math.ceil(schedule.duration * rate - ON_TIME), 1)) / (
        rate * schedule.period
    )
    held = np.minimum(np.floor(places + ON_TIME).astype(np.intp), count - 1)
    if skipped := count - len(np.unique(held)):
        raise InvalidInput(
            f"rate: at {rate:g} Hz {skipped} of {count} requests would never be sent, as they are "
            f"{schedule.period:g} s apart, and the joints would not move as planned; plan at this "
            f"rate (plan --rate-hz {rate:g})"
        )
    return schedule._replace(requests=schedule.requests[held], period=1.0 / rate)


def _check_length(rows: float, length: str, advice: str) -> None:
    if rows > MOST_SAMPLES:
        raise InvalidInput(
            f"{length} make {rows:.12g} rows, expected at most {MOST_SAMPLES}; ask for {advice}"
        )


def check_installed(form: str) -> None:
    """Refuse a format whose package is missing."""
    if form in NEEDS:
        package, what, extra = NEEDS[form]
        if find_spec(package) is None:
            raise MissingExtra(what, extra)


def write_controller_csv(
    path: Path | str,
    schedule: Schedule,
    *,
    unit: str = "rad",
    servos: Mapping[str, Servo] | None = None,
) -> None:
    """Write times, and by joint angles or the counts of ``servos``, which must take them."""
    if servos is None:
        write_samples(path, *schedule.written(unit), period=schedule.period)
        return
    names = [f"{name}_{unit}" for name in schedule.names]
    columns = []
    for name, requests in zip(schedule.names, schedule.requests.T, strict=True):
        servo = servos[name]
        counts = np.rint(servo.count(requests))
        least, most = (500, 2500) if unit == "us" else (0, round(servo.ticks_per_turn) - 1)
        for k in np.flatnonzero((counts < least) | (counts > most)):
            place = f"a pulse of {counts[k]:.0f} us" if unit == "us" else f"tick {counts[k]:.0f}"
            words = f"request {k}, {np.degrees(requests[k]):.2f} deg, is {place}, expected {least}"
            advice = "check the zero tick, the ticks per turn and the direction"
            raise InvalidInput(f"{name}: {words} to {most}; {advice}")
        columns.append(counts.astype(np.int64).tolist())
    times = np.round(schedule.times, DECIMALS).tolist()
    write_text(path, csv_text([TIME, *names], zip(times, *columns, strict=True)))


def joint_trajectory(schedule: Schedule, *, lead: float = 0.0) -> dict[str, Any]:
    """The message: a point per request, at its time after the lead [s], by position [rad].

    By its stamp of zero controllers begin at once, and lead the joints to the first point until
    the lead is over.
    """
    times = np.rint(schedule.times * NANOSECONDS).astype(np.int64) + round(lead * NANOSECONDS)
    positions = np.round(schedule.written()[1], DECIMALS) + 0.0  # no negative zero
    points = [
        {
            "positions": row,
            "time_from_start": {"sec": time // NANOSECONDS, "nanosec": time % NANOSECONDS},
        }
        for row, time in zip(positions.tolist(), times.tolist(), strict=True)
    ]
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(schedule.names),
        "points": points,
    }


def write_trajectory_yaml(path: Path | str, message: Mapping[str, Any]) -> None:
    """Write the message of :func:`joint_trajectory` to a file, or to standard output for ``-``."""
    with importing(*NEEDS["yaml"][1:]):
        import yaml  # with which ROS reads it, and which quotes names such as `on`
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # in C where there is one
    text = yaml.dump(
        dict(message),
        Dumper=dumper,
        default_flow_style=None,  # a line for a row of numbers
        sort_keys=False,
        allow_unicode=True,
        width=10**6,
    )
    write_text(path, text)


def write_bag(
    path: Path | str,
    message: Mapping[str, Any],
    *,
    storage: Literal["sqlite3", "mcap"] = "sqlite3",
    topic: str = TOPIC,
) -> None:
    """Write the message of :func:`joint_trajectory` as a ROS 2 bag, at time 0."""
    with importing(*NEEDS["bag"][1:]):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    store, nothing = get_typestore(Stores.ROS2_HUMBLE), np.zeros(0)
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](**message["header"]["stamp"])
    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=np.array(each["positions"]),
            velocities=nothing,
            accelerations=nothing,
            effort=nothing,
            time_from_start=types["builtin_interfaces/msg/Duration"](**each["time_from_start"]),
        )
        for each in message["points"]
    ]
    header = types["std_msgs/msg/Header"](stamp, message["header"]["frame_id"])
    content = store.serialize_cdr(types[TYPE](header, message["joint_names"], points), TYPE)
    plugin = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
    with output_folder(path, export=f"ROS 2 bag ({storage})") as folder:
        inner = folder / Path(path).resolve().name  # the writer names its files after its folder
        try:
            # version 8 is the last that ROS 2 reads before Jazzy
            with Writer(inner, version=8, storage_plugin=plugin) as writer:
                connection = writer.add_connection(topic, TYPE, typestore=store)
                writer.write(connection, 0, content)
        except sqlite3.Error as error:  # such as where the disk is full
            raise cannot_write(path, error) from error
        for file in list(inner.iterdir()):
            file.rename(folder / file.name)
        inner.rmdir()


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Layout of a dataset's rows."""

    features: Mapping[str, Sequence[str]]  # names of the numbers of each
    rate: float  # rows a second
    robot_type: str | None = None


@contextmanager
def lerobot_dataset(
    path: Path | str, layout: Layout, *, beside: Mapping[str, str] | None = None
) -> Iterator[Callable[[Mapping[str, Array], str], None]]:
    """Write a dataset by episodes, and files ``beside`` it by name, unless the block raises."""
    with importing(*NEEDS["lerobot"][1:]):
        import pyarrow as pa
        from pyarrow import parquet
    episodes: list[tuple[dict[str, Any], str]] = []

    def add(values: Mapping[str, Array], task: str) -> None:
        columns = {name: np.asarray(values[name]).astype(np.float32) for name in layout.features}
        episodes.append((columns, task))

    def cells(column: Any) -> Any:  # one number a row is a plain column, as LeRobot writes it
        numbers, (*_, width) = pa.array(column.ravel()), column.reshape(len(column), -1).shape
        return numbers if width == 1 else pa.FixedSizeListArray.from_arrays(numbers, width)

    with output_folder(path, export=f"LeRobot dataset {LEROBOT_VERSION}") as folder:
        yield add
        tasks = list(dict.fromkeys(task for _, task in episodes))
        first, about = 0, list[dict[str, Any]]()
        for number, (columns, task) in enumerate(episodes):
            rows = np.arange(len(next(iter(columns.values()))))
            numbers = (number, first + rows, tasks.index(task))
            counted = (rows / layout.rate, rows, *(0 * rows + each for each in numbers))
            for (name, kind), column in zip(COUNTED.items(), counted, strict=True):
                columns[name] = column.astype(kind)
            about.append(
                {
                    "episode_index": number,
                    "tasks": [task],
                    "length": len(rows),
                    "data/chunk_index": 0,
                    "data/file_index": 0,
                    "dataset_from_index": first,
                    "dataset_to_index": first + len(rows),
                    **{
                        f"stats/{name}/{figure}": numbers
                        for name, column in columns.items()
                        for figure, numbers in _figures_of(column).items()
                    },
                    "meta/episodes/chunk_index": 0,
                    "meta/episodes/file_index": 0,
                }
            )
            first += len(rows)
        by_number = pa.table({"task_index": range(len(tasks)), "task": tasks})
        parts = [
            pa.table({k: cells(each) for k, each in columns.items()}) for columns, _ in episodes
        ]
        for name, tables in {
            "data/chunk-000/file-000": parts,
            "meta/episodes/chunk-000/file-000": [pa.Table.from_pylist(about)],
            "meta/tasks": [by_number.replace_schema_metadata(_INDEXED_BY_TASK)],
        }.items():
            file = folder / f"{name}.parquet"
            file.parent.mkdir(parents=True, exist_ok=True)
            # opened here, as Arrow takes no name that is not UTF-8
            with (
                file.open("wb") as stream,
                parquet.ParquetWriter(stream, tables[0].schema) as writer,
            ):
                for table in tables:
                    writer.write_table(table)
        statistics = {
            name: _figures_of(np.concatenate([columns[name] for columns, _ in episodes]))
            for name in (*layout.features, *COUNTED)
        }
        info = _info(layout, len(episodes), first, len(tasks))
        for name, content in {"info": info, "stats": statistics}.items():
            write_text(folder / f"meta/{name}.json", json.dumps(content, indent=4) + "\n")
        for name, text in (beside or {}).items():
            write_text(folder / name, text)


def frame_rate(period: float) -> float:
    """Rows per second: a whole number where the rate is one but for rounding."""
    rate, near = 1.0 / period, 1e-3  # periods are written rounded
    whole = round(rate)
    if rate < 1.0 - near:
        words = "expected at least one for LeRobot; resample to a higher rate"
        raise InvalidInput(f"a request every {period:g} s is {rate:.6g} per second, {words}")
    return whole if abs(rate - whole) <= near * rate else float(f"{rate:.6g}")


def _info(layout: Layout, episodes: int, rows: int, tasks: int) -> dict[str, Any]:
    own = [(name, "float32", list(names)) for name, names in layout.features.items()]
    columns = [*own, *((name, kind, None) for name, kind in COUNTED.items())]
    return {
        "codebase_version": LEROBOT_VERSION,
        "robot_type": layout.robot_type,
        "total_episodes": episodes,
        "total_frames": rows,
        "total_tasks": tasks,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": layout.rate,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {
            name: {"dtype": kind, "shape": [len(names or [""])], "names": names}
            for name, kind, names in columns
        },
    }


def _figures_of(column: Any) -> dict[str, list[float]]:
    """The figures of a column, (n,) or (n, k), under LeRobot's names, k numbers each."""
    values = column.reshape(len(column), -1).astype(np.float64)
    figures = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        **{name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()},
        "count": np.array([len(values)]),
    }
    return {name: each.tolist() for name, each in figures.items()}


# LeRobot reads the tasks with pandas, and looks them up in the index, which this names.
_INDEXED_BY_TASK = {
    "pandas": '{"index_columns": ["task"], "column_indexes": [], "columns": ['
    '{"name": "task_index", "field_name": "task_index", "pandas_type": "int64", '
    '"numpy_type": "int64", "metadata": null}, '
    '{"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", '
    '"metadata": null}], "pandas_version": "2.0.0"}'
}
