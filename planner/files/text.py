"""Text, JSON and TOML: files or, as ``-``, the standard streams; written whole or not at all."""

from __future__ import annotations

import json
import math
import operator
import re
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from planner.exceptions import InvalidFile
from planner.files.staging import cannot_write, reason, staged

MOST_BYTES = 64 * 2**20  # longest text that is read: twice a million requests for three joints
STANDARD_STREAM = "-"  # the name of standard input and standard output
MOST_PARTS = 100  # parts of a dotted key: reading one takes memory by the square of their number


def read_text(path: Path | str) -> str:
    """Whole text of a file, or of standard input for ``-``; UTF-8, with or without a mark."""
    if not str(path):
        raise InvalidFile("''", "is no name of a file; name one, or - for standard input")
    if str(path) == STANDARD_STREAM and sys.stdin is None:
        raise InvalidFile(path, "standard input is closed; give it a file or a pipe")
    try:
        if str(path) == STANDARD_STREAM:
            content = sys.stdin.buffer.read(MOST_BYTES + 1)
        else:
            with Path(path).open("rb") as stream:
                content = stream.read(MOST_BYTES + 1)
    except FileNotFoundError as error:
        raise InvalidFile(path, "no such file; check the name and the folder") from error
    except (OSError, ValueError) as error:  # a name with a null byte is no name
        words = f"cannot be read ({reason(error)}); expected a text file"
        raise InvalidFile(path, words) from error
    if len(content) > MOST_BYTES:
        raise InvalidFile(path, f"longer than {MOST_BYTES >> 20} MiB; is it the right file?")
    if content.startswith((b"PK\3\4", b"\xd0\xcf\x11\xe0")):  # of .xlsx and .ods, and of .xls
        raise InvalidFile(path, "a spreadsheet or an archive, expected text; save it as CSV")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        words = f"byte 0x{content[error.start]:02x} is not UTF-8; save the file as UTF-8 text"
        raise InvalidFile(path, words, line=line) from error


def read_json(path: Path | str, *, what: str) -> Any:
    """The content of a JSON file; NaN and infinities are read too, as Python writes them."""
    text = read_text(path)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        words = f"not JSON ({error.msg}); is the file cut short?"
        raise InvalidFile(path, words, line=error.lineno) from error
    except (RecursionError, ValueError) as error:  # or an integer of thousands of digits
        deep = isinstance(error, RecursionError)
        words = f"not JSON of {what}: {'nested too deeply' if deep else 'a number is too long'}"
        raise InvalidFile(path, words) from error


