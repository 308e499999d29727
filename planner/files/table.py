"""CSV tables of numbers: a header line of names, then one row per sample."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.exceptions import InvalidFile, nearest
from planner.files.text import read_text, write_text
from planner.trajectory import Array

MOST_COLUMNS = 10_000
"""Columns of a table: a robot that records everything has some thousands."""

MOST_CELLS = 10_000_000
"""Cells of a table: some 70 bytes of memory each."""

DECIMALS = 12
"""Decimals that are written: beyond any sensor, and short for numbers that were short before."""

DELIMITERS = ",;\t"
"""Possible delimiters of cells."""

_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d*(?:[eE][+-]?\d+)?\s*", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where rows come from, for messages; they are counted from 0."""

    path: Path | str
    part: str = ""  # part of the file, such as "episode 3"; "" for all
    row: str = "row"  # name of a row
    # line of the file on which each row stands, counted from 1; None where it has no lines
    lines: Sequence[int] | None = None

    @property
    def name(self) -> str:
        """The source in words."""
        return f"{self.path}, {self.part}" if self.part else f"{self.path}"

    def place_of(self, k: int) -> str:
        """A row in words."""
        return f"{self.row} {k + 1}" if self.lines is None else f"line {self.lines[k]}"

    def fault(self, problem: str, k: int | None = None) -> InvalidFile:
        """The error that a row, or else the header, has a problem."""
        if self.lines is not None:
            return InvalidFile(self.path, problem, line=1 if k is None else self.lines[k])
        places = [self.part, "" if k is None else self.place_of(k)]
        place = ", ".join(filter(None, places))
        return InvalidFile(self.path, f"{place}: {problem}" if place else problem)


@dataclass(frozen=True, kw_only=True)
class Table(Source):
    """The cells of a table, not yet read as numbers; decimal commas are points."""

    names: tuple[str, ...]
    rows: Sequence[Sequence[str]]

    def numbers(self, names: Sequence[str], *, missing: bool = False) -> Array:
        """The columns as finite numbers, (n, len(names)), read-only; ``missing`` ones are NaN."""
        places = [self.place(name) for name in names]
        values = np.empty((len(self.rows), len(names)))
        for k, row in enumerate(self.rows):
            for j, place in enumerate(places):
                cell = row[place]
                if missing and cell.strip().lower() in ("", "nan"):
                    values[k, j] = math.nan
                    continue
                try:
                    number = float(cell) if cell.isascii() and "_" not in cell else math.nan
                except ValueError:
                    number = math.nan
                if not math.isfinite(number):
                    content = f"'{_shortened(cell)}'" if cell.strip() else "nothing"
                    raise self.fault(
                        f"column '{names[j]}': got {content}, expected a finite number; "
                        "remove or interpolate the sample",
                        k,
                    )
                values[k, j] = number
        values.setflags(write=False)
        return values

    def place(self, name: str) -> int:
        """Place of the named column."""
        if name not in self.names:
            raise self.fault(
                f"no column '{name}'{nearest(name, self.names)}; columns: {', '.join(self.names)}"
            )
        return self.names.index(name)


