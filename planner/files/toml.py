"""TOML in: tables, with the line of each key in its file."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.exceptions import InvalidFile
from planner.files.text import read_text

MOST_PARTS = 100
"""Parts of a dotted key: reading one takes memory by the square of their number."""

Place = tuple[str | int, ...]
"""Place of a value: the keys that lead to it, and the numbers of tables that repeat."""

_KEY = r"(?:\"[^\"]*\"|'[^']*'|[A-Za-z0-9_-]+)"
_DEEP = re.compile(
    r"(?<![A-Za-z0-9_-])(?:(?:\"[^\"\n]*+\"|'[^'\n]*+'|[A-Za-z0-9_-]++)[ \t]*+\.[ \t]*+)"
    rf"{{{MOST_PARTS}}}"
)
_PATH = rf"{_KEY}(?:\s*\.\s*{_KEY})*"


@dataclass(frozen=True)
class Toml:
    """A file of TOML.

    Attributes:
        path: Where it came from; ``-`` is standard input.
        text: Its text.
        content: The parsed tables.
    """

    path: str
    text: str
    content: dict[str, Any]

    def line_of(self, place: Sequence[str | int]) -> int | None:
        """Line on which a place first appears; None where its syntax is unusual."""
        keys = tuple(place)
        return next((number for number, path in _places(self.text) if path == keys), None)

    def fault(self, problem: str, place: Sequence[str | int]) -> InvalidFile:
        """The error that a place has a problem."""
        return InvalidFile(self.path, problem, line=self.line_of(place))


def read_toml(path: Path | str, *, example: str) -> Toml:
    """Read TOML, or standard input for ``-``.

    Args:
        path: The file.
        example: A line that such a file may hold, for the message about invalid TOML.

    Raises:
        InvalidFile: The file cannot be read, or is not TOML.
    """
    text = read_text(path)
    if deep := _DEEP.search(text):
        raise InvalidFile(
            path,
            f"a key of more than {MOST_PARTS} parts, expected tables and keys such as '{example}'",
            line=text.count("\n", 0, deep.start()) + 1,
        )
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        place = re.search(r" \(at line (\d+), column (\d+)\)$", str(error))
        raise InvalidFile(
            path,
            f"not TOML: {_cut(str(error), place)}; expected lines such as '{example}', and 0.1 "
            "for .1",
            line=int(place[1]) if place else None,
        ) from error
    return Toml(str(path), text, content)


def _places(text: str) -> Iterator[tuple[int, Place]]:
    """Every line that opens a table or sets a key, with the place that it names."""
    current: Place = ()
    counts: dict[Place, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if header := re.match(rf"\s*\[(\[?)\s*({_PATH})\s*\]", line):
            current = _split(header[2])
            if header[1]:
                counts[current] = counts.get(current, -1) + 1
                current = (*current, counts[current])
            yield number, current
        elif key := re.match(rf"\s*({_PATH})\s*=", line):
            yield number, (*current, *_split(key[1]))


def _split(path: str) -> Place:
    return tuple(part.strip("\"'") for part in re.findall(_KEY, path))


def _cut(message: str, place: re.Match[str] | None) -> str:
    return f"{message[: place.start()]} at column {place[2]}" if place else message