def write_text(path: Path | str, text: str) -> None:
    """Write ``text`` to a file, whole or not at all, or to standard output for ``-``."""
    if str(path) != STANDARD_STREAM:
        write_bytes(path, text.encode())
        return
    if sys.stdout is None:
        raise InvalidFile(STANDARD_STREAM, "standard output is closed; name a file for the output")
    try:
        # where Python does not buffer the output, the rest of a longer text is lost silently when
        # its reader goes away
        chunk = 2**15
        for start in range(0, len(text), chunk):
            sys.stdout.write(text[start : start + chunk])
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise cannot_write(STANDARD_STREAM, error) from error


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write ``content`` to a file, whole or not at all; see :func:`write_text`."""
    with staged(path, content):
        pass


def to_json(content: Mapping[str, Any]) -> str:
    """JSON text; numbers that are not finite, which JSON has not, become null."""
    # an array is known by its method, without NumPy's time to import
    text = json.dumps(content, default=lambda array: array.tolist())
    finite = json.loads(text, parse_constant=lambda _: None)
    return json.dumps(finite, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


# Place of a value: the keys that lead to it, and the numbers of tables that repeat.
Place = tuple[str | int, ...]
_KEY = r"(?:\"[^\"]*\"|'[^']*'|[A-Za-z0-9_-]+)"
_DEEP = re.compile(
    r"(?<![A-Za-z0-9_-])(?:(?:\"[^\"\n]*+\"|'[^'\n]*+'|[A-Za-z0-9_-]++)[ \t]*+\.[ \t]*+)"
    rf"{{{MOST_PARTS}}}"
)
_PATH = rf"{_KEY}(?:\s*\.\s*{_KEY})*"


@dataclass(frozen=True)
class Toml:
    """A file of TOML: its text, and its tables."""

    path: str
    text: str
    content: dict[str, Any]

    def line_of(self, place: Sequence[str | int]) -> int | None:
        """Line on which a place first appears; None where its syntax is unusual."""
        keys = tuple(place)
        return next((number for number, path in _places(self.text) if path == keys), None)

    def fault(self, problem: object, table: Sequence[str] = (), key: str = "") -> InvalidFile:
        """The error that a table, or a key of it, has a problem."""
        within = f"[{'.'.join(table)}]: " if table else ""
        line = self.line_of((*table, key)) or self.line_of(table)
        return InvalidFile(self.path, f"{within}{problem}", line=line)


def read_toml(path: Path | str, *, example: str) -> Toml:
    """Read TOML, or standard input for ``-``; the error message shows the ``example``."""
    text = read_text(path)
    if deep := _DEEP.search(text):
        words = f"a key of more than {MOST_PARTS} parts, expected tables and keys such as"
        line = text.count("\n", 0, deep.start()) + 1
        raise InvalidFile(path, f"{words} '{example}'", line=line)
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        place = re.search(r" \(at line (\d+), column (\d+)\)$", str(error))
        words = f"{str(error)[: place.start()]} at column {place[2]}" if place else str(error)
        expected = f"expected lines such as '{example}', and 0.1 for .1"
        number = int(place[1]) if place else None
        raise InvalidFile(path, f"not TOML: {words}; {expected}", line=number) from error
    return Toml(str(path), text, content)


def _places(text: str) -> Iterator[tuple[int, Place]]:
    """Every line that opens a table or sets a key, with the place that it names."""
    current: Place = ()
    counts: dict[Place, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(rf"\s*\[(\[?)\s*({_PATH})\s*\]", line)
        key = re.match(rf"\s*({_PATH})\s*=", line)
        path = header[2] if header else key[1] if key else ""
        parts = tuple(part.strip("\"'") for part in re.findall(_KEY, path))
        if header:
            current = parts
            if header[1]:
                counts[current] = counts.get(current, -1) + 1
                current = (*current, counts[current])
            yield number, current
        elif key:
            yield number, (*current, *parts)


def key_name(place: Sequence[str | int]) -> str:
    """A place in words: ``plan.method``, ``export[0].file``."""
    name = ""
    for part in place:
        if isinstance(part, int):
            name += f"[{part}]"
        else:
            plain = re.fullmatch(r"[A-Za-z0-9_-]+", part)
            name += ("." if name else "") + (part if plain else toml_value(part))
    return name


def place_of(name: str) -> Place:
    """The place of a name by :func:`key_name`."""
    parts = re.findall(r'\[(\d+)\]|("(?:[^"\\]|\\.)*")|([^.\[]+)', name)
    return tuple(
        int(number) if number else json.loads(quoted) if quoted else key
        for number, quoted, key in parts
    )


# The kinds of values.


class Expected(NamedTuple):
    """The expected value of a key in words, where its type is not enough, and a check of it."""

    words: str
    check: Callable[[Any], Any] = lambda value: value  # or ValueError with more words
    choices: tuple[str, ...] = ()  # some of the values


def within(words: str = "", **ends: float) -> Expected:
    """Numbers above ``gt``, below ``lt``, from ``ge`` to ``le``: whole ones, or as in ``words``."""

    def check(number: float) -> float:
        if not all(getattr(operator, name)(number, end) for name, end in ends.items()):
            raise ValueError
        return number

    texts = {"gt": "above", "ge": "of at least", "lt": "below"}
    bounds = " and ".join(f"{texts[name]} {end:g}" for name, end in ends.items() if name in texts)
    if "le" in ends:
        return Expected(words or f"a whole number from {ends['ge']} to {ends['le']}", check)
    return Expected(words or f"a number {bounds}", check)


class Kind:
    """The type of a value in TOML, and what its annotations expect of it."""

    def __init__(self, annotation: Any) -> None:
        self.notes, self.optional = tuple[Expected, ...](), False  # notes: the innermost first
        self.parser: Any = None  # of the text of an option: a type of click
        while (origin := get_origin(annotation)) in (Annotated, Union, UnionType):
            annotation, *more = get_args(annotation)
            self.notes = (*(each for each in more if isinstance(each, Expected)), *self.notes)
            self.optional = self.optional or NoneType in more
            others = (each for each in more if not isinstance(each, Expected | type))
            self.parser = next(others, self.parser)
        # the type without None and annotations; its origin is Literal, tuple, dict, or None
        self.type, self.origin, self.inner = annotation, origin, get_args(annotation)
        self.count = None if ... in self.inner else len(self.inner)  # of a tuple; None for any
        self.choices: tuple[str, ...] = sum((note.choices for note in self.notes), ())
        words = "true or false" if annotation is bool else "a number"
        if origin is Literal:
            self.choices, words = self.inner, f"one of {', '.join(self.inner)}"
        else:
            self.inner = tuple(Kind(each) for each in self.inner if each is not ...)
        self.expected = [words, *(note.words for note in self.notes)][-1]
        # a table of settings, one that may stand there several times, or one of values by any name
        self.is_table = origin is None and annotation not in (bool, int, float, str)
        self.is_repeated = origin is tuple and self.inner[0].is_table
        self.is_free = origin is dict and not self.notes

    def fitted(self, value: Any) -> Any:
        """A value of this kind; ValueError, perhaps with a hint, if it does not fit."""
        if self.origin is tuple and isinstance(value, list | tuple):
            if self.count not in (None, len(value)):
                raise ValueError
            pairs = zip(cycle(self.inner), value, strict=False)
            value = tuple(kind.fitted(each) for kind, each in pairs)
        elif self.origin is dict and isinstance(value, Mapping):
            value = {name: self.inner[1].fitted(each) for name, each in value.items()}
        elif self.type is float:
            if type(value) not in (int, float) or not math.isfinite(value):
                raise ValueError
            value = float(value)
        elif not (value in self.inner if self.origin is Literal else type(value) is self.type):
            raise ValueError
        for note in self.notes:
            value = note.check(value)
        return value


def toml_value(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{key_name((key,))} = {toml_value(each)}" for key, each in value.items())
        return f"{{{pairs}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_value(each) for each in value)}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
