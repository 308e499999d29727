"""The squared error of piecewise-linear curves, and its derivatives by knots and values.

Between the knots t_j and t_{j+1} the curve at sample k is P(k) = (1 - u) y_j + u y_{j+1} with the
share u = (k - t_j) / (t_{j+1} - t_j). The error is E = Σ_k (P(k) - D(k))². Its derivatives need
five sums over the samples of each segment only. Many curves of as many knots are evaluated at once;
one alone takes as long as a function of its own would.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import lines_in_force
from planner.approximation.problem import Problem, segment_ends
from planner.trajectory import Array

ON_SAMPLE = 1e-9
"""Distance [samples] up to which a knot behind a sample counts as on it, so that the sample belongs
to the segment that begins there. Where a bound holds a knot on a sample, rounding would decide."""


class Evaluation(NamedTuple):
    """Curves, one a row, their squared errors and derivatives.

    The variables are ordered knots first: (t_0, ..., t_{K-1}, y_0, ..., y_{K-1}).
    """

    knots: Array  # (m, K)
    values: Array  # (m, K)
    errors: Array  # (m,)
    gradients: Array  # (m, 2K), of half the squared error
    hessians: Array  # (m, 2K, 2K), of half the squared error
    gauss_newton: Array  # (m, 2K), diagonal of the Hessian without the residuals' part


def evaluate(problem: Problem, knots: Array, values: Array) -> Evaluation:
    """Squared errors of curves, their gradients and Hessians; O(m (n + K²)) time and memory.

    Args:
        problem: What to approximate.
        knots: Knots t, shape (m, K), of a cycle within one cycle, which may begin in any turn.
        values: Values y, shape (m, K).
    """
    count, size = knots.shape
    n = problem.samples
    start, end = segment_ends(size, cyclic=problem.cyclic)
    lengths = knots[:, end] - knots[:, start]
    if problem.cyclic:
        lengths[:, -1] += n
    rises = values[:, end] - values[:, start]
    first = np.ceil(knots[:, start] - ON_SAMPLE)
    segment = lines_in_force(first.astype(np.intp), n, cyclic=problem.cyclic)
    cells = segment + start.size * np.arange(count)[:, None]
    since = np.arange(n) - first.ravel()[cells]
    if problem.cyclic:
        since = np.mod(since, n)
    share = (since + (first - knots[:, start]).ravel()[cells]) / lengths.ravel()[cells]
    residual = values[:, start].ravel()[cells] + share * rises.ravel()[cells] - problem.desired
    errors = np.einsum("mk,mk->m", residual, residual)

    # Σ r, Σ r u, Σ 1, Σ u and Σ u² of every segment.
    sums = np.empty((5, count, n))
    sums[0], sums[2], sums[3] = residual, 1.0, share
    np.multiply(residual, share, out=sums[1])
    np.multiply(share, share, out=sums[4])
    places = cells + count * start.size * np.arange(5)[:, None, None]
    tables = sums_by(sums, places, 5 * count * start.size)
    r0, r1, w0, w1, w2 = tables.reshape(5, count, start.size)
    # Of 1 - u and u: residuals g, and squares s.
    g0, g1, s11, s01 = r0 - r1, r1, w2, w1 - w2
    s00 = w0 - w1 - s01
    slope = rises / lengths
    e0, e1 = g0 / lengths, g1 / lengths
    m00, m01, m11 = slope * s00, slope * s01, slope * s11
    # By variable of the segment: start knot, end knot, start value, end value.
    by = np.empty((24, count, start.size))
    by[0], by[1], by[2], by[3] = -slope * g0, -slope * g1, g0, g1  # gradient
    by[4], by[5], by[6], by[7] = slope * m00, slope * m11, s00, s11  # Gauss-Newton's diagonal
    by[8], by[13] = by[4] - 2.0 * slope * e0, by[5] + 2.0 * slope * e1  # Hessian, row by row
    by[9] = by[12] = slope * (m01 + e0 - e1)
    by[10] = by[16] = e0 - m00
    by[11] = by[20] = -m01 - e0
    by[14] = by[17] = e1 - m01
    by[15] = by[21] = -m11 - e1
    by[18], by[23] = s00, s11
    by[19] = by[22] = s01
    width = 4 * size + 4 * size * size
    rows = width * np.arange(count)[:, None]
    variables = rows + _scatter(size, start.size)[:, None, :]
    totals = sums_by(by, variables, count * width).reshape(count, width)
    return Evaluation(
        knots=knots,
        values=values,
        errors=errors,
        gradients=totals[:, : 2 * size],
        hessians=totals[:, 4 * size :].reshape(count, 2 * size, 2 * size),
        gauss_newton=totals[:, 2 * size : 4 * size],
    )


@lru_cache(maxsize=64)
def _scatter(size: int, segments: int) -> npt.NDArray[np.intp]:
    """Where a segment's entries go in one row: gradient, diagonal and Hessian, shape (24, S)."""
    start = np.arange(segments)
    end = (start + 1) % size
    variables = np.stack([start, end, size + start, size + end])
    pairs = variables[:, None, :] * (2 * size) + variables[None, :, :]
    return np.concatenate([variables, 2 * size + variables, 4 * size + pairs.reshape(16, -1)])


