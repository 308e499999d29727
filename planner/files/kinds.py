"""Kinds of values in a file of settings: each says what it expects, and refuses anything else."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from planner.files.table import nearest

MOST_CHARACTERS = 1000
"""Longest text that is taken: beyond any name."""

LONGEST = 60
"""Characters of a value that a message repeats."""


class Unfit(ValueError):
    """A value that is not of its kind; the message is a hint, or empty."""


@dataclass(frozen=True)
class Kind:
    """What a key may be set to.

    Attributes:
        expected: In words: what is expected.
        take: The value as it is used; raises Unfit where it is not of this kind.
    """

    expected: str
    take: Callable[[Any], Any]


def text(expected: str = "a text") -> Kind:
    """Text that is not empty and on one line."""

    def take(value: Any) -> str:
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise Unfit
        if len(value) > MOST_CHARACTERS:
            raise Unfit(f" of at most {MOST_CHARACTERS} characters")
        return value

    return Kind(expected, take)


def source(expected: str = "the name of a file") -> Kind:
    """A file to read; its place is relative to the file that names it."""

    def take(value: Any) -> str:
        name: str = text().take(value)
        if name == "-":
            raise Unfit("; a run reads no standard input, so write it to a file first")
        return name

    return Kind(expected, take)


def written_name(*, or_none: bool = False) -> Kind:
    """A file to write inside the folder of the results; perhaps empty, for none."""

    def take(value: Any) -> str:
        if value == "" and or_none:
            return ""
        name: str = text().take(value)
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or "\\" in name or str(path) in (".", "-"):
            raise Unfit("; all that a run writes stays inside that folder")
        return str(path)

    none = ', or "" for none' if or_none else ""
    return Kind(f"the name of a file inside the folder of the results{none}", take)


def choice(*names: str) -> Kind:
    """One of some names."""

    def take(value: Any) -> str:
        if not isinstance(value, str) or value not in names:
            raise Unfit(nearest(value, names) if isinstance(value, str) else "")
        return value

    return Kind(f"one of {', '.join(names)}", take)


def flag() -> Kind:
    """True or false."""

    def take(value: Any) -> bool:
        if not isinstance(value, bool):
            raise Unfit("; without quotes" if str(value).lower() in ("true", "false") else "")
        return value

    return Kind("true or false", take)


def number(*, above: float = -math.inf, least: float = -math.inf, below: float = math.inf) -> Kind:
    """A finite number in a range."""

    def take(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise Unfit(_unquoted(value))
        try:
            given = float(value)
        except OverflowError:
            raise Unfit from None
        if not (math.isfinite(given) and least <= given and above < given < below):
            raise Unfit
        return given

    bounds = [f"above {above:g}"] if math.isfinite(above) else []
    bounds += [f"of at least {least:g}"] if math.isfinite(least) else []
    bounds += [f"below {below:g}"] if math.isfinite(below) else []
    return Kind(" ".join(["a number", " and ".join(bounds)]).strip(), take)


def whole(*, least: int, most: int) -> Kind:
    """A whole number in a range."""

    def take(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise Unfit(_unquoted(value))
        if not least <= value <= most:
            raise Unfit
        return value

    return Kind(f"a whole number from {least} to {most}", take)


def several(each: Kind, words: str, *, count: int | None = None) -> Kind:
    """A list of values of one kind."""

    def take(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list) or count not in (None, len(value)):
            raise Unfit
        return tuple(each.take(item) for item in value)

    return Kind(f"a list of {words}", take)


def span() -> Kind:
    """Two numbers, the second above the first."""
    two = several(number(), "two numbers", count=2)

    def take(value: Any) -> tuple[float, float]:
        low, high = two.take(value)
        if not low < high:
            raise Unfit
        return low, high

    return Kind("two numbers [LOW, HIGH] with LOW below HIGH", take)


def by_name(each: Kind, words: str) -> Kind:
    """An inline table from names to values of one kind."""

    def take(value: Any) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise Unfit
        return {name: each.take(item) for name, item in value.items()}

    return Kind(f"a table of {words}", take)


def described(value: Any) -> str:
    """A value as a message repeats it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, int) and abs(value) >= 10**LONGEST:
        return "a very large number"
    shown = repr(value) if isinstance(value, str | int | float | list) else str(value)
    return shown if len(shown) <= LONGEST else f"{shown[: LONGEST - 1]}…"


def _unquoted(value: Any) -> str:
    """A hint for numbers that are written as text."""
    try:
        float(value if isinstance(value, str) else "")
    except ValueError:
        return ""
    return "; without quotes"
