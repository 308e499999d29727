"""Columns of numbers from Parquet files, their sizes bounded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidFile, importing, nearest
from planner.trajectory import Array

MOST_NUMBERS = 2**25
"""Unfolded numbers of one file: 22 hours at 30 Hz of 6 joints, 256 MiB."""

BATCH = 8192
"""Rows that are unfolded at a time."""


def read_columns(path: Path | str, names: Sequence[str]) -> dict[str, Array]:
    """The named columns: shape (n,), or (n, width) where a cell is a list; NaN where it is empty.

    Raises:
        InvalidFile: Not Parquet, cut short, too long, or a column is missing or holds no numbers.
        MissingExtra: pyarrow is not installed.
    """
    with importing("reading Parquet", "parquet"):
        import pyarrow as pa
        from pyarrow import parquet
    if not Path(path).is_file():
        raise InvalidFile(path, "no such file; check the name and the folder")
    try:
        with parquet.ParquetFile(path) as file:
            _check(path, file.schema_arrow.names, names)
            return _columns(path, file, names)
    except InvalidFile:
        raise
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InvalidFile(
            path, f"not Parquet that can be read ({reason}); is the file cut short?"
        ) from error


def _check(path: Path | str, columns: Sequence[str], names: Sequence[str]) -> None:
    for name in names:
        if name not in columns:
            raise InvalidFile(
                path, f"no column '{name}'{nearest(name, columns)}; columns: {', '.join(columns)}"
            )
        if columns.count(name) > 1:
            raise InvalidFile(path, f"{columns.count(name)} columns '{name}', expected one")


def _columns(path: Path | str, file: Any, names: Sequence[str]) -> dict[str, Array]:
    """The columns, unfolded some rows at a time: a small file cannot fill all of the memory.

    The size in the file's own description is not used: pyarrow ends the whole process where a
    description is damaged.
    """
    pieces: dict[str, list[Array]] = {name: [] for name in names}
    size = 0
    for batch in file.iter_batches(batch_size=BATCH, columns=list(names), use_threads=False):
        for name in names:
            numbers = _numbers(path, batch.column(name), name)
            pieces[name].append(numbers)
            size += numbers.size
        if size > MOST_NUMBERS:
            raise InvalidFile(
                path, f"more than {MOST_NUMBERS} numbers of angles and times; split the file"
            )
    if not size:
        raise InvalidFile(path, "no rows; is the file cut short?")
    return {name: _joined(path, pieces.pop(name), name) for name in names}


def _joined(path: Path | str, pieces: Sequence[Array], name: str) -> Array:
    """Pieces of a column, joined; pieces without any list are NaN."""
    widths = {piece.shape[1] for piece in pieces if piece.ndim == 2} - {0}
    if len(widths) > 1:
        raise _uneven(path, name, min(widths), max(widths))
    (width,) = widths or {0}
    return np.concatenate(
        [
            np.full((len(piece), width), np.nan) if piece.shape[1:] == (0,) else piece
            for piece in pieces
        ]
    )


def _uneven(path: Path | str, name: str, least: int, most: int) -> InvalidFile:
    return InvalidFile(
        path, f"column '{name}': lists of {least} to {most} numbers, expected one length"
    )


def _numbers(path: Path | str, array: Any, name: str) -> Array:
    """Numbers of a piece of a column, shape (n,), or (n, width) where a cell is a list."""
    import pyarrow as pa

    kind, filled = array.type, array.is_valid().to_numpy(zero_copy_only=False)
    width = None
    if pa.types.is_fixed_size_list(kind):
        width = kind.list_size
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
        lengths = np.diff(array.offsets.to_numpy(zero_copy_only=False))[filled]
        if len(set(lengths.tolist())) > 1:
            raise _uneven(path, name, lengths.min(), lengths.max())
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
