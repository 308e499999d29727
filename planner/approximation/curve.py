"""A continuous piecewise-linear trajectory P(t): paper, Section 4.1."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class PiecewiseLinear:
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
        for name in ("knots", "values"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        fewest = 1 if self.cyclic else 2
        if self.knots.ndim != 1 or self.knots.size < fewest:
            raise InvalidInput(f"knots: got shape {self.knots.shape}, expected ({fewest} or more,)")
        if self.values.shape != self.knots.shape:
            raise InvalidInput(f"values: got {self.values.size} for {self.knots.size} knots")
        if not np.all(np.isfinite(self.values)):
            raise InvalidInput("values: expected finite angles [rad]")
        if not (math.isfinite(self.tick) and self.tick > 0.0):
            raise InvalidInput(f"tick: got {self.tick!r}, expected a finite number above 0 [s]")
        if not np.all(self.lengths > 0.0):
            raise InvalidInput("knots: they must increase, and a cyclic curve's fit into one cycle")

    @property
    def segments(self) -> int:
        """Number of segments."""
        return self.knots.size if self.cyclic else self.knots.size - 1

    @cached_property
    def lengths(self) -> Array:
        """Length of every segment [samples], shape (segments,)."""
        ends = np.append(self.knots, self.knots[0] + self.samples) if self.cyclic else self.knots
        return _frozen(np.diff(ends))

    @cached_property
    def slopes(self) -> Array:
        """Slope of every segment [rad/s], shape (segments,)."""
        ends = np.append(self.values, self.values[0]) if self.cyclic else self.values
        return _frozen(np.diff(ends) / (self.lengths * self.tick))

    @cached_property
    def angles(self) -> Array:
        """The curve at the samples 0, 1, ..., n-1 [rad], shape (n,)."""
        return _frozen(np.asarray(self(np.arange(self.samples, dtype=np.float64))))

    def segment_at(self, index: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """Number of the segment that holds each index; at a knot, of the one that starts there."""
        return self._locate(np.asarray(index, dtype=np.float64))[0]

    def slope_at(self, index: npt.ArrayLike) -> Array:
        """Slope at any sample index, whole or not [rad/s]; at a knot, of the segment after."""
        slopes: Array = self.slopes[self.segment_at(index)]
        return slopes

    def __call__(self, index: npt.ArrayLike) -> Array:
        """The curve at any sample index, whole or not [rad]; an array like ``index``."""
        segment, since = self._locate(np.asarray(index, dtype=np.float64))
        before = self.values[segment]
        after = self.values[(segment + 1) % self.knots.size]
        share = since / self.lengths[segment]
        # Measured from the nearer end, so that both ends and a constant come out exactly.
        angles: Array = np.where(
            share <= 0.5,
            before + share * (after - before),
            after - (1.0 - share) * (after - before),
        )
        return angles

    def shifted(self, time: float = 0.0, *, angle: float = 0.0) -> PiecewiseLinear:
        """The curve ``time`` later [samples] and ``angle`` higher [rad]; a path keeps its samples.

        A cycle's knots come in order from the first in [0, samples) on; a path's end lines continue
        to wherever it has been shifted from.
        """
        knots, values = self.knots + time, self.values + angle
        return self._with(knots, values)

    def scaled(self, factor: float) -> PiecewiseLinear:
        """The curve with all angles, and so all slopes, times ``factor``."""
        return self._with(self.knots, self.values * factor)

    def mirrored(self, about: float = 0.0) -> PiecewiseLinear:
        """The mirror image at the angle ``about`` [rad]."""
        return self._with(self.knots, about - (self.values - about))

    def reversed_in_time(self) -> PiecewiseLinear:
        """The curve backwards: sample k becomes sample -k of a cycle, n - 1 - k of a path."""
        last = 0.0 if self.cyclic else self.samples - 1.0
        return self._with(last - self.knots[::-1], self.values[::-1])

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON: knots [samples], values [rad], samples, tick [s], cyclic."""
        return {
            "knots": self.knots.tolist(),
            "values": self.values.tolist(),
            "samples": self.samples,
            "tick": self.tick,
            "cyclic": self.cyclic,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PiecewiseLinear:
        """The curve that :meth:`to_dict` wrote, to the last digit.

        Raises:
            InvalidInput: A key is missing, or its value is of no use.
        """
        expected = ("knots", "values", "samples", "tick", "cyclic")
        missing = [key for key in expected if key not in data]
        if missing:
            raise InvalidInput(f"curve: no '{missing[0]}'; expected {', '.join(expected)}")
        try:
            return PiecewiseLinear(
                knots=np.array(data["knots"], dtype=np.float64),
                values=np.array(data["values"], dtype=np.float64),
                samples=operator.index(data["samples"]),
                tick=float(data["tick"]),
                cyclic=bool(data["cyclic"]),
            )
        except (TypeError, ValueError) as error:
            if isinstance(error, InvalidInput):
                raise
            raise InvalidInput(f"curve: {error}; expected what to_dict gives") from error

    def _with(self, knots: Array, values: Array) -> PiecewiseLinear:
        """A curve over the same samples with other knots and values, a cycle's put in order."""
        if self.cyclic:
            knots = np.mod(knots, self.samples)
            knots = np.where(knots >= self.samples, 0.0, knots)  # a hair below 0, rounded up
            order = np.argsort(knots, kind="stable")
            knots, values = knots[order], values[order]
        return PiecewiseLinear(
            knots=knots, values=values, samples=self.samples, tick=self.tick, cyclic=self.cyclic
        )

    def _locate(self, index: Array) -> tuple[npt.NDArray[np.intp], Array]:
        """Segment of each index, and how far into it the index lies [samples]."""
        if self.cyclic:
            since_first = np.mod(index - self.knots[0], self.samples)
            starts = self.knots - self.knots[0]
        else:
            since_first, starts = index - self.knots[0], self.knots - self.knots[0]
        segment = np.searchsorted(starts, since_first, side="right") - 1
        segment = np.clip(segment, 0, self.segments - 1)
        return segment, since_first - starts[segment]


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array
