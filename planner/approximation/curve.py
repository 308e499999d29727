"""Continuous piecewise-linear trajectories P(t), one or many: paper, Section 4.1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar

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
)
from planner.exceptions import InvalidInput


@dataclass(frozen=True, kw_only=True, eq=False)
class _Curves(ReadOnly):
    """One curve or several over the same samples, knots along the last axis."""

    knots: Array
    values: Array
    samples: int
    tick: float
    cyclic: bool

    _stacked: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        knots, values = _reals("knots", self.knots), _reals("values", self.values)
        fewest, stacked = 1 if as_flag("cyclic", self.cyclic) else 2, self._stacked
        if values.ndim != 1 + stacked or values.shape[-1] < fewest:
            expected = f"(m, {fewest} or more)" if stacked else f"({fewest} or more,)"
            raise InvalidInput(f"values: got shape {values.shape}, expected {expected}")
        if knots.shape not in (values.shape, values.shape[stacked:]):
            others = ", or one row for all curves" if stacked else ""
            raise InvalidInput(
                f"knots: got shape {knots.shape} for values of shape {values.shape}, expected the "
                f"same{others}"
            )
        expected = f"a whole number, 1 to {MOST_SAMPLES}"
        samples = as_count("samples", self.samples, expected, most=MOST_SAMPLES)
        vars(self).update(
            knots=np.broadcast_to(read_only(knots), values.shape),
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
                row = int(np.argmin(np.all(np.atleast_2d(allowed), axis=1)))
                raise InvalidInput(
                    f"{name}: {expected}" + (f"; see curve {row}" if stacked else "")
                )

    @cached_property
    def lengths(self) -> Array:
        """Length of every segment [samples], shape (..., segments)."""
        ends = [self.knots[..., :1] + self.samples] if self.cyclic else []
        return read_only(np.diff(np.concatenate([self.knots, *ends], axis=-1)))

    @cached_property
    def slopes(self) -> Array:
        """Slope of every segment [rad/s], shape (..., segments)."""
        ends = [self.values[..., :1]] if self.cyclic else []
        rises = np.diff(np.concatenate([self.values, *ends], axis=-1))
        return read_only(rises / (self.lengths * self.tick))


@dataclass(frozen=True, kw_only=True, eq=False)
class PiecewiseLinear(_Curves):
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
        starts, since_first = self.knots - self.knots[0], index - self.knots[0]
        if self.cyclic:
            since_first = np.mod(since_first, self.samples)
        segment = np.searchsorted(starts, since_first, side="right") - 1
        segment = np.clip(segment, 0, self.segments - 1)
        return segment, since_first - starts[segment]


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveStack(_Curves):
    """Curves with the same number of knots, one a row: m times :class:`PiecewiseLinear`.

    Attributes:
        knots: Sample indices at which slopes may change, shape (m, s), or (s,) if all curves share
            them; increasing, and of cycles within one cycle.
        values: Angles at the knots [rad], shape (m, s).
        samples: Number of samples n; of cycles, their period.
        tick: Time between samples [s].
        cyclic: Whether the curves repeat themselves after ``samples``.

    Raises:
        InvalidInput: The knots of a row do not increase, a value or the tick is of no use, or
            number and shape do not fit together.
    """

    _stacked = True

    @classmethod
    def of(cls, curves: Sequence[PiecewiseLinear]) -> CurveStack:
        """Curves one by one, which must have as many knots and samples as each other.

        Raises:
            InvalidInput: They have not, or there are none.
        """
        try:
            curves = tuple(curves)
        except TypeError:
            curves = ()
        if not curves or not all(isinstance(curve, PiecewiseLinear) for curve in curves):
            raise InvalidInput("curves: got none, expected one or more, each a PiecewiseLinear")
        first = curves[0]
        common = (first.knots.size, first.samples, first.tick, first.cyclic)
        for number, curve in enumerate(curves):
            if (curve.knots.size, curve.samples, curve.tick, curve.cyclic) != common:
                raise InvalidInput(
                    f"curves: curve {number} has another number of knots or samples, another tick "
                    "or other ends than curve 0; stack those that agree"
                )
        return cls(
            knots=np.stack([curve.knots for curve in curves]),
            values=np.stack([curve.values for curve in curves]),
            samples=first.samples,
            tick=first.tick,
            cyclic=first.cyclic,
        )


def lines_in_force(
    first: npt.NDArray[np.intp], samples: int, *, cyclic: bool
) -> npt.NDArray[np.intp]:
    """Which line counts at every sample, (m, n); of several that begin at once the last.

    Lines count from samples ``first`` on, (m, s), not decreasing, of a cycle in any turn and no
    further than a cycle apart. The last line of a cycle counts until the first begins anew.
    """
    count, size = first.shape
    turn, place = np.divmod(first, samples) if cyclic else (None, np.clip(first, 0, samples))
    row = (samples + 1) * np.arange(count)[:, np.newaxis]
    begun = np.bincount((row + place).ravel(), minlength=count * (samples + 1))
    line = np.cumsum(begun.reshape(count, samples + 1)[:, :samples], axis=1)
    if turn is None:
        # The first line is in force even before it begins.
        return np.maximum(line - 1, 0)
    # Lines of an earlier turn begin at the end of this one, after all others.
    earlier = np.count_nonzero(turn == turn[:, :1], axis=1)[:, np.newaxis]
    return np.asarray((line - 1 + earlier) % size)


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
