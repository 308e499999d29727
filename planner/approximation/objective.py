"""The squared error of a piecewise-linear curve, and its derivatives by knots and values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """What to approximate, in a unit of its own.

    Attributes:
        desired: Samples, shape (n,).
        step: Largest change per sample.
        cyclic: Whether the first sample follows the last.
        weights: Weight of every sample's squared error, mean 1, shape (n,); by default all 1.
        shortest: Length of the shortest segment [samples].
        required: Where there must be a knot [samples], shape (r,), increasing.
        pins: The curve's values there, shape (r,); NaN where it is free.
        whole: Whether knots lie on samples.
    """

    desired: Array
    step: float
    cyclic: bool
    weights: Array = None  # type: ignore[assignment]
    shortest: float = 1.0
    required: Array = field(default_factory=lambda: np.zeros(0))
    pins: Array = field(default_factory=lambda: np.zeros(0))
    whole: bool = False

    def __post_init__(self) -> None:
        """Weigh all samples alike unless told otherwise."""
        if self.weights is None:
            object.__setattr__(self, "weights", np.ones(self.desired.size))

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return self.desired.size

    @property
    def anywhere(self) -> bool:
        """Whether knots may lie anywhere, a sample or more apart."""
        return not self.whole and self.shortest <= 1.0 and not self.required.size


class Candidate(NamedTuple):
    """A curve that is being considered, and its squared error."""

    knots: Array  # (K,)
    values: Array  # (K,)
    error: float


def candidate(problem: Problem, knots: Array, values: Array) -> Candidate:
    """A curve with its squared error; O(n + K)."""
    residual = residuals(problem, knots, values)
    return Candidate(knots, values, float(residual @ (problem.weights * residual)))


def residuals(problem: Problem, knots: Array, values: Array) -> Array:
    """Curve minus samples, shape (n,)."""
    index = np.arange(problem.samples, dtype=np.float64)
    period = problem.samples if problem.cyclic else None
    return np.interp(index, knots, values, period=period) - problem.desired


class Iterate(NamedTuple):
    """Knots and values, their squared error and its derivatives.

    The variables are ordered knots first: (k_0, ..., k_{K-1}, y_0, ..., y_{K-1}).
    """

    knots: Array  # (K,)
    values: Array  # (K,)
    error: float
    gradient: Array  # (2K,), of half the squared error
    hessian: Array  # (2K, 2K), of half the squared error
    gauss_newton: Array  # (2K,), diagonal of the Hessian without the residuals' part


@lru_cache(maxsize=256)
def constraint_rows(size: int, step: float, *, cyclic: bool) -> Array:
    """Rows A such that a step p of knots and values is allowed if A p <= the slacks.

    The bound on a slope, |y' - y| <= v (k' - k), is linear in knots and values together, so the
    rows are the same for all knots and values.

    Args:
        size: Number of knots K.
        step: Largest change per sample v.
        cyclic: Whether a last segment leads from the last knot to the first.

    Returns:
        A, shape (3S, 2K) for S segments, read-only: no slope too high, none too low, no segment
        too short.
    """
    start, end = segment_ends(size, cyclic=cyclic)
    identity = np.eye(size)
    difference = identity[end] - identity[start]
    reach = step * difference
    rows = np.block(
        [[-reach, difference], [-reach, -difference], [-difference, np.zeros_like(difference)]]
    )
    rows.setflags(write=False)
    return rows


def slacks(problem: Problem, knots: Array, values: Array) -> Array:
    """How far slopes and lengths are from their bounds, in the order of the rows, shape (3S,)."""
    start, end = segment_ends(knots.size, cyclic=problem.cyclic)
    length = knots[end] - knots[start]
    if problem.cyclic:
        length[-1] += problem.samples
    rise = values[end] - values[start]
    limit = problem.step * length
    return np.concatenate([limit - rise, limit + rise, length - problem.shortest])


@lru_cache(maxsize=64)
def segment_ends(size: int, *, cyclic: bool) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Numbers of the knots at which the segments start and end."""
    start = np.arange(size if cyclic else size - 1)
    return start, (start + 1) % size


