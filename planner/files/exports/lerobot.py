"""Requests as the actions of a LeRobot dataset, version 3.0: Parquet, and JSON about it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidInput, MissingExtra
from planner.files.exports.folder import export_folder
from planner.files.text import write_text
from planner.robot.schedule import Schedule

VERSION = "v3.0"
"""Of the layout."""

TASK = "follow the planned requests"
"""What the episode shows, where nobody says."""

PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
"""Where the layout puts tables, below the folder of their kind."""

WHOLE = 1e-3
"""A rate may be this part away from a whole number [1/s], as periods are written rounded."""

Columns = dict[str, Any]


def write_lerobot(path: Path | str, schedule: Schedule, *, task: str = TASK) -> None:
    """Write a dataset of one episode, whose actions are the requests [rad].

    Raises:
        MissingExtra: pyarrow is not installed.
        InvalidInput: A rate that is not a whole number, as LeRobot has it.
        InvalidFile: The folder holds something else, or cannot be written.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtra("a LeRobot dataset", "parquet") from error
    columns = action_columns(schedule)
    statistics = column_statistics(columns)
    count = len(schedule.names)
    action = pa.float32() if count == 1 else pa.list_(pa.float32(), count)
    cells = columns["action"].ravel() if count == 1 else columns["action"].tolist()
    data = pa.table({**columns, "action": pa.array(cells, type=action)})
    episode = {
        "episode_index": [0],
        "tasks": [[task]],
        "length": [len(data)],
        "data/chunk_index": [0],
        "data/file_index": [0],
        "dataset_from_index": [0],
        "dataset_to_index": [len(data)],
        **{
            f"stats/{column}/{figure}": [values]
            for column, figures in statistics.items()
            for figure, values in figures.items()
        },
        "meta/episodes/chunk_index": [0],
        "meta/episodes/file_index": [0],
    }
    tasks = pa.table({"task_index": [0], "task": [task]})
    first = PLACE.format(chunk_index=0, file_index=0)
    with export_folder(path, export=f"LeRobot dataset {VERSION}") as folder:
        for name, table in {
            f"data/{first}": data,
            f"meta/episodes/{first}": pa.table(episode),
            "meta/tasks.parquet": tasks.replace_schema_metadata(_INDEXED_BY_TASK),
        }.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(table, folder / name)
        for name, content in {"info": dataset_info(schedule), "stats": statistics}.items():
            write_text(folder / "meta" / f"{name}.json", json.dumps(content, indent=4) + "\n")


def frame_rate(schedule: Schedule) -> int:
    """Rows per second, which LeRobot counts in whole numbers.

    Raises:
        InvalidInput: They are none.
    """
    rate = 1.0 / schedule.period
    if round(rate) < 1 or abs(rate - round(rate)) > WHOLE * rate:
        raise InvalidInput(
            f"a request every {schedule.period:g} s is {rate:.6g} per second, expected a whole "
            "number for LeRobot; resample to one"
        )
    return round(rate)


def action_columns(schedule: Schedule) -> Columns:
    """The columns of the dataset: ``action`` is (n, k), the others (n,)."""
    numbers = np.arange(len(schedule.requests))
    return {
        "action": schedule.requests.astype(np.float32),
        "timestamp": (numbers / frame_rate(schedule)).astype(np.float32),
        "frame_index": numbers,
        "episode_index": np.zeros_like(numbers),
        "index": numbers,
        "task_index": np.zeros_like(numbers),
    }


def column_statistics(columns: Columns) -> dict[str, dict[str, list[float]]]:
    """Smallest, largest, mean and standard deviation of every column, and the number of rows."""
    statistics = {}
    for name, column in columns.items():
        values = column.reshape(len(column), -1).astype(np.float64)
        statistics[name] = {
            "min": values.min(axis=0).tolist(),
            "max": values.max(axis=0).tolist(),
            "mean": values.mean(axis=0).tolist(),
            "std": values.std(axis=0).tolist(),
            "count": [len(column)],
        }
    return statistics


def dataset_info(schedule: Schedule) -> dict[str, Any]:
    """``meta/info.json``: what the dataset holds and where."""
    columns = action_columns(schedule)
    features: dict[str, Any] = {
        name: {"dtype": str(column.dtype), "shape": [1], "names": None}
        for name, column in columns.items()
    }
    features["action"] |= {"shape": [len(schedule.names)], "names": list(schedule.names)}
    return {
        "codebase_version": VERSION,
        "robot_type": None,
        "total_episodes": 1,
        "total_frames": len(schedule.requests),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": frame_rate(schedule),
        "splits": {"train": "0:1"},
        "data_path": f"data/{PLACE}",
        "video_path": None,
        "features": features,
    }


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
                for name, kind, numpy_type in (
                    ("task_index", "int64", "int64"),
                    ("task", "unicode", "object"),
                )
            ],
            "pandas_version": "2.0.0",
        }
    )
}
"""LeRobot reads the tasks with pandas, and looks them up in the index, which only this tells."""
