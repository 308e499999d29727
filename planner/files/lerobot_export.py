"""Requests as the actions of a LeRobot dataset, version 3.0: Parquet, and JSON about it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidInput, importing
from planner.files.staging import output_folder
from planner.files.text import write_text
from planner.robot.schedule import Schedule
from planner.trajectory import Array

VERSION = "v3.0"
"""Version of the layout."""

TASK = "follow the planned requests"
"""Default task of an episode."""

PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
"""Where the layout puts tables, below the folder of their kind."""

WHOLE = 1e-3
"""A rate may be this part away from a whole number [1/s], as periods are written rounded."""

FILE_ROWS = 1_000_000
"""Rows after which the next file begins: some 100 MB, the size that LeRobot asks for."""

CHUNK_FILES = 1000
"""Files in a chunk."""

BATCH = 1000
"""Episodes whose descriptions are buffered before they are written."""

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
"""Quantiles by which some policies normalise, under LeRobot's names."""

COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")
"""Columns of every dataset that count rows."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Layout of a dataset's rows: the names of the numbers of each feature, and rows a second."""

    features: Mapping[str, Sequence[str]]
    rate: float
    robot_type: str | None = None


Figures = dict[str, Any]
"""Figures of a column by name, each of all of its numbers, shape (k,), and its number of rows."""


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

    Memory use does not grow with the number of episodes, except for their tasks. ``beside`` are
    further files by name, with their text, which the block may still add to.
    """
    with importing("a LeRobot dataset", "parquet"):
        import pyarrow  # noqa: F401
    with output_folder(path, export=f"LeRobot dataset {VERSION}") as folder:
        with ExitStack() as stack:
            writer = _Writer(folder, layout, stack)
            yield writer.add
            writer.flush()
        writer.describe()
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


class _Writer:
    """The tables of a dataset, as they grow."""

    def __init__(self, folder: Path, layout: Layout, stack: ExitStack) -> None:
        self._folder, self._layout, self._stack = folder, layout, stack
        self._tasks: dict[str, int] = {}
        self._rows = self._episodes = 0
        self._statistics: dict[str, Figures] = {}
        self._data: Any = None
        self._file, self._rows_of_file = -1, 0
        self._about: list[dict[str, Any]] = []
        self._described: Any = None

    def add(self, values: Mapping[str, Array], task: str) -> None:
        """Write an episode."""
        import pyarrow as pa

        columns = self._columns(values, task)
        data = pa.table({name: _cells(column) for name, column in columns.items()})
        if self._data is None or self._rows_of_file + len(data) > FILE_ROWS:
            if self._data is not None:
                self._data.close()
            self._file, self._rows_of_file = self._file + 1, 0
            self._data = self._writer("data", self._file, data.schema)
        self._data.write_table(data)
        statistics = {name: _statistics_of(column) for name, column in columns.items()}
        chunk, file = divmod(self._file, CHUNK_FILES)
        self._about.append(
            {
                "episode_index": self._episodes,
                "tasks": [task],
                "length": len(data),
                "data/chunk_index": chunk,
                "data/file_index": file,
                "dataset_from_index": self._rows,
                "dataset_to_index": self._rows + len(data),
                **{
                    f"stats/{name}/{figure}": numbers
                    for name, each in statistics.items()
                    for figure, numbers in _as_lists(each).items()
                },
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
            }
        )
        for name, each in statistics.items():
            total = self._statistics.get(name)
            self._statistics[name] = each if total is None else _of_both(total, each)
        self._rows += len(data)
        self._rows_of_file += len(data)
        self._episodes += 1
        if len(self._about) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write the buffered descriptions of episodes."""
        import pyarrow as pa

        if not self._about:
            return
        names = self._about[0]
        table = pa.table({name: [each[name] for each in self._about] for name in names})
        if self._described is None:
            self._described = self._writer("meta/episodes", 0, table.schema)
        self._described.write_table(table)
        self._about = []

    def describe(self) -> None:
        """Write the dataset's metadata, once all its rows are written."""
        import pyarrow as pa
        from pyarrow import parquet

        tasks = pa.table({"task_index": [*self._tasks.values()], "task": [*self._tasks]})
        with (self._folder / "meta/tasks.parquet").open("wb") as stream:
            parquet.write_table(tasks.replace_schema_metadata(_INDEXED_BY_TASK), stream)
        statistics = {name: _as_lists(each) for name, each in self._statistics.items()}
        for name, content in {"info": self._info(), "stats": statistics}.items():
            text = json.dumps(content, indent=4) + "\n"
            write_text(self._folder / "meta" / f"{name}.json", text)

    def _columns(self, values: Mapping[str, Array], task: str) -> dict[str, Any]:
        """The columns of an episode: features are (n, k), counters (n,)."""
        columns: dict[str, Any] = {
            name: np.asarray(values[name]).astype(np.float32) for name in self._layout.features
        }
        numbers = np.arange(len(next(iter(columns.values()))))
        number = self._tasks.setdefault(task, len(self._tasks))
        counted = (
            (numbers / self._layout.rate).astype(np.float32),
            numbers,
            np.full_like(numbers, self._episodes),
            numbers + self._rows,
            np.full_like(numbers, number),
        )
        return {**columns, **dict(zip(COUNTED, counted, strict=True))}

    def _writer(self, kind: str, file: int, schema: Any) -> Any:
        """A table that grows; opened here, as Arrow takes no name that is not UTF-8."""
        from pyarrow import parquet

        chunk, file = divmod(file, CHUNK_FILES)
        place = self._folder / kind / PLACE.format(chunk_index=chunk, file_index=file)
        place.parent.mkdir(parents=True, exist_ok=True)
        stream = self._stack.enter_context(place.open("wb"))
        return self._stack.enter_context(parquet.ParquetWriter(stream, schema))

    def _info(self) -> dict[str, Any]:
        features: dict[str, Any] = {
            name: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
            for name, names in self._layout.features.items()
        }
        for name in COUNTED:
            kind = "float32" if name == "timestamp" else "int64"
            features[name] = {"dtype": kind, "shape": [1], "names": None}
        return {
            "codebase_version": VERSION,
            "robot_type": self._layout.robot_type,
            "total_episodes": self._episodes,
            "total_frames": self._rows,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK_FILES,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 500,
            "fps": self._layout.rate,
            "splits": {"train": f"0:{self._episodes}"},
            "data_path": f"data/{PLACE}",
            "video_path": None,
            "features": features,
        }


