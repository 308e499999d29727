"""Arrays and arguments, checked; measures of trajectories; answers in a few lines."""

from __future__ import annotations

import math
import operator
import textwrap
from collections.abc import Sequence
from html import escape
from reprlib import Repr
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, InvalidTrajectory

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int_]

LARGEST = 1e9
"""An angle [rad], or anything else there is one of per sample, beyond this is a mistake."""

SAME = 1e-6
"""Relative difference of two values that are equally large to a reader."""

MOST_SAMPLES = 1_000_000
"""Longest trajectory that is read, or generated from a number alone [samples]: five hours at 50 Hz.
A plan takes some 5 kB of memory for each."""

TURN = 2.0 * math.pi
"""A turn [rad]."""

MOST_TURNS = 2.0
"""A joint that does not wind stays within so many turns of zero."""

WINDING, NET = 0.25, 0.5
"""A joint that winds turns less between samples than this [turns], and at least this part of all
its motion, and of its largest angle, is in one direction."""

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


def as_trajectory(
    values: npt.ArrayLike, *, name: str, minimum: int = 2, largest: float = LARGEST
) -> Array:
    """Copy angles or requests [rad], (n,), into a read-only trajectory, float64, shape (n,).

    Raises:
        InvalidTrajectory: Not one-dimensional, fewer than ``minimum`` samples, or not finite real
            numbers up to the ``largest``.
    """
    array = _reals(values, name, "one number per request, shape (n,)", "rad")
    if array.ndim != 1:
        raise InvalidTrajectory(
            f"{name}: got shape {array.shape}, expected (n,); pass the joints one at a time"
        )
    if array.size < minimum:
        raise InvalidTrajectory(f"{name}: got {array.size} samples, expected at least {minimum}")
    return _finite(array, name, largest)


def as_path(
    values: npt.ArrayLike, *, name: str, columns: int, unit: str, largest: float = LARGEST
) -> Array:
    """Copy ``values`` [unit] of shape (n, columns), with any number of rows, like a trajectory."""
    array = _reals(values, name, f"shape (n, {columns}) [{unit}]", unit)
    if array.ndim != 2 or array.shape[1] != columns:
        hint = f"; for a single row pass [{name}]" if array.shape == (columns,) else ""
        raise InvalidTrajectory(
            f"{name}: got shape {array.shape}, expected (n, {columns}) [{unit}]{hint}"
        )
    return _finite(array, name, largest)


def _reals(values: npt.ArrayLike, name: str, expected: str, unit: str) -> npt.NDArray[Any]:
    """The values as an array of real numbers, or the error that they are none."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InvalidTrajectory(
            f"{name}: got rows of different lengths, expected {expected}"
        ) from error
    if array.dtype.kind not in "iuf":
        raise InvalidTrajectory(
            f"{name}: got an array of {array.dtype}, expected real numbers [{unit}]; "
            "convert it with numpy.asarray(..., dtype=float) and look at what fails"
        )
    if np.ma.is_masked(values):
        raise InvalidTrajectory(f"{name}: got masked samples; remove or interpolate them first")
    return array


def _finite(array: npt.NDArray[Any], name: str, largest: float) -> Array:
    """A read-only copy, float64, of samples along the first axis, finite and not too large."""
    samples = np.array(array, dtype=np.float64)
    for j, column in enumerate(samples.reshape(len(samples), -1).T if samples.size else ()):
        label = name if samples.ndim == 1 else f"{name}, column {j}"
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise InvalidTrajectory(
                f"{label}: {bad.size} of {column.size} samples are not finite, the first at index "
                f"{bad[0]} ({column[bad[0]]}); remove or interpolate them first"
            )
        k = int(np.argmax(np.abs(column)))
        if abs(column[k]) > largest:
            raise InvalidTrajectory(
                f"{label}: got {column[k]:g} at index {k}, expected at most {largest:g} either "
                "way; check the unit"
            )
    samples.setflags(write=False)
    return samples


def not_radians(angles: Array) -> bool:
    """Whether angles over time [rad], (n,), are beyond those of a joint that does not wind."""
    largest = float(np.max(np.abs(angles), initial=0.0))
    if largest <= MOST_TURNS * TURN:
        return False
    moves = np.abs(np.diff(angles))
    least = NET * max(float(np.sum(moves)), largest)
    one_way = abs(float(angles[-1] - angles[0])) >= least
    return not (one_way and float(np.max(moves, initial=0.0)) <= WINDING * TURN)


def turns_words(angle: float) -> str:
    """The error in an angle that is :func:`not_radians`, in words."""
    return (
        f"got {angle:g} rad, {abs(angle) / TURN:.1f} turns, expected at most {MOST_TURNS:g} for a "
        "joint that does not wind"
    )


def check_radians(angles: Array, *, name: str) -> None:
    """Raise InvalidTrajectory for angles [rad], (n,), that are those of degrees."""
    if not_radians(angles):
        k = int(np.argmax(np.abs(angles)))
        raise InvalidTrajectory(
            f"{name}: {turns_words(angles[k])}, at index {k}; if these are degrees, convert them "
            "with numpy.radians"
        )


def as_rows(values: npt.ArrayLike, *, name: str) -> Array:
    """Copy requests of one joint, (n,), or several, (n, k), into read-only rows [rad], (n, k)."""
    array = _reals(values, name, "one request per joint, shape (n, k)", "rad")
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.size == 0:
        raise InvalidTrajectory(
            f"{name}: got shape {np.shape(values)}, expected (n, k), a row of requests per period"
        )
    rows = _finite(array, name, LARGEST)
    if len(rows) > 1:  # a row alone is no motion
        for j, column in enumerate(rows.T):
            check_radians(column, name=f"{name}, column {j}")
    return rows


def stretches(rows: Mask) -> list[slice]:
    """Where rows follow one another without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]])))
    return [slice(first, end) for first, end in edges.reshape(-1, 2).tolist()]


