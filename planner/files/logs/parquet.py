"""Columns of numbers from Parquet files, their sizes bounded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidFile, MissingExtra
from planner.files.table import nearest
from planner.trajectory import Array

MOST_BYTES = 2**30
"""Unfolded numbers that are read from one file [bytes]: a day at 50 Hz of 30 joints."""

BATCH = 8192
"""Rows that are unfolded at a time."""


def read_columns(path: Path | str, names: Sequence[str]) -> dict[str, Array]:
    """The named columns: shape (n,), or (n, width) where a cell is a list; NaN where it is empty.

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
            _check(path, file.schema_arrow.names, names)
            batches = list(_batches(path, file, names))
        if not batches:
            raise InvalidFile(path, "no rows; is the file cut short?")
        table = pa.Table.from_batches(batches)
        return {name: _numbers(path, table.column(name), name) for name in names}
    except InvalidFile:
        raise
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InvalidFile(
            path, f"not Parquet that can be read ({reason}); is the file cut short?"
        ) from error


def _check(path: Path | str, known: Sequence[str], names: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise InvalidFile(
                path, f"no column '{name}'{nearest(name, known)}; columns: {', '.join(known)}"
            )
        if known.count(name) > 1:
            raise InvalidFile(path, f"{known.count(name)} columns '{name}', expected one")


def _batches(path: Path | str, file: Any, names: Sequence[str]) -> Iterator[Any]:
    """The rows, some at a time, so that a small file cannot unfold into all of the memory.

    What the file says of its own size is not asked: pyarrow ends the whole process where a damaged
    description cannot be understood.
    """
    size = 0
    for batch in file.iter_batches(batch_size=BATCH, columns=list(names), use_threads=False):
        size += batch.nbytes
        if size > MOST_BYTES:
            raise InvalidFile(path, f"more than {MOST_BYTES >> 20} MiB of angles; split the file")
        yield batch


def _numbers(path: Path | str, column: Any, name: str) -> Array:
    import pyarrow as pa

    array = pa.concat_arrays(column.chunks) if column.num_chunks else pa.array([], column.type)
    kind, filled = array.type, array.is_valid().to_numpy(zero_copy_only=False)
    width = None
    if pa.types.is_fixed_size_list(kind):
        width = kind.list_size
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
        lengths = np.diff(array.offsets.to_numpy(zero_copy_only=False))[filled]
        if len(set(lengths.tolist())) > 1:
            raise InvalidFile(
                path,
                f"column '{name}': lists of {lengths.min()} to {lengths.max()} numbers, "
                "expected one length",
            )
        width = int(lengths[0]) if len(lengths) else 0
    values = array if width is None else array.flatten()
    if not (pa.types.is_floating(values.type) or pa.types.is_integer(values.type)):
        raise InvalidFile(path, f"column '{name}': got {kind}, expected numbers")
    numbers: Array = values.to_numpy(zero_copy_only=False).astype(np.float64)
    if width is None:
        return numbers
    rows = np.full((len(array), width), np.nan)  # a cell that is empty as a whole has no values
    rows[filled] = numbers.reshape(-1, width)
    return rows
