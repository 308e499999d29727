"""Types of values in a file of settings, with their ranges and what a message says of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Annotated, Any, cast

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, ValidationInfo
    from pydantic_core import CoreSchema

MOST_CHARACTERS = 1000
"""Longest text that is taken: beyond any name."""


@dataclass(frozen=True)
class Range:
    """The numbers that a key takes: above ``gt``, below ``lt``, from ``ge`` to ``le``."""

    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The schema of the number, with the ends of the range."""
        schema: Any = handler(source)
        schema.update({name: end for name, end in asdict(self).items() if end is not None})
        return cast("CoreSchema", schema)


@dataclass(frozen=True)
class Expected:
    """What a value should be, where its type does not say so.

    Attributes:
        words: For messages and the reference: "the name of a file".
        check: The value to take, or ValueError with what follows these words; None takes every
            value of the type.
    """

    words: str
    check: Callable[[Any], Any] | None = None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The schema of the type, followed by the check."""
        from pydantic_core import core_schema  # too slow for --help

        schema = handler(source)
        if self.check is None:
            return schema
        return core_schema.no_info_after_validator_function(self.check, schema)


class FromList:
    """Take a list, as TOML has it, for a tuple."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The schema of the tuple, without its strictness."""
        schema: Any = handler(source)
        schema.update(strict=False)
        return cast("CoreSchema", schema)


class NoStandardInput:
    """Refuse ``-`` where no standard input is read."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The schema of the text, followed by the check."""
        from pydantic_core import core_schema  # too slow for --help

        return core_schema.with_info_after_validator_function(_is_source, handler(source))


def _is_text(value: str) -> str:
    if not value.strip() or not value.isprintable():
        raise ValueError
    if len(value) > MOST_CHARACTERS:
        raise ValueError(f" of at most {MOST_CHARACTERS} characters")
    return value


def _is_source(value: str, info: ValidationInfo) -> str:
    if value == "-" and not info.context:
        raise ValueError("; a run reads no standard input, so write it to a file first")
    return value


def _stays_inside(value: str) -> str:
    path = PurePosixPath(value)
    if path.is_absolute() or ".." in path.parts or "\\" in value or str(path) in (".", "-"):
        raise ValueError("; all that a run writes stays inside that folder")
    return str(path)


def _rises(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        raise ValueError
    return value


Text = Annotated[str, Expected("a text", _is_text)]
"""Text that is not empty and on one line."""

Source = Annotated[Text, NoStandardInput(), Expected("the name of a file")]
"""A file to read; its place is relative to the file that names it."""

Written = Annotated[
    Text, Expected("the name of a file inside the folder of the results", _stays_inside)
]
"""A file to write."""

WrittenOrNone = Annotated[
    str,
    Expected(
        'the name of a file inside the folder of the results, or "" for none',
        lambda value: value and _stays_inside(_is_text(value)),
    ),
]
"""The same, or the empty text for none."""

Span = Annotated[
    tuple[float, float],
    FromList(),
    Expected("two numbers [LOW, HIGH] with LOW below HIGH", _rises),
]
"""Smallest and largest value."""

Positive = Annotated[float, Range(gt=0.0)]
NotNegative = Annotated[float, Range(ge=0.0)]
Count = Annotated[int, Range(ge=1, le=10**6)]