def excess(values: Array, lower: npt.ArrayLike, upper: npt.ArrayLike) -> Array:
    """How far values are beyond limits, negative inside; all broadcast."""
    return np.asarray(np.maximum(np.subtract(lower, values), np.subtract(values, upper)))


def index_of_largest(values: Array) -> int:
    """The first of the values that are as large as the largest, up to rounding.

    Two samples of a symmetric motion differ in the last bits, in another way on every processor.
    """
    largest = float(np.max(values))
    return int(np.argmax(values >= largest - SAME * abs(largest)))


def steps(values: Array, *, cyclic: bool) -> Array:
    """Changes from each sample to the next along the first axis, n if ``cyclic``, else n - 1."""
    after = np.concatenate([values[1:], values[:1]]) if cyclic else values[1:]
    return np.asarray(after - values[: len(after)])


def reversals(values: Array, *, cyclic: bool) -> int:
    """How often values [rad], shape (n,), change direction, where staying changes nothing."""
    changes = steps(values, cyclic=cyclic)
    directions = np.sign(changes[np.abs(changes) > 1e-9])  # less is rounding
    if cyclic:
        directions = np.append(directions, directions[:1])
    return int(np.count_nonzero(np.diff(directions)))


def rms(values: Array) -> float:
    """Root mean square of values of any shape, in their own unit; 0 of none."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def error_norm(errors: Array, norm: Literal["rms", "max"]) -> float:
    """Root mean square of errors or distances, (n,), or the largest magnitude, in their unit."""
    return rms(errors) if norm == "rms" else float(np.max(np.abs(errors)))


NO_BOUND = 0.1
"""Share of an error up to which a lower bound counts as zero: a gap above it says nothing."""


def relative_gap(error: float, bound: float) -> float:
    """``error / bound - 1`` [-]; inf if bound <= :data:`NO_BOUND` * error; 0 if both are 0."""
    if bound > NO_BOUND * error:
        return error / bound - 1.0
    return math.inf if error > 0.0 else 0.0


LOST = 0.1
"""Share of a motion that resampling may lose without a remark [rms]."""


def most_lost(times: Array, rows: Array, at: Array, samples: Array) -> tuple[int, float] | None:
    """The column of rows (n, k) that straight lines between samples (m, k) lose most of.

    And the share of its motion that is lost (rms); None where that is within ``LOST``.
    """
    again = np.column_stack([np.interp(times, at, column) for column in samples.T])
    moved = np.std(rows, axis=0)
    missed = np.sqrt(np.mean((again - rows) ** 2, axis=0))
    worst = index_of_largest(missed - LOST * moved)
    if not missed[worst] > LOST * moved[worst]:
        return None
    return worst, float(missed[worst] / moved[worst]) if moved[worst] else math.inf


class Distance(NamedTuple):
    """How far two trajectories are apart, in their unit."""

    rms: float  # root mean square over the samples: the paper's L2
    max: float  # largest over the samples: the paper's Linf


def size(errors: Array, factor: float = 1.0) -> Distance:
    """The norms of errors or distances, of any shape, times a factor (paper, Section 5)."""
    return Distance(factor * rms(errors), factor * float(np.max(np.abs(errors))))


def without_small_reversals(angles: Array, least: float, *, cyclic: bool) -> Array:
    """The path made monotone between its deep turning points, by least squares.

    To turn back, the requests of a joint with dry friction jump from one edge of the dead band to
    the other. Along a path with noise they would do so at almost every sample, for errors that are
    small beside the dead band.

    A path (n,) of which no reversal is shallower than ``least`` [rad] is returned as it is.
    """
    from scipy.optimize import isotonic_regression  # slow to import

    first = int(np.argmax(angles)) if cyclic else 0
    turned = np.roll(angles, -first)
    if cyclic:
        turned = np.append(turned, turned[0])
    points = turning_points(turned, least)
    if not points:  # the nearest path that does not turn
        if cyclic:
            return np.full(len(angles), float(np.mean(angles)))
        both = [isotonic_regression(angles, increasing=way).x for way in (True, False)]
        return np.asarray(min(both, key=lambda path: float(np.sum((path - angles) ** 2))))
    ends = [*(sample for sample, _ in points), len(turned)]
    # Before the first turning point the path goes towards it, after each away from it.
    pieces = [(0, *points[0])]
    pieces += [(at, end, not high) for (at, high), end in zip(points, ends[1:], strict=True)]
    monotone = [
        isotonic_regression(turned[begin:end], increasing=rising).x
        for begin, end, rising in pieces
        if end > begin
    ]
    return np.roll(np.concatenate(monotone)[: len(angles)], first)


def turning_points(angles: Array, least: float) -> list[tuple[int, bool]]:
    """Where a path turns by more than ``least``: extrema with so large moves between them.

    Each is a sample, and whether it is a maximum.
    """
    points: list[tuple[int, bool]] = []
    low = high = direction = 0
    for k, angle in enumerate(angles.tolist()):
        if angle > angles[high]:
            high = k
        if angle < angles[low]:
            low = k
        if direction >= 0 and angles[high] - angle > least:
            points.append((high, True))
            direction, low = -1, k
        elif direction <= 0 and angle - angles[low] > least:
            points.append((low, False))
            direction, high = 1, k
    return points


class ReadOnly:
    """A dataclass whose arrays stay read-only when it is copied or unpickled."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __getstate__(self) -> dict[str, Any]:
        """The fields, without cached figures."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

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
