"""A continuous piecewise-linear trajectory P(t): paper, Section 4.1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
        InvalidInput: The knots do not increase, or number and shape do not fit together.
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
