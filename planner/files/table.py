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

from planner.arrays import Array, read_only
from planner.exceptions import InvalidFile, nearest
from planner.files.text import read_text, write_text

MOST_COLUMNS = 10_000  # columns of a table: a robot that records everything has some thousands
MOST_CELLS = 10_000_000  # cells of a table: some 70 bytes of memory each
DECIMALS = 12  # that are written: beyond any sensor, and short for numbers that were short before
DELIMITERS = ",;\t"  # possible delimiters of cells
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

    def cells(self, name: str) -> list[str]:
        """The cells of the named column, without spaces around them."""
        if name not in self.names:
            raise self.fault(
                f"no column '{name}'{nearest(name, self.names)}; columns: {', '.join(self.names)}"
            )
        place = self.names.index(name)
        return [row[place].strip() for row in self.rows]

    def only(self, columns: Sequence[str], meaning: str, advice: str) -> str | None:
        """The only one of some columns, None if there is none, or the error that it is unclear."""
        if len(columns) > 1:
            listed = ", ".join(columns)
            raise self.fault(f"{len(columns)} columns may {meaning} ({listed}); {advice}")
        return columns[0] if columns else None

    def numbers(self, names: Sequence[str], *, missing: bool = False) -> Array:
        """The columns as finite numbers, (n, len(names)), read-only; ``missing`` ones are NaN."""
        values = np.empty((len(self.rows), len(names)))
        for j, name in enumerate(names):
            cells = self.cells(name)
            values[:, j] = [_number(cell) for cell in cells]
            for k in np.flatnonzero(~np.isfinite(values[:, j])).tolist():
                if not (missing and cells[k].lower() in ("", "nan")):
                    got = f"'{_shortened(cells[k])}'" if cells[k] else "nothing"
                    words = "expected a finite number; remove or interpolate the sample"
                    raise self.fault(f"column '{name}': got {got}, {words}", k)
        return read_only(values)


def read_table(path: Path | str, *, most_rows: int = MOST_CELLS) -> Table:
    """Read a CSV file with a header line, or standard input for ``-``.

    Lines that begin with ``#`` are comments; where numbers follow at once, the last of these lines
    is the header. A first line ``sep=;``, or else the commonest of :data:`DELIMITERS` in the
    header, is the delimiter. Where it is not a comma, numbers may have decimal commas.
    """
    stream = io.StringIO(read_text(path), newline=None)
    lines = [(number, line) for number, line in enumerate(stream, 1) if not line.isspace()]
    declared = re.fullmatch(r"sep=([,;\t])\s*", lines[0][1]) if lines else None  # of spreadsheets
    content = [each for each in lines[bool(declared) :] if each[1].lstrip()[0] != "#"]
    if not content:
        raise InvalidFile(path, "empty; expected a line of column names and one row per sample")
    first, text = content[0]
    title = next((line.strip() for number, line in lines[::-1] if number < first), "")
    title = title if title[1:2] in DELIMITERS else title[1:].strip()
    delimiter = declared[1] if declared else max(DELIMITERS, key=title.count)
    cells = [_with_point(cell) for cell in text.split(delimiter)]
    if title and len(cells) == title.count(delimiter) + 1 and any(map(_is_number, cells)):
        content.insert(0, (first - 1, title))  # as long as the row of numbers
    elif not declared:
        delimiter = max(DELIMITERS, key=text.count)
    reader = csv.reader((line for _, line in content), delimiter=delimiter, strict=True)
    rows, numbers = list[tuple[str, ...]](), list[int]()
    try:
        names = _names_in(path, next(reader), content[0][0])
        most = min(most_rows, MOST_CELLS // len(names))
        for row in reader:
            numbers.append(content[reader.line_num - 1][0])
            if len(row) != len(names):
                cut = len(row) < len(names) and reader.line_num == len(content)
                advice = "is the file cut short?" if cut else "mend the row or its commas"
                if len(row) > len(names) and delimiter == ",":
                    advice += "; where these are decimal, put semicolons between cells"
                got = f"got {len(row)} {'cell' if len(row) == 1 else 'cells'}"
                expected = f"expected {len(names)} ({_shortened(', '.join(names))})"
                raise InvalidFile(path, f"{got}, {expected}; {advice}", line=numbers[-1])
            rows.append(tuple(row) if delimiter == "," else tuple(map(_with_point, row)))
            if len(rows) > most:
                advice = "split the file, leave columns out, or take fewer samples a second"
                raise InvalidFile(path, f"more than {most} rows of {len(names)} columns; {advice}")
    except csv.Error as error:
        words, line = f"not CSV ({error}); expected comma-separated numbers", reader.line_num - 1
        raise InvalidFile(path, words, line=content[line][0]) from error
    if len(names) == 1 and rows and all(map(_is_number, parts := rows[0][0].split())) and parts[1:]:
        words = "spaces between cells, expected commas, semicolons or tabs"
        raise InvalidFile(path, words, line=numbers[0])
    if len(rows) < 2:
        advice = "give a row for each sample of the whole motion"
        raise InvalidFile(path, f"rows of samples: got {len(rows)}, expected at least 2; {advice}")
    return Table(path=str(path), lines=numbers, names=names, rows=rows)


def write_table(path: Path | str, names: Sequence[str], values: Array) -> None:
    """Write columns, ``values`` (n, len(names)), as CSV, or to standard output for ``-``."""
    write_text(path, table_text(names, values))


def table_text(names: Sequence[str], values: Array) -> str:
    """Columns, ``values`` (n, len(names)), as CSV."""
    rounded = np.round(values, DECIMALS) + 0.0  # no negative zero
    return csv_text(names, rounded.tolist())


def csv_text(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A header and rows as CSV; texts that spreadsheets take as formulas get an apostrophe."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    for row in (names, *rows):
        writer.writerow(["'" + each if _is_formula(each) else each for each in row])
    return stream.getvalue()


def _is_formula(cell: object) -> bool:
    return isinstance(cell, str) and cell.lstrip("'").startswith(("=", "+", "-", "@", "\t", "\r"))


def _names_in(path: Path | str, titles: Sequence[str], line: int) -> tuple[str, ...]:
    """The names in a header, as they were before :func:`csv_text` wrote them."""
    names = [cell.strip() for cell in titles]
    names = [each[1:] if each.startswith("'") and _is_formula(each) else each for each in names]
    (name, count), problem = Counter(names).most_common(1)[0], ""
    if len(names) > MOST_COLUMNS:
        most = f"expected at most {MOST_COLUMNS}; leave out what is not needed"
        problem = f"{len(names)} columns, {most}"
    elif "" in names:
        problem = f"column {names.index('') + 1} has no name; name or remove it"
    elif all(map(_is_number, names)):
        advice = "expected names; put a line of column names above them"
        problem = f"the first line holds numbers ({_shortened(','.join(names))}), {advice}"
    elif count > 1:
        problem = f"{count} columns are named '{name}', expected one; rename the others"
    if problem:
        raise InvalidFile(path, problem, line=line)
    return tuple(names)


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def _number(cell: str) -> float:
    """The number in a cell; NaN where there is none."""
    try:
        return float(cell) if cell.isascii() and "_" not in cell else math.nan
    except ValueError:
        return math.nan


def _is_number(cell: str) -> bool:
    return cell.strip().lower() == "nan" or not math.isnan(_number(cell))


def _shortened(text: str) -> str:
    clean = text.encode("unicode_escape").decode() if not text.isprintable() else text
    return clean if len(clean) <= 60 else f"{clean[:59]}…"
