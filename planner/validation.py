"""Checks of arguments, and answers in a few lines."""

from __future__ import annotations

import math
import operator
import textwrap
from collections.abc import Sequence
from html import escape
from reprlib import Repr
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.trajectory import Array

AnyArray = TypeVar("AnyArray", bound=npt.NDArray[Any])

_SHORT = Repr()  # its own constructor takes no sizes before Python 3.12
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 3, 60, 60, 40


def shown(value: object) -> str:
    """A value in a message: on one line, and short whatever it is."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype!s:.40}, shape {value.shape}"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**40:
        return "a very large number"  # which Python may refuse to write
    return textwrap.shorten(_SHORT.repr(value), 100, placeholder=" ...")


def as_number(value: object, *, infinite: bool = False) -> float:
    """The value as a float; NaN for whatever is no finite number, or no number at all."""
    if isinstance(value, (bool, str, bytes)):
        return math.nan
    if isinstance(value, np.generic | np.ndarray) and (
        value.dtype.kind not in "iuf" or value.ndim or np.ma.isMaskedArray(value)
    ):
        return math.nan
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan
    return number if infinite or math.isfinite(number) else math.nan


def as_positive(name: str, value: object, expected: str) -> float:
    """The value as a float above 0, or InvalidInput with what was ``expected``, and its unit."""
    number = as_number(value)
    if not number > 0.0:
        raise InvalidInput(f"{name}: got {shown(value)}, expected {expected}")
    return number


def as_whole(value: object) -> int | None:
    """The value as an int; None for whatever is no whole number."""
    if isinstance(value, (bool, np.bool_)):
        return None
    try:
        return operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        return None


def as_count(
    name: str, value: object, expected: str, *, least: int = 1, most: float = math.inf
) -> int:
    """The value as an int in a range, or InvalidInput with what was ``expected``."""
    number = as_whole(value)
    if number is None or not least <= number <= most:
        raise InvalidInput(f"{name}: got {shown(value)}, expected {expected}")
    return number


def as_reals(values: Any) -> Array:
    """A new array of the values as floats, of any shape; ValueError where they are none."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"got an array of {array.dtype!s:.40}, expected real numbers")
    return np.array(array, dtype=np.float64)


def finite(value: float) -> float | None:
    """The value for JSON: None where it is not finite."""
    return value if math.isfinite(value) else None


def freeze(*arrays: npt.NDArray[Any] | None) -> None:
    """Make the arrays read-only; None is skipped."""
    for array in arrays:
        if array is not None:
            array.setflags(write=False)


def read_only(array: AnyArray) -> AnyArray:
    """The same array, closed to writing."""
    array.setflags(write=False)
    return array


class ReadOnly:
    """A value whose arrays stay read-only when it is copied or unpickled."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Freeze the copied arrays: NumPy copies are writeable."""
        vars(self).update(state)
        freeze(*(each for each in state.values() if isinstance(each, np.ndarray)))


def as_flag(name: str, value: object) -> bool:
    """The value as a bool, or InvalidInput."""
    if not isinstance(value, (bool, np.bool_)):
        raise InvalidInput(f"{name}: got {shown(value)}, expected True or False")
    return bool(value)


def check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Raise InvalidInput unless the value is one of these names."""
    if not (isinstance(value, str) and value in choices):
        expected = f"{', '.join(map(repr, choices[:-1]))} or {choices[-1]!r}"
        raise InvalidInput(f"{name}: got {shown(value)}, expected {expected}")


def is_one_of(value: object, names: Sequence[Any]) -> bool:
    """Whether the value is one of these names; an array or a list is none."""
    return isinstance(value, str) and value in names


class Summary(NamedTuple):
    """A heading in one line, and a table with a unit beside every number or title."""

    head: str
    columns: Sequence[str] = ()  # titles; that of the first may be empty
    rows: Sequence[Sequence[str]] = ()

    def text(self) -> str:
        """The table below the heading, columns aligned."""
        cells = [self.columns, *self.rows] if self.rows else []
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            for row in cells
        ]
        return "\n".join([self.head, *(line.rstrip() for line in lines)])

    def html(self) -> str:
        """The same for a notebook."""
        if not self.rows:
            return f"<p>{escape(self.head, quote=False)}</p>"
        rows = [
            "".join(f"<{tag}>{escape(cell, quote=False)}</{tag}>" for cell in row)
            for tag, row in [("th", self.columns), *(("td", row) for row in self.rows)]
        ]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<p>{escape(self.head, quote=False)}</p><table>{body}</table>"


class Summarised:
    """An answer that Python and a notebook show by its summary."""

    def _summarised(self) -> Summary:
        """The summary."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._summarised().text()

    def _repr_html_(self) -> str:
        return self._summarised().html()
