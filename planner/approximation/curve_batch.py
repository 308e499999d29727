"""Many piecewise-linear curves over the same samples, in arrays that one pass goes through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.approximation.curve import PiecewiseLinear, checked_fields
from planner.exceptions import InvalidInput
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveStack:
    """Curves with the same number of knots, one a row; what :class:`PiecewiseLinear` is, m times.

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

    knots: Array
    values: Array
    samples: int
    tick: float
    cyclic: bool

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        for name, value in checked_fields(vars(self)).items():
            object.__setattr__(self, name, value)
        fewest = 1 if self.cyclic else 2
        if self.values.ndim != 2 or self.values.shape[1] < fewest:
            raise InvalidInput(
                f"values: got shape {self.values.shape}, expected (m, {fewest} or more)"
            )
        if self.knots.shape not in (self.values.shape, self.values.shape[1:]):
            raise InvalidInput(
                f"knots: got shape {self.knots.shape} for values of shape {self.values.shape}, "
                "expected the same, or one row for all curves"
            )
        object.__setattr__(self, "knots", np.broadcast_to(self.knots, self.values.shape))
        increasing = np.all(self.lengths > 0.0, axis=1)
        if not np.all(increasing):
            raise InvalidInput(
                f"knots: those of curve {int(np.argmin(increasing))} must increase, and a cycle's "
                "fit into one cycle"
            )

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

    @property
    def lengths(self) -> Array:
        """Length of every segment [samples], shape (m, segments)."""
        ends = self.knots
        if self.cyclic:
            ends = np.concatenate([ends, ends[:, :1] + self.samples], axis=1)
        return np.asarray(np.diff(ends, axis=1))

    @property
    def slopes(self) -> Array:
        """Slope of every segment [rad/s], shape (m, segments)."""
        ends = self.values
        if self.cyclic:
            ends = np.concatenate([ends, ends[:, :1]], axis=1)
        return np.asarray(np.diff(ends, axis=1) / (self.lengths * self.tick))