def read_table(path: Path | str) -> Table:
    """Read a CSV file with a header line, or standard input for ``-``.

    Lines that begin with ``#`` are comments; where numbers follow at once, the last of these
    lines is the header. A first line ``sep=;``, or else the commonest of
    :data:`DELIMITERS` in the header, is the delimiter. Where it is not a comma, numbers may have
    decimal commas.
    """
    text = read_text(path)
    declaration = re.match(r"sep=([,;\t])\r?\n", text)  # as spreadsheets write it
    text = _without_comments(text, declaration.end() if declaration else 0)
    first = text.lstrip().partition("\n")[0]
    delimiter = declaration[1] if declaration else max(DELIMITERS, key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    names: tuple[str, ...] = ()
    rows: list[tuple[str, ...]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            if not _is_row(cells) or (declaration and reader.line_num == 1):
                continue
            if not names:
                titles = [cell.strip() for cell in cells]
                titles = [  # as csv_text wrote them
                    each[1:] if each.startswith("'") and _is_formula(each) else each
                    for each in titles
                ]
                names = _checked_names(path, titles, reader.line_num)
                continue
            if cells[0].lstrip().startswith("#"):
                continue
            if len(cells) != len(names):
                line = reader.line_num
                cut = len(cells) < len(names) and not any(map(_is_row, reader))
                advice = "is the file cut short?" if cut else "mend the row or its commas"
                raise InvalidFile(
                    path,
                    f"got {len(cells)} {'cell' if len(cells) == 1 else 'cells'}, expected "
                    f"{len(names)} ({_shortened(', '.join(names))}); {advice}",
                    line=line,
                )
            rows.append(tuple(cells) if delimiter == "," else tuple(map(_with_point, cells)))
            lines.append(reader.line_num)
            if len(rows) * len(names) > MOST_CELLS:
                raise InvalidFile(
                    path, f"more than {MOST_CELLS} cells; split the file, or leave columns out"
                )
    except csv.Error as error:
        raise InvalidFile(
            path, f"not CSV ({error}); expected comma-separated numbers", line=reader.line_num
        ) from error
    if not names:
        raise InvalidFile(path, "empty; expected a line of column names and one row per sample")
    if len(rows) < 2:
        raise InvalidFile(
            path,
            f"rows of samples: got {len(rows)}, expected at least 2; give a row for each sample of "
            "the whole motion",
        )
    return Table(path=str(path), lines=lines, names=names, rows=rows)


def _without_comments(text: str, start: int) -> str:
    """The text with the comments above its header as empty lines: lines keep their number."""
    comments = re.compile(r"(?:[ \t]*(?:#[^\n]*)?\n)+").match(text, start)
    if comments is None or "#" not in comments[0]:
        return text
    rest = text[comments.end() :]
    lines = comments[0].split("\n")[:-1]
    last = max(k for k, line in enumerate(lines) if line.strip())
    header = lines[last].strip()
    blank = [""] * (len(lines) + 1)
    following = rest.partition("\n")[0]
    delimiter = max(DELIMITERS, key=following.count)
    cells = following.split(delimiter)
    numeric = any(_is_number(_with_point(cell)) for cell in cells)
    if numeric and len(cells) == len(header.split(delimiter)):  # a row as long as the header
        blank[last] = header[1:].strip() if header[1:2] not in DELIMITERS else header
    return text[:start] + "\n".join(blank) + rest


def write_table(path: Path | str, names: Sequence[str], values: Array) -> None:
    """Write columns, ``values`` (n, len(names)), as CSV, or to standard output for ``-``."""
    write_text(path, table_text(names, values))


def table_text(names: Sequence[str], values: Array) -> str:
    """Columns, ``values`` (n, len(names)), as CSV."""
    rounded = np.round(values, DECIMALS) + 0.0  # no negative zero
    return csv_text(names, rounded.tolist())


def csv_text(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A header and rows as CSV; every CSV file of this package is written by it.

    A spreadsheet takes a text that begins with ``=``, ``+``, ``-`` or ``@`` as a formula: such a
    text is written with an apostrophe before it, which :func:`read_table` takes off the titles.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    for row in (names, *rows):
        writer.writerow(["'" + each if _is_formula(each) else each for each in row])
    return stream.getvalue()


def _is_formula(cell: object) -> bool:
    return isinstance(cell, str) and cell.lstrip("'").startswith(("=", "+", "-", "@", "\t", "\r"))


def _is_row(cells: Sequence[str]) -> bool:
    return len(cells) > 1 or any(cell.strip() for cell in cells)


def _checked_names(path: Path | str, names: list[str], line: int) -> tuple[str, ...]:
    (name, count), problem = Counter(names).most_common(1)[0], ""
    if len(names) > MOST_COLUMNS:
        problem = (
            f"{len(names)} columns, expected at most {MOST_COLUMNS}; leave out what is not needed"
        )
    elif "" in names:
        problem = f"column {names.index('') + 1} has no name; name or remove it"
    elif all(map(_is_number, names)):
        problem = (
            f"the first line holds numbers ({_shortened(','.join(names))}), expected names; "
            "put a line of column names above them"
        )
    elif count > 1:
        problem = f"{count} columns are named '{name}', expected one; rename the others"
    if problem:
        raise InvalidFile(path, problem, line=line)
    return tuple(names)


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _shortened(text: str) -> str:
    clean = text.encode("unicode_escape").decode() if not text.isprintable() else text
    return clean if len(clean) <= 60 else f"{clean[:59]}…"
