"""Automated piecewise-linear approximation with bounded slopes: paper, Section 4.1."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from planner.approximation.choose import BARELY, automatic, within
from planner.approximation.curve import PiecewiseLinear
from planner.approximation.repair import within_slopes
from planner.approximation.search import Search
from planner.exceptions import InvalidInput, SolverFailed
from planner.trajectory import Array, as_trajectory

SLOPE_TOLERANCE = 1e-12
"""Relative excess over v_max that rounding may leave on a returned slope."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PiecewiseLinearFit(PiecewiseLinear):
    """A piecewise-linear curve and what it approximates; its errors are computed from the two.

    Attributes:
        desired: The samples that it approximates [rad], shape (n,).
        v_max: The bound that its slopes keep [rad/s].
    """

    desired: Array
    v_max: float

    @cached_property
    def residuals(self) -> Array:
        """Curve minus desired at the samples [rad], shape (n,)."""
        residuals = self.angles - self.desired
        residuals.setflags(write=False)
        return residuals

    @property
    def rms(self) -> float:
        """Root mean square error over the samples [rad]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def max_error(self) -> float:
        """Largest error at a sample [rad]."""
        return float(np.max(np.abs(self.residuals)))


def fit_pwl(
    desired: npt.ArrayLike,
    *,
    v_max: float,
    tick: float,
    cyclic: bool = True,
    segments: int | None = None,
    max_error: float | None = None,
) -> PiecewiseLinearFit:
    """Approximate ``desired`` by few straight lines that a joint of speed ``v_max`` can follow.

    The curve is continuous, closed if ``cyclic``, every slope is within ±v_max, and no segment is
    shorter than one sample; knots lie anywhere, on samples or between them. Its values are those of
    least squares at its knots, a convex QP (:mod:`planner.approximation.values`).

    The knots are sought, not proved best: shortest paths over grids of knots and of knots with
    values propose them, Newton's method moves both. Up to 16 segments every number builds on the
    one before, so that more are never worse; beyond 32, knots come from merging. Time: O(n) for
    every number up to 16, O(n log n) beyond; memory O(n). The same samples shifted, mirrored,
    reversed or scaled give the same curve.

    Args:
        desired: Angles [rad], shape (n,), n >= 3.
        v_max: Largest slope [rad/s].
        tick: Time between samples [s].
        cyclic: Whether the first sample follows the last.
        segments: Number of segments: the curve of least rms error found.
        max_error: Largest error at any sample [rad]: the fewest segments found that keep it; with
            ``segments`` too, the fewest up to that number. With neither, the fewest whose rms error
            is within 2 % of the slope-bounded ideal's, or 1 % of the range of ``desired``, or 1.1
            times the noise on it; samples that lie on a curve within the slopes give that curve.

    Returns:
        The curve, with its errors.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,).
        InvalidInput: Another argument is out of its range.
        Infeasible: No number of segments, or none up to ``segments``, keeps ``max_error``.
        SolverFailed: The QP in the values was not solved.
    """
    desired = as_trajectory(desired, name="desired", minimum=3)
    v_max, tick = _positive("v_max", v_max, "rad/s"), _positive("tick", tick, "s")
    if max_error is not None:
        max_error = _positive("max_error", max_error, "rad")
    segments = _checked_segments(segments, desired, cyclic=cyclic)
    middle = 0.5 * (float(desired.max()) + float(desired.min()))
    half_range = float(np.max(np.abs(desired - middle)))
    if half_range == 0.0:
        return _constant(desired, v_max, tick, cyclic=cyclic, segments=segments)

    search = Search((desired - middle) / half_range, v_max * tick / half_range, cyclic=cyclic)
    knots, values = _found(search, segments, max_error, half_range)
    lengths = np.diff(np.append(knots, knots[0] + desired.size) if cyclic else knots)
    values = within_slopes(middle + half_range * values, v_max * (lengths * tick), cyclic=cyclic)
    return _certified(
        PiecewiseLinearFit(
            knots=knots,
            values=values,
            samples=desired.size,
            tick=tick,
            cyclic=cyclic,
            desired=desired,
            v_max=v_max,
        ),
        max_error,
    )


def _found(
    search: Search, segments: int | None, max_error: float | None, unit: float
) -> tuple[Array, Array]:
    """Knots and values of the curve that answers the question, in the search's unit [rad]."""
    if max_error is not None:
        bound = max_error / unit
        curve = within(search, bound, segments, unit)
        return search.settled(curve, bound * (1.0 - 0.5 * BARELY))
    curve = automatic(search) if segments is None else search.curve(segments)
    return search.settled(curve, None)


def _constant(
    desired: Array, v_max: float, tick: float, *, cyclic: bool, segments: int | None
) -> PiecewiseLinearFit:
    count = 1 if segments is None else segments
    knots: Array = np.linspace(0.0, desired.size - (not cyclic), count + 1)
    if cyclic:
        knots = knots[:-1]
    return PiecewiseLinearFit(
        knots=knots,
        values=np.full(knots.size, desired[0]),
        samples=desired.size,
        tick=tick,
        cyclic=cyclic,
        desired=desired,
        v_max=v_max,
    )


def _certified(fit: PiecewiseLinearFit, max_error: float | None) -> PiecewiseLinearFit:
    """The fit, if the slopes and errors that it reports keep their bounds."""
    excess = float(np.max(np.abs(fit.slopes))) / fit.v_max - 1.0
    if not excess <= SLOPE_TOLERANCE:
        raise SolverFailed("slopes of the piecewise-linear fit", "repaired", violation=excess)
    if max_error is not None and fit.max_error > max_error * (1.0 + BARELY):
        beyond = fit.max_error - max_error
        raise SolverFailed("largest error of the piecewise-linear fit", "solved", violation=beyond)
    return fit


def _checked_segments(segments: int | None, desired: Array, *, cyclic: bool) -> int | None:
    if segments is None:
        return None
    try:
        count = operator.index(segments)
    except TypeError:
        raise InvalidInput(f"segments: got {segments!r}, expected a whole number") from None
    constant = bool(np.all(desired == desired[0]))
    fewest = 2 if cyclic and not constant else 1
    most = desired.size if cyclic else desired.size - 1
    if not fewest <= count <= most or isinstance(segments, bool):
        raise InvalidInput(
            f"segments: got {segments}, expected {fewest} to {most} for {desired.size} "
            f"{'cyclic ' if cyclic else ''}samples"
        )
    return count


def _positive(name: str, value: float, unit: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, (str, bytes, bool)) or not (math.isfinite(number) and number > 0.0):
        raise InvalidInput(f"{name}: got {value!r}, expected a finite number above 0 [{unit}]")
    return number
