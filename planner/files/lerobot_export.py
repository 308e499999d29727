"""Requests as the actions of a LeRobot dataset, version 3.0: Parquet, and JSON about it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidInput, importing
from planner.files.logs.lerobot import COUNTED
from planner.files.staging import output_folder
from planner.files.text import write_text
from planner.robot.schedule import Schedule
from planner.trajectory import Array

VERSION = "v3.0"
"""Version of the layout."""

TASK = "follow the planned requests"
"""Default task of an episode."""

FILE = "chunk-000/file-000.parquet"
"""The one file of rows, and that of episodes, below the folder of their kind."""

WHOLE = 1e-3
"""A rate may be this part away from a whole number [1/s], as periods are written rounded."""

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
"""Quantiles by which some policies normalise, under LeRobot's names."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Layout of a dataset's rows: the names of the numbers of each feature, and rows a second."""

    features: Mapping[str, Sequence[str]]
    rate: float
    robot_type: str | None = None


Figures = dict[str, Any]
"""Figures of a column under LeRobot's names, each of all of its numbers, shape (k,)."""


def write_lerobot(path: Path | str, schedule: Schedule, *, task: str = TASK) -> None:
    """Write a dataset of one episode, whose actions are the requests [rad]."""
    layout = Layout(features={"action": schedule.names}, rate=frame_rate(schedule.period))
    with lerobot_dataset(path, layout) as add:
        add({"action": schedule.requests}, task)


@contextmanager
def lerobot_dataset(
    path: Path | str, layout: Layout, *, beside: Mapping[str, str] | None = None
) -> Iterator[Callable[[Mapping[str, Array], str], None]]:
    """Write a dataset, episode by episode; the folder appears where the block does not raise.

    Of an episode that is written only its description remains in memory. ``beside`` are further
    files by name, with their text, which the block may still add to.
    """
    with importing("a LeRobot dataset", "parquet"):
        import pyarrow as pa
        from pyarrow import parquet
    tasks: dict[str, int] = {}
    episodes: list[dict[str, Any]] = []
    figures: dict[str, list[Figures]] = {}
    with output_folder(path, export=f"LeRobot dataset {VERSION}") as folder:
        for kind in ("data", "meta/episodes"):
            (folder / kind / FILE).parent.mkdir(parents=True)
        # the file is opened here, as Arrow takes no name that is not UTF-8
        with (
            (folder / "data" / FILE).open("wb") as stream,
            parquet.ParquetWriter(stream, _schema(layout)) as writer,
        ):

            def add(values: Mapping[str, Array], task: str) -> None:
                first = episodes[-1]["dataset_to_index"] if episodes else 0
                number = tasks.setdefault(task, len(tasks))
                columns = _columns(layout, values, (len(episodes), first, number))
                table = pa.table({name: _cells(column) for name, column in columns.items()})
                writer.write_table(table)
                own = {name: _figures_of(column) for name, column in columns.items()}
                for name, each in own.items():
                    figures.setdefault(name, []).append(each)
                place = {"chunk_index": 0, "file_index": 0}
                episodes.append(
                    {
                        "episode_index": len(episodes),
                        "tasks": [task],
                        "length": len(table),
                        **{f"data/{key}": value for key, value in place.items()},
                        "dataset_from_index": first,
                        "dataset_to_index": first + len(table),
                        **{
                            f"stats/{name}/{figure}": numbers.tolist()
                            for name, each in own.items()
                            for figure, numbers in each.items()
                        },
                        **{f"meta/episodes/{key}": value for key, value in place.items()},
                    }
                )

            yield add
        numbers = pa.table({"task_index": [*tasks.values()], "task": [*tasks]})
        for name, table in {
            f"episodes/{FILE}": pa.Table.from_pylist(episodes),
            "tasks.parquet": numbers.replace_schema_metadata(_INDEXED_BY_TASK),
        }.items():
            with (folder / "meta" / name).open("wb") as stream:
                parquet.write_table(table, stream)
        all_figures = {name: _of_all(each) for name, each in figures.items()}
        statistics = {
            name: {figure: numbers.tolist() for figure, numbers in each.items()}
            for name, each in all_figures.items()
        }
        info = _info(layout, len(episodes), int(all_figures["index"]["count"][0]), len(tasks))
        for name, content in {"info": info, "stats": statistics}.items():
            write_text(folder / f"meta/{name}.json", json.dumps(content, indent=4) + "\n")
        for name, text in (beside or {}).items():
            write_text(folder / name, text)