def evaluate(problem: Problem, knots: Array, values: Array) -> Iterate:
    """Squared error of a curve, its gradient and its Hessian; O(n + K²) time and memory."""
    size = knots.size
    start, end = segment_ends(size, cyclic=problem.cyclic)
    length = knots[end] - knots[start]
    if problem.cyclic:
        length[-1] += problem.samples
    slope = (values[end] - values[start]) / length
    # Samples per segment: those of a cycle begin at the first knot.
    count = problem.samples
    first = math.ceil(knots[0]) if problem.cyclic else 0
    index = np.arange(first, first + count)
    turn = first % count
    desired = np.concatenate([problem.desired[turn:], problem.desired[:turn]])
    importance = np.concatenate([problem.weights[turn:], problem.weights[:turn]])
    segment = knots.searchsorted(index, side="right") - 1
    np.clip(segment, 0, start.size - 1, out=segment)

    share = (index - knots[segment]) / length[segment]
    rest = 1.0 - share
    residual = rest * values[segment] + share * values[end[segment]] - desired
    weights = np.empty((5, count))
    weights[0] = weights[1] = importance * residual
    weights[2] = weights[3] = importance * rest
    weights[4] = importance * share
    weights[[0, 2]] *= rest
    weights[[1, 3, 4]] *= share
    cells = segment + start.size * _FIVE
    g0, g1, s00, s01, s11 = sums_by(weights, cells, 5 * start.size).reshape(5, -1)

    # Per segment, in the order start knot, end knot, start value, end value.
    by_variable, by_pair = _scatter(size, start.size)
    squared = slope * slope
    first_order = [-slope * g0, -slope * g1, g0, g1]
    own = [squared * s00, squared * s11, s00, s11]
    gradient, gauss_newton = sums_by(np.array(first_order + own), by_variable, 4 * size).reshape(
        2, -1
    )
    # What the residuals add to the Hessian of Gauss and Newton.
    e0, e1 = g0 / length, g1 / length
    kk00, kk11 = own[0] - 2.0 * slope * e0, own[1] + 2.0 * slope * e1
    kk01 = squared * s01 + slope * (e0 - e1)
    ky00, ky01 = -slope * s00 + e0, -slope * s01 - e0
    ky10, ky11 = -slope * s01 + e1, -slope * s11 - e1
    second_order = [
        *(kk00, kk01, ky00, ky01),
        *(kk01, kk11, ky10, ky11),
        *(ky00, ky10, s00, s01),
        *(ky01, ky11, s01, s11),
    ]
    hessian = sums_by(np.array(second_order), by_pair, 4 * size * size)
    return Iterate(
        knots=knots,
        values=values,
        error=float(residual @ (importance * residual)),
        gradient=gradient,
        hessian=hessian.reshape(2 * size, 2 * size),
        gauss_newton=gauss_newton,
    )


_FIVE = np.arange(5)[:, None]


@lru_cache(maxsize=64)
def _scatter(size: int, segments: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Where the entries of the segments go: gradient and diagonal, (8, S), and Hessian, (16, S)."""
    start = np.arange(segments)
    end = (start + 1) % size
    variables = np.stack([start, end, size + start, size + end])
    twice = np.concatenate([variables, 2 * size + variables])
    pairs = variables[:, None, :] * (2 * size) + variables[None, :, :]
    return twice, pairs.reshape(16, -1)


@lru_cache(maxsize=64)
def pairs_of(size: int, segments: int) -> npt.NDArray[np.intp]:
    """Where the entries of the segments go in one row: gradient, diagonal, Hessian, (24, S)."""
    twice, pairs = _scatter(size, segments)
    return np.concatenate([twice, 4 * size + pairs])


def sums_by(weights: Array, by: npt.NDArray[np.intp], count: int) -> Array:
    """Sums of the weights that share a number, for the numbers 0, 1, ..., count-1."""
    sums: Array = np.bincount(by.ravel(), weights.ravel(), minlength=count).astype(
        np.float64, copy=False
    )
    return sums
