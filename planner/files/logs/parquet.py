"""Columns of numbers from Parquet files, their sizes bounded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidFile, MissingExtra
from planner.files.table import nearest
from planner.trajectory import Array

MOST_NUMBERS = 100_000_000
"""Numbers that are read from one column: a day at 50 Hz of 23 joints."""


def read_columns(path: Path | str, names: Sequence[str]) -> dict[str, Array]:
    """The named columns: shape (n,), or (n, width) where a cell is a list.

    Raises:
        InvalidFile: Not Parquet, cut short, too long, or a column is missing or holds no numbers.
        MissingExtra: pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise MissingExtra("reading Parquet", "parquet") from error
    if not Path(path).is_file():
        raise InvalidFile(path, "no such file; check the name and the folder")
    try:
        with parquet.ParquetFile(path) as file:
            _check(path, file, names)
            if not file.metadata.num_rows:
                raise InvalidFile(path, "no rows; is the file cut short?")
            table = file.read(columns=list(names), use_threads=False)
        return {name: _numbers(path, table.column(name), name) for name in names}
    except InvalidFile:
        raise
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InvalidFile(
            path, f"not Parquet that can be read ({reason}); is the file cut short?"
        ) from error


def _check(path: Path | str, file: Any, names: Sequence[str]) -> None:
    known = file.schema_arrow.names
    for name in names:
        if name not in known:
            raise InvalidFile(
                path, f"no column '{name}'{nearest(name, known)}; columns: {', '.join(known)}"
            )
        if known.count(name) > 1:
            raise InvalidFile(path, f"{known.count(name)} columns '{name}', expected one")
    groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    for group in groups:
        for j in range(group.num_columns):
            column = group.column(j)
            if column.path_in_schema.split(".list")[0] in names and (
                column.num_values * len(groups) > MOST_NUMBERS
                and sum(other.column(j).num_values for other in groups) > MOST_NUMBERS
            ):
                raise InvalidFile(
                    path,
                    f"column '{column.path_in_schema}': more than {MOST_NUMBERS} numbers; split "
                    "the file",
                )


def _numbers(path: Path | str, column: Any, name: str) -> Array:
    import pyarrow as pa

    array = pa.concat_arrays(column.chunks) if column.num_chunks else pa.array([], column.type)
    if array.null_count:
        raise InvalidFile(path, f"column '{name}': {array.null_count} cells are empty")
    kind = array.type
    width = None
    if pa.types.is_fixed_size_list(kind):
        width = kind.list_size
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
        lengths = np.diff(array.offsets.to_numpy(zero_copy_only=False))
        if len(set(lengths.tolist())) > 1:
            raise InvalidFile(
                path,
                f"column '{name}': lists of {lengths.min()} to {lengths.max()} numbers, "
                "expected one length",
            )
        width = int(lengths[0]) if len(lengths) else 0
    values = array if width is None else array.flatten()
    if values.null_count or not (
        pa.types.is_floating(values.type) or pa.types.is_integer(values.type)
    ):
        raise InvalidFile(
            path,
            f"column '{name}': got {kind}, expected numbers"
            if not values.null_count
            else f"column '{name}': {values.null_count} numbers are missing",
        )
    numbers: Array = values.to_numpy(zero_copy_only=False).astype(np.float64)
    return numbers if width is None else numbers.reshape(len(array), width)