def frame_rate(period: float) -> float:
    """Rows per second: a whole number where the rate is one but for rounding."""
    rate = 1.0 / period
    whole = round(rate)
    if rate < 1.0 - WHOLE:
        raise InvalidInput(
            f"a request every {period:g} s is {rate:.6g} per second, expected at least one for "
            "LeRobot; resample to a higher rate"
        )
    return whole if abs(rate - whole) <= WHOLE * rate else float(f"{rate:.6g}")


def _schema(layout: Layout) -> Any:
    """The types of the columns; one number a row is a plain column, as LeRobot writes it."""
    import pyarrow as pa

    features = {
        name: pa.float32() if len(names) == 1 else pa.list_(pa.float32(), len(names))
        for name, names in layout.features.items()
    }
    return pa.schema(features | COUNTED)


def _columns(
    layout: Layout, values: Mapping[str, Array], numbers: tuple[int, int, int]
) -> dict[str, Any]:
    """The columns of an episode: features are (n, k), counters (n,).

    ``numbers`` are those of the episode, of its first row and of its task.
    """
    columns: dict[str, Any] = {
        name: np.asarray(values[name]).astype(np.float32) for name in layout.features
    }
    rows = np.arange(len(next(iter(columns.values()))))
    episode, first, task = numbers
    counted = (rows / layout.rate, rows, episode + 0 * rows, first + rows, task + 0 * rows)
    for (name, kind), column in zip(COUNTED.items(), counted, strict=True):
        columns[name] = column.astype(kind)
    return columns


def _info(layout: Layout, episodes: int, rows: int, tasks: int) -> dict[str, Any]:
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
        for name, names in layout.features.items()
    }
    for name, kind in COUNTED.items():
        features[name] = {"dtype": kind, "shape": [1], "names": None}
    return {
        "codebase_version": VERSION,
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
        "features": features,
    }


def _figures_of(column: Any) -> Figures:
    """The figures of a column, shape (n,) or (n, k)."""
    values = column.reshape(len(column), -1).astype(np.float64)
    return {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        **{name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()},
        "count": np.array([len(values)]),
    }


def _of_all(parts: Sequence[Figures]) -> Figures:
    """The figures of a column in several parts.

    Variances add up by the parallel-axis theorem. A quantile is the mean of theirs, weighted by
    rows, as in LeRobot.
    """
    each = {name: np.array([part[name] for part in parts]) for name in parts[0]}
    weights = each["count"] / each["count"].sum()
    mean = np.sum(weights * each["mean"], axis=0)
    variance = np.sum(weights * (each["std"] ** 2 + (each["mean"] - mean) ** 2), axis=0)
    return {
        "min": each["min"].min(axis=0),
        "max": each["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt(variance),
        **{name: np.sum(weights * each[name], axis=0) for name in QUANTILES},
        "count": each["count"].sum(axis=0),
    }


def _cells(column: Any) -> Any:
    """A column as an Arrow array."""
    import pyarrow as pa

    flat = pa.array(column.ravel())
    if len(flat) == len(column):
        return flat
    return pa.FixedSizeListArray.from_arrays(flat, column.shape[1])


_TASK_COLUMNS = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
_INDEXED_BY_TASK = {
    "pandas": json.dumps(
        {
            "index_columns": ["task"],
            "column_indexes": [],
            "columns": [
                {
                    "name": name,
                    "field_name": name,
                    "pandas_type": kind,
                    "numpy_type": numpy_type,
                    "metadata": None,
                }
                for name, kind, numpy_type in _TASK_COLUMNS
            ],
            "pandas_version": "2.0.0",
        }
    )
}
"""LeRobot reads the tasks with pandas, and looks them up in the index, which this names."""