def sums_by(weights: Array, by: npt.NDArray[np.intp], count: int) -> Array:
    """Sums of the weights that share a number, for the numbers 0, 1, ..., count-1."""
    sums: Array = np.bincount(by.ravel(), weights.ravel(), minlength=count).astype(
        np.float64, copy=False
    )
    return sums


@lru_cache(maxsize=256)
def constraint_rows(size: int, step: float, *, cyclic: bool) -> Array:
    """Rows A such that a step p of knots and values is allowed if A p <= the slacks.

    The bound on a slope, |y' - y| <= v (t' - t), is linear in knots and values together, so the
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
    """How far slopes and lengths are from their bounds, in the order of the rows.

    Args:
        problem: What to approximate.
        knots: Knots, shape (..., K).
        values: Values, shape (..., K).

    Returns:
        Slacks, shape (..., 3S) for S segments.
    """
    start, end = segment_ends(knots.shape[-1], cyclic=problem.cyclic)
    length = knots[..., end] - knots[..., start]
    if problem.cyclic:
        length[..., -1] += problem.samples
    rise = values[..., end] - values[..., start]
    limit = problem.step * length
    return np.concatenate([limit - rise, limit + rise, length - 1.0], axis=-1)


class Moments(NamedTuple):
    """Sums over stretches of samples, time counted from the first node of each; any shape."""

    w0: Array  # Σ 1
    w1: Array  # Σ k
    w2: Array  # Σ k²
    d0: Array  # Σ d
    d1: Array  # Σ k d
    d2: Array  # Σ d²


def moments(desired: Array, start: npt.NDArray[np.intp], end: npt.NDArray[np.intp]) -> Moments:
    """Sums over the samples after ``start`` up to ``end``, with k = 0 at ``start``.

    Args:
        desired: Samples, shape (..., n); their sums have the same leading axes.
        start: Sample before each stretch, of any shape that broadcasts with ``end``.
        end: Last sample of each.

    Returns:
        The sums, each of the common shape. Cost O(n) and a few operations per stretch.
    """
    totals = running(desired)
    begun = [total[..., start] for total in totals]
    ended = [total[..., end] for total in totals]
    return between(start, begun, ended)


def running(desired: Array) -> tuple[Array, Array]:
    """Sums over the samples up to each, with k = 0 at the first.

    Those of 1, k and k², shape (3, n), and of d, k d and d², shape (3, ..., n).
    """
    k = np.arange(desired.shape[-1], dtype=np.float64)
    of_index, of_samples = [np.ones(k.size), k, k * k], [desired, k * desired, desired * desired]
    return np.cumsum(of_index, axis=-1), np.cumsum(of_samples, axis=-1)


def between(
    start: npt.NDArray[np.intp] | Array, begun: Sequence[Array], ended: Sequence[Array]
) -> Moments:
    """Sums about ``start``, whole or not, from those of :func:`running` there and at the ends."""
    # In C order, as sliding views would otherwise leave theirs to all that is made of them.
    (w0, w1, w2), (d0, d1, d2) = (
        np.subtract(after, before, order="C") for before, after in zip(begun, ended, strict=True)
    )
    since = start.astype(np.float64)
    w2 = w2 - since * (2.0 * w1 - since * w0)
    return Moments(w0, w1 - since * w0, w2, d0, d1 - since * d0, d2)