def _statistics_of(column: Any) -> Figures:
    """The figures of a column, shape (n,) or (n, k)."""
    values = column.reshape(len(column), -1).astype(np.float64)
    quantiles = np.quantile(values, [*QUANTILES.values()], axis=0)
    return {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "variance": values.var(axis=0),
        **dict(zip(QUANTILES, quantiles, strict=True)),
        "count": len(values),
    }


def _of_both(first: Figures, more: Figures) -> Figures:
    """The figures of two columns, one after the other: the parallel-axis theorem.

    A quantile is the mean of theirs, weighted by rows, as in LeRobot.
    """
    count = first["count"] + more["count"]
    share, apart = more["count"] / count, more["mean"] - first["mean"]
    variance = (1.0 - share) * first["variance"] + share * more["variance"]
    return {
        "min": np.minimum(first["min"], more["min"]),
        "max": np.maximum(first["max"], more["max"]),
        "mean": first["mean"] + share * apart,
        "variance": variance + share * (1.0 - share) * apart**2,
        **{name: (1.0 - share) * first[name] + share * more[name] for name in QUANTILES},
        "count": count,
    }


def _as_lists(figures: Figures) -> dict[str, list[float]]:
    """The figures as LeRobot calls them."""
    shown = {"std" if name == "variance" else name: each for name, each in figures.items()}
    shown["std"] = np.sqrt(shown["std"])
    return {name: np.atleast_1d(each).tolist() for name, each in shown.items()}


def _cells(column: Any) -> Any:
    """A column as an Arrow array; one number a row is a plain column, as LeRobot writes it."""
    import pyarrow as pa

    if column.ndim == 1 or column.shape[1] == 1:
        return pa.array(column.ravel())
    flat = pa.array(column.ravel())
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
