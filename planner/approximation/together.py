"""Many curves of as many knots downhill at once: what each costs is its small QP alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.descent import EXACT, PROGRESS, best_values, descend
from planner.approximation.objective import (
    Candidate,
    Problem,
    constraint_rows,
    pairs_of,
    segment_ends,
    sums_by,
)
from planner.approximation.requirements import at_rest, held
from planner.approximation.small_qp import minimize_damped, minimize_quadratic
from planner.approximation.stack import lines_in_force
from planner.trajectory import Array

RACE = 2
"""Evaluations after which the worse of many curves are given up."""


class Iterates(NamedTuple):
    """As many curves as rows, their squared errors and derivatives, as in :class:`Iterate`."""

    knots: Array  # (m, K)
    values: Array  # (m, K)
    errors: Array  # (m,)
    gradients: Array  # (m, 2K), of half the squared error
    hessians: Array  # (m, 2K, 2K), of half the squared error
    gauss_newton: Array  # (m, 2K), diagonal without the residuals' part

    def where(self, chosen: npt.NDArray[np.bool_], other: Iterates) -> Iterates:
        """The rows of ``other`` where chosen, those of this elsewhere."""
        pairs = zip(self, other, strict=True)
        return Iterates(
            *(np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in pairs)
        )


def evaluate_all(problem: Problem, knots: Array, values: Array) -> Iterates:
    """Squared errors of curves, their gradients and Hessians; O(m (n + K²)) time and memory."""
    count, size = knots.shape
    n = problem.samples
    start, end = segment_ends(size, cyclic=problem.cyclic)
    lengths = knots[:, end] - knots[:, start]
    if problem.cyclic:
        lengths[:, -1] += n
    rises = values[:, end] - values[:, start]
    first = np.ceil(knots[:, start])
    segment = lines_in_force(first.astype(np.intp), n, cyclic=problem.cyclic)
    cells = segment + start.size * np.arange(count)[:, None]
    since = np.arange(n) - first.ravel()[cells]
    if problem.cyclic:
        since = np.mod(since, n)
    share = (since + (first - knots[:, start]).ravel()[cells]) / lengths.ravel()[cells]
    residual = values[:, start].ravel()[cells] + share * rises.ravel()[cells] - problem.desired
    weighed = residual * problem.weights
    errors = np.einsum("mk,mk->m", residual, weighed)

    sums = np.empty((5, count, n))
    sums[0], sums[2] = weighed, problem.weights
    np.multiply(weighed, share, out=sums[1])
    np.multiply(problem.weights, share, out=sums[3])
    np.multiply(sums[3], share, out=sums[4])
    places = cells + cells_of(count * start.size)
    tables = sums_by(sums, places, 5 * count * start.size)
    r0, r1, w0, w1, w2 = tables.reshape(5, count, start.size)
    # As in `evaluate`, with rest = 1 - share.
    g0, g1, s11, s01 = r0 - r1, r1, w2, w1 - w2
    s00 = w0 - w1 - s01
    slope = rises / lengths
    e0, e1 = g0 / lengths, g1 / lengths
    m00, m01, m11 = slope * s00, slope * s01, slope * s11
    by = np.empty((24, count, start.size))
    by[0], by[1], by[2], by[3] = -slope * g0, -slope * g1, g0, g1
    by[4], by[5], by[6], by[7] = slope * m00, slope * m11, s00, s11
    by[8], by[13] = by[4] - 2.0 * slope * e0, by[5] + 2.0 * slope * e1
    by[9] = by[12] = slope * (m01 + e0 - e1)
    by[10] = by[16] = e0 - m00
    by[11] = by[20] = -m01 - e0
    by[14] = by[17] = e1 - m01
    by[15] = by[21] = -m11 - e1
    by[18], by[23] = s00, s11
    by[19] = by[22] = s01
    width = 4 * size + 4 * size * size
    rows = width * np.arange(count)[:, None]
    variables = rows + pairs_of(size, start.size)[:, None, :]
    totals = sums_by(by, variables, count * width).reshape(count, width)
    return Iterates(
        knots=knots,
        values=values,
        errors=errors,
        gradients=totals[:, : 2 * size],
        hessians=totals[:, 4 * size :].reshape(count, 2 * size, 2 * size),
        gauss_newton=totals[:, 2 * size : 4 * size],
    )


def cells_of(count: int) -> npt.NDArray[np.intp]:
    """Offsets of five tables of so many cells, shape (5, 1, 1)."""
    return count * np.arange(5)[:, None, None]


def all_slacks(problem: Problem, knots: Array, values: Array) -> Array:
    """How far slopes and lengths are from their bounds, in the order of the rows, shape (m, 3S)."""
    start, end = segment_ends(knots.shape[1], cyclic=problem.cyclic)
    length = knots[:, end] - knots[:, start]
    if problem.cyclic:
        length[:, -1] += problem.samples
    rise = values[:, end] - values[:, start]
    limit = problem.step * length
    return np.concatenate([limit - rise, limit + rise, length - problem.shortest], axis=1)


def descend_all(
    problem: Problem,
    starts: Sequence[Candidate],
    *,
    rounds: int,
    progress: float = PROGRESS,
    hold: npt.NDArray[np.bool_] | None = None,
    keep: int | None = None,
) -> list[Candidate]:
    """What :func:`planner.approximation.descent.descend` does, for starts of as many knots each.

    Args:
        problem: What to approximate.
        starts: Where to start, within the slopes; at most ``LARGEST_WINDOW`` knots.
        rounds: Most evaluations of each.
        progress: Relative decrease of the squared error below which a descent ends.
        hold: Which knots stay, shape (K,); None for those that must.
        keep: How many go on after :data:`RACE` evaluations, the best; None for all.

    Returns:
        The best curve found from each start; never worse than it.
    """
    if len(starts) == 1 or problem.required.size:
        return [descend(problem, start, rounds=rounds, hold=hold) for start in starts]
    fixed, pinned = held(problem, starts[0].knots)
    free = ~np.concatenate([fixed if hold is None else fixed | hold, pinned])
    if not np.any(free):
        return list(starts)
    size = starts[0].knots.size
    here = evaluate_all(
        problem, np.array([s.knots for s in starts]), np.array([s.values for s in starts])
    )
    rows = constraint_rows(size, problem.step, cyclic=problem.cyclic)[:, free]
    variables = np.flatnonzero(free)
    cells = variables[:, None], variables[None, :]
    none = EXACT * float(problem.desired @ problem.desired)
    damping = np.full(len(starts), 1e-3)
    active = here.errors > none
    for number in range(rounds):
        if number == RACE and keep is not None and keep < len(starts):
            active &= here.errors <= np.partition(here.errors, keep - 1)[keep - 1]
        if not np.any(active):
            break
        hessians = here.hessians[(slice(None), *cells)]
        gradients = here.gradients[:, variables]
        scales = _scales(here, size)[:, variables]
        slack = np.maximum(all_slacks(problem, here.knots, here.values), 0.0)
        moves = np.zeros((len(starts), 2 * size))
        solved, promised = np.zeros(len(starts), dtype=bool), np.zeros(len(starts))
        for m in np.flatnonzero(active).tolist():
            step, damping[m], promised[m] = minimize_damped(
                hessians[m], scales[m], float(damping[m]), gradients[m], rows, slack[m]
            )
            if step is not None:
                moves[m, variables], solved[m] = step, True
        there = evaluate_all(problem, here.knots + moves[:, :size], here.values + moves[:, size:])
        gains = here.errors - there.errors
        better = active & solved & (gains > 0.0)
        stop = better & (gains <= progress * there.errors) & (damping < 1.0)
        stop |= active & solved & ~better & (promised <= progress * here.errors)
        here = here.where(better, there)
        factor = np.where(gains > 0.5 * promised, 0.2, np.where(gains > 0.0, 0.7, 6.0))
        damping = damping * np.where(solved, factor, 10.0)
        active = active & ~stop & (here.errors > none)
    rows_of = zip(here.knots, here.values, here.errors.tolist(), strict=True)
    return [Candidate(*row) for row in rows_of]


def all_best_values(problem: Problem, several: Sequence[Array]) -> list[Candidate]:
    """What :func:`planner.approximation.descent.best_values` finds, for as many knots each."""
    if len(several) < 2 or problem.required.size:
        return [best_values(problem, knots) for knots in several]
    size = several[0].size
    at = np.array(several)
    here = evaluate_all(problem, at, np.tile(at_rest(problem, several[0]), (len(several), 1)))
    rows = constraint_rows(size, problem.step, cyclic=problem.cyclic)
    slopes = rows.shape[0] * 2 // 3
    rows = rows[:slopes, size:]
    slack = all_slacks(problem, at, here.values)[:, :slopes]
    found = []
    for knots, values, error, gradient, hessian, bounds in zip(
        at, here.values, here.errors.tolist(), here.gradients, here.hessians, slack, strict=True
    ):
        own = hessian[size:, size:]
        ridge = 1e-10 * own.diagonal().max() * np.eye(size)
        step = minimize_quadratic(own + ridge, gradient[size:], rows, bounds)
        if step is not None:
            error += float((2.0 * gradient[size:] + own @ step) @ step)
            values = values + step
        found.append(Candidate(knots, values, max(error, 0.0)))
    return found


def _scales(here: Iterates, size: int) -> Array:
    """Curvature of each variable, against which damping is measured, shape (m, 2K)."""
    own = here.gauss_newton.copy()
    by_value = own[:, size:].sum(axis=1, keepdims=True) / size
    by_knot = own[:, :size].sum(axis=1, keepdims=True) / size
    own[:, :size] += 1e-2 * by_knot + 1e-12 * by_value
    own[:, size:] += 1e-6 * by_value
    return own
