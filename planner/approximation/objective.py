"""The squared error of a piecewise-linear curve, and its derivatives by knots and values."""

from __future__ import annotations

from dataclasses import dataclass

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
        shortest: Length of the shortest segment [samples].
    """

    desired: Array
    step: float
    cyclic: bool
    shortest: float = 1.0

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return self.desired.size


@dataclass(frozen=True, kw_only=True, eq=False)
class Iterate:
    """Knots and values, their squared error and its derivatives.

    The variables are ordered knots first: (k_0, ..., k_{K-1}, y_0, ..., y_{K-1}).
    """

    knots: Array
    values: Array
    error: float
    gradient: Array  # (2K,), of half the squared error
    gauss_newton: Array  # (2K, 2K)
    curvature: Array  # (2K, 2K), what the Hessian has beyond Gauss-Newton


def constraints(problem: Problem, knots: Array, values: Array) -> tuple[Array, Array]:
    """Rows A and slacks b such that a step p is allowed if A p <= b: slopes first, then lengths.

    The bound on a slope, |y' - y| <= v (k' - k), is linear in knots and values together.

    Returns:
        A, shape (3S, 2K), and b, shape (3S,), for S segments and K knots.
    """
    size = knots.size
    start, end = segment_ends(problem, size)
    ends = np.append(knots, knots[0] + problem.samples) if problem.cyclic else knots
    length = np.diff(ends)
    rise = values[end] - values[start]
    identity = np.eye(size)
    by_knots, by_values = identity[end] - identity[start], identity[end] - identity[start]
    reach = problem.step * by_knots
    rows = np.block([[-reach, by_values], [-reach, -by_values], [-by_knots, 0.0 * by_values]])
    limit = problem.step * length
    return rows, np.concatenate([limit - rise, limit + rise, length - problem.shortest])


def segment_ends(problem: Problem, size: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Numbers of the knots at which the segments start and end."""
    start = np.arange(size if problem.cyclic else size - 1)
    return start, (start + 1) % size


def evaluate(problem: Problem, knots: Array, values: Array) -> Iterate:
    """Squared error of a curve, its gradient and its Hessian; O(n) time and memory."""
    size = knots.size
    start, end = segment_ends(problem, size)
    ends = np.append(knots, knots[0] + problem.samples) if problem.cyclic else knots
    length = np.diff(ends)
    slope = (values[end] - values[start]) / length
    # Samples per segment: those of a cycle begin at the first knot.
    count = problem.samples
    if problem.cyclic:
        first = int(np.ceil(knots[0]))
        index = np.arange(first, first + count)
        desired = np.take(problem.desired, index, mode="wrap")
    else:
        index, desired = np.arange(count), problem.desired
    segment = np.searchsorted(knots, index, side="right") - 1
    np.clip(segment, 0, start.size - 1, out=segment)
    share = (index - knots[segment]) / length[segment]
    rest = 1.0 - share
    residual = rest * values[segment] + share * values[end[segment]] - desired

    g0, g1, s00, s01, s11 = (
        _sums(product, segment, start.size)
        for product in (residual * rest, residual * share, rest * rest, rest * share, share * share)
    )
    # Per segment, variables ordered (start knot, end knot, start value, end value).
    columns = np.stack([start, end, size + start, size + end], axis=1)
    gradient = _sums(
        np.stack([-slope * g0, -slope * g1, g0, g1], axis=1),
        columns,
        2 * size,
    )
    square = np.stack([s00, s01, s01, s11], axis=1).reshape(-1, 2, 2)
    blocks = np.empty((start.size, 4, 4))
    m = slope[:, None, None]
    blocks[:, :2, :2] = m * m * square
    blocks[:, :2, 2:] = blocks[:, 2:, :2] = -m * square
    blocks[:, 2:, 2:] = square
    extra = np.zeros_like(blocks)
    e0, e1 = g0 / length, g1 / length
    extra[:, 0, 0] = -2.0 * slope * e0
    extra[:, 0, 1] = extra[:, 1, 0] = slope * (e0 - e1)
    extra[:, 1, 1] = 2.0 * slope * e1
    extra[:, 0, 2] = extra[:, 2, 0] = e0
    extra[:, 0, 3] = extra[:, 3, 0] = -e0
    extra[:, 1, 2] = extra[:, 2, 1] = e1
    extra[:, 1, 3] = extra[:, 3, 1] = -e1
    where = columns[:, :, None] * (2 * size) + columns[:, None, :]
    shape = (2 * size, 2 * size)
    cells = shape[0] * shape[1]
    return Iterate(
        knots=knots,
        values=values,
        error=float(residual @ residual),
        gradient=gradient,
        gauss_newton=_sums(blocks, where, cells).reshape(shape),
        curvature=_sums(extra, where, cells).reshape(shape),
    )


def _sums(weights: Array, by: npt.NDArray[np.intp], count: int) -> Array:
    """Sums of the weights that share a number, for the numbers 0, 1, ..., count-1."""
    sums: Array = np.bincount(by.ravel(), weights.ravel(), minlength=count).astype(
        np.float64, copy=False
    )
    return sums
