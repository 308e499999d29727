"""The values at given knots that are best within the slopes, and descents: convex QPs and SQP.

    minimise  Σ_k (P(k) - D(k))²    subject to    |y' - y| <= v (t' - t) for every segment

Few values are found by the compiled dense QP of the descents (``inner_loops.py``), many by OSQP. A
descent moves knots and values together by sequential quadratic programming, damped as Levenberg and
Marquardt do (Nocedal and Wright, Numerical Optimization, 2006, Chapter 18); the bounds on slopes
and lengths are linear in both.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import numpy as np

from planner.approximation.fit_problem import (
    Candidate,
    Problem,
    candidate,
    feasible_values,
    required_knots,
)
from planner.arrays import Array, Mask, steps
from planner.exceptions import SolverFailed

WINDOW = 16
"""Most knots that are moved together; of more, windows of so many are moved in turn. 80 fits of 14
to 40 segments, mean error: 8: 0.1 % more; 32: 0.3 % less for 2.6 times the time, as the dense QP of
a step costs its cube."""


def best_values(problem: Problem, knots: Array) -> Candidate:
    """The curve of best values within the slopes at given knots. O(n)."""
    near = feasible_values(problem, knots)  # where values are not determined
    if knots.size == 1:
        return candidate(problem, knots, near)
    if knots.size <= WINDOW:
        course = Candidate(knots, near, math.inf)
        return descend(problem, course, rounds=8, progress=1e-13, values_only=True)
    import osqp
    from scipy import sparse

    # In a unit of its own, as all rises are tiny where v is.
    centre, unit = float(np.mean(near)), min(1.0, problem.step * problem.samples)
    near = (near - centre) / unit
    size, n = knots.size, problem.samples
    start = np.arange(problem.segments(knots))  # numbers of the knots where segments start
    end = (start + 1) % size
    ends = problem.ends(knots)
    index = np.arange(n, dtype=np.float64)
    if problem.cyclic:
        index = knots[0] + np.mod(index - knots[0], n)
    segment = np.clip(np.searchsorted(knots, index, side="right") - 1, 0, start.size - 1)
    share = (index - knots[segment]) / np.diff(ends)[segment]
    columns = np.append(start[segment], end[segment])
    curve = sparse.csr_matrix(
        (np.append(1.0 - share, share), (np.tile(np.arange(n), 2), columns)), shape=(n, size)
    )
    squares, each = curve.T @ curve, sparse.eye(size, format="csr")
    scale = float(squares.diagonal().max())
    ridge = 1e-11 * scale  # for knots with no samples between them
    pins = (required_knots(problem, knots)[1] - centre) / unit
    pinned = np.flatnonzero(np.isfinite(pins))
    steepest, rises = problem.step / unit * np.diff(ends), each[end] - each[start]
    solver = osqp.OSQP(algebra="builtin")
    solver.setup(
        sparse.triu(squares + ridge * each, format="csc") / scale,
        np.asarray(curve.T @ (curve @ near - (problem.desired - centre) / unit)) / scale,
        sparse.vstack([rises, each[pinned]], format="csc"),
        np.append(-steepest - rises @ near, (pins - near)[pinned]),
        np.append(steepest - rises @ near, (pins - near)[pinned]),
        eps_abs=1e-11,  # OSQP's polishing prints where no bound is active
        eps_rel=1e-11,
        max_iter=50_000,
        verbose=False,
    )
    result = solver.solve(raise_error=False)
    status = str(result.info.status)
    logging.getLogger(__name__).debug("OSQP: %s after %d iterations", status, result.info.iter)
    if not status.startswith("solved"):
        raise SolverFailed("values at the knots, OSQP", status)
    values = within_slopes(problem, knots, centre + unit * (near + np.asarray(result.x)))
    return candidate(problem, knots, values)


def within_slopes(problem: Problem, knots: Array, values: Array) -> Array:
    """Values at knots, (K,), shrunk towards a feasible course until slopes keep the bound."""
    limits, towards = problem.step * np.diff(problem.ends(knots)), feasible_values(problem, knots)
    offset = values - towards
    shrink, shrunk = 1.0, values
    for attempt in range(64):
        rises = steps(shrunk, cyclic=problem.cyclic)
        excess = float(np.max(np.abs(rises) / limits, initial=0.0))
        if excess <= 1.0 + 1e-13:
            return shrunk
        shrink *= (1.0 - 2.0**attempt * 1e-16) / excess
        shrunk = towards + shrink * offset
    return towards


def descend(
    problem: Problem,
    start: Candidate,
    *,
    rounds: int,
    progress: float = 1e-7,
    values_only: bool = False,
) -> Candidate:
    """Move knots and values downhill, many of them by one window after the other; never worse.

    With ``values_only`` all knots stay: a convex QP, of which few evaluations find the optimum.
    """
    from planner.approximation import inner_loops

    def moved(inside: Problem, curve: Array, free: Mask) -> tuple[Array, float]:
        return inner_loops.descend(inside, curve, free, rounds, progress)

    return by_windows(problem, start, moved, values_only=values_only)


def by_windows(
    problem: Problem,
    start: Candidate,
    moved: Callable[[Problem, Array, Mask], tuple[Array, float]],
    *,
    values_only: bool = False,
) -> Candidate:
    """A curve moved by a function, of many knots by one window after the other, whose ends stay.

    The function takes the problem of a window, its curve, knots and then values, (2K,), and which
    of these are free, and returns the curve and its squared error.
    """
    size, n, cyclic = start.knots.size, problem.samples, problem.cyclic
    required, pins = required_knots(problem, start.knots)
    free = np.stack([~required & (not values_only), ~np.isfinite(pins)])
    if size <= WINDOW:
        curve, error = moved(problem, np.append(start.knots, start.values), free.ravel())
        return Candidate(curve[:size], curve[size:], error)
    knots, values = start.knots.copy(), start.values.copy()
    for first in range(0, size if cyclic else size - 2, WINDOW // 2):
        last = first + WINDOW - 1 if cyclic else min(first + WINDOW, size) - 1
        turn, number = np.divmod(np.arange(first, last + 1), size)
        places = knots[number] + n * turn
        low, high = math.ceil(places[0]), math.floor(places[-1])
        inside = Problem(problem.desired[np.arange(low, high + 1) % n], problem.step, cyclic=False)
        moves = free[:, number]
        moves[0, [0, -1]] = False
        moves[1, 0] &= first == 0 and not cyclic
        moves[1, -1] &= last == size - 1 and not cyclic
        curve, _ = moved(inside, np.append(places - low, values[number]), moves.ravel())
        places, values[number] = np.split(curve, 2)
        knots[number] = places + low - n * turn
    return candidate(problem, knots, values)


def ideal_of(problem: Problem) -> Array:
    """The ideal, (n,), no further from the samples than any curve within the slopes and pins.

    Pins on samples have a large weight, so that the others are at least as close, and the sequence
    is the pin's value there. Beside a pin it may exceed ``step`` slightly.
    """
    desired, weights = problem.desired, np.ones(problem.samples)
    pinned = np.isfinite(problem.pins) & (problem.required == np.floor(problem.required))
    at = problem.required[pinned].astype(np.intp)
    if at.size:
        desired = desired.copy()
        desired[at], weights[at] = problem.pins[pinned], 1e5
    ideal = slope_bounded(desired, problem.step, cyclic=problem.cyclic, weights=weights)
    ideal[at] = problem.pins[pinned]
    return ideal


def slope_bounded(
    desired: Array, step: float, *, cyclic: bool, weights: Array | None = None
) -> Array:
    """Least-squares sequence x with |x[k+1] - x[k]| <= step, by an exact dynamic programme: (n,).

    A cycle is cut out of three in a row, or of more where its ends do not meet, as happens when
    ``step`` is tiny; if not in 200,000 samples either, the change across the boundary may be larger
    than ``step``. ``weights`` are those of the squared errors, (n,). Cost O(n) in practice.
    """
    if float(np.max(np.abs(steps(desired, cyclic=cyclic)), initial=0.0)) <= step:
        return desired.copy()
    from planner.approximation.inner_loops import open_ended

    weights = np.ones(desired.size) if weights is None else weights
    if not cyclic:
        return open_ended(desired, weights, step)
    n = desired.size
    for turns in (3, 9, 27, 81, 243, 729, 2187):
        row = open_ended(np.tile(desired, turns), np.tile(weights, turns), step)
        first = (turns // 2) * n
        closed = abs(row[first] - row[first + n]) <= 1e-9 * np.ptp(desired)
        if closed or 3 * turns * n > 200_000:  # samples
            break
    return row[first : first + n]


def attainable_error(desired: Array, step: float, *, cyclic: bool) -> float:
    """Half of the most by which two samples are further apart than ``step`` a sample allows.

    It is the smallest largest error of any sequence within the slopes (McShane's extension).
    """
    repeated = np.tile(desired, 3) if cyclic else desired
    ramp = step * np.arange(repeated.size, dtype=np.float64)
    lower, upper = envelope_below(repeated, ramp), -envelope_below(-repeated, ramp)
    return 0.5 * float(np.max(upper - lower))


def envelope_below(values: Array, ramp: Array) -> Array:
    """The largest sequence below values whose slopes are within those of a rising ramp, (n,)."""
    forth = np.minimum.accumulate(values - ramp) + ramp
    back = np.minimum.accumulate((values + ramp)[::-1])[::-1] - ramp
    return np.asarray(np.minimum(forth, back))
