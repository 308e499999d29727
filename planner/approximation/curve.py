"""Continuous piecewise-linear trajectories P(t): paper, Section 4.1."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from planner.arrays import (
    LARGEST,
    MOST_SAMPLES,
    Array,
    ReadOnly,
    as_count,
    as_flag,
    as_positive,
    as_reals,
    read_only,
    steps,
)
from planner.exceptions import InvalidInput


@dataclass(frozen=True, kw_only=True, eq=False)
class PiecewiseLinear(ReadOnly):
    """Straight lines joined at knots, over time counted in samples.

    A cyclic curve with K knots has K segments, the last of which leads from the last knot to the
    first one of the next cycle; one knot alone is a constant. A curve with two ends and K knots has
    K - 1 segments, and the first and last of them continue beyond the ends.

    Attributes:
        knots: Sample indices at which the slope may change, shape (k,), increasing, not necessarily
            whole; cyclic, they span less than one cycle.
        values: Angles at the knots [rad], shape (k,).
        samples: Number of samples n; of a cyclic curve, its period.
        tick: Time between samples [s].
        cyclic: Whether the curve repeats itself after ``samples``.

    Raises:
        InvalidInput: The knots do not increase, a value or the tick is of no use, or number and
            shape do not fit together.
    """

    knots: Array
    values: Array
    samples: int
    tick: float
    cyclic: bool

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        knots, values = _reals("knots", self.knots), _reals("values", self.values)
        fewest = 1 if as_flag("cyclic", self.cyclic) else 2
        if values.ndim != 1 or values.size < fewest:
            raise InvalidInput(f"values: got shape {values.shape}, expected ({fewest} or more,)")
        if knots.shape != values.shape:
            raise InvalidInput(
                f"knots: got shape {knots.shape} for values of shape {values.shape}, expected the "
                "same"
            )
        expected = f"a whole number, 1 to {MOST_SAMPLES}"
        samples = as_count("samples", self.samples, expected, most=MOST_SAMPLES)
        vars(self).update(
            knots=read_only(knots),
            values=read_only(values),
            samples=samples,
            tick=as_positive("tick", self.tick, "a finite number above 0 [s]"),
            cyclic=bool(self.cyclic),
        )
        with np.errstate(invalid="ignore"):
            increasing = self.lengths > 0.0
        for name, allowed, expected in (
            ("values", np.abs(values) <= LARGEST, "expected finite angles [rad]"),
            ("knots", np.abs(knots) <= LARGEST, "expected finite sample indices that increase"),
            ("knots", increasing, "they must increase, and a cycle's fit into one cycle"),
        ):
            if not np.all(allowed):
                raise InvalidInput(f"{name}: {expected}")

    @cached_property
    def lengths(self) -> Array:
        """Length of every segment [samples], shape (segments,)."""
        ends = self.knots[:1] + self.samples if self.cyclic else np.empty(0)
        return read_only(np.diff(np.append(self.knots, ends)))

    @cached_property
    def slopes(self) -> Array:
        """Slope of every segment [rad/s], shape (segments,)."""
        rises = steps(self.values, cyclic=self.cyclic)
        return read_only(rises / (self.lengths * self.tick))

    @property
    def segments(self) -> int:
        """Number of segments."""
        return self.knots.size if self.cyclic else self.knots.size - 1

    @cached_property
    def angles(self) -> Array:
        """The curve at the samples 0, 1, ..., n-1 [rad], shape (n,)."""
        return read_only(np.asarray(self(np.arange(self.samples, dtype=np.float64))))

    def slope_at(self, index: npt.ArrayLike) -> Array:
        """Slope at any sample index, whole or not [rad/s]; at a knot, of the segment after."""
        return read_only(np.asarray(self.slopes[self._locate(_places(index))[0]]))

    def __call__(self, index: npt.ArrayLike) -> Array:
        """The curve at any sample index, whole or not [rad]; an array like ``index``."""
        segment, since = self._locate(_places(index))
        before = self.values[segment]
        after = self.values[(segment + 1) % self.knots.size]
        share = since / self.lengths[segment]
        # Measured from the nearer end, so that both ends and a constant come out exactly.
        angles: Array = np.where(
            share <= 0.5,
            before + share * (after - before),
            after - (1.0 - share) * (after - before),
        )
        return read_only(angles)

    def to_dict(self) -> dict[str, Any]:
        """The arguments that make the curve again, as plain data for JSON."""
        values = {each.name: getattr(self, each.name) for each in fields(PiecewiseLinear)}
        return values | {name: values[name].tolist() for name in ("knots", "values")}

    def _locate(self, index: Array) -> tuple[npt.NDArray[np.intp], Array]:
        """Segment of each index, and how far into it the index lies [samples]."""
        period = self.samples if self.cyclic else None
        return lines_in_force(self.knots[: self.segments], index, period)


def lines_in_force(
    starts: Array, index: Array, period: int | None
) -> tuple[npt.NDArray[np.intp], Array]:
    """Which line is in force at each index, and since when [samples].

    Of several that start at once it is the last, and before all the first; with a ``period`` the
    last one ends where the first starts anew.
    """
    since_first = index - starts[0]
    if period is not None:
        since_first = np.mod(since_first, period)
    line = np.searchsorted(starts - starts[0], since_first, side="right") - 1
    line = np.maximum(line, 0)
    return line, since_first - (starts - starts[0])[line]


def _reals(name: str, values: Any) -> Array:
    """The values as a new array, or an error."""
    try:
        return as_reals(values)
    except ValueError as error:
        raise InvalidInput(f"{name}: {error}; expected an array of numbers") from error


def _places(index: npt.ArrayLike) -> Array:
    """Sample indices as finite floats, of any shape, or an error."""
    places = _reals("index", index)
    if not np.all(np.isfinite(places)):
        raise InvalidInput("index: expected finite sample indices")
    return places
