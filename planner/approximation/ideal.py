"""The ideal: the least-squares projection on the sequences with bounded slopes."""

from __future__ import annotations

import numpy as np

from planner.approximation.problem import Problem
from planner.approximation.values import solve_values
from planner.exceptions import SolverFailed
from planner.trajectory import Array

LONGEST_QP = 5000
"""Samples up to which a cycle that does not close is solved again."""

PIN_WEIGHT = 1e5
"""Weight of a sample at which the curve's value is required."""


def ideal_of(problem: Problem) -> Array:
    """The ideal of a problem [unit of the samples], shape (n,).

    Its squared error is no more than that of any curve within the slopes that keeps the pins: pins
    on samples are penalised by :data:`PIN_WEIGHT`, so the others are at least as close, and the
    sequence is the pin's value there. Beside a pin it may exceed ``step`` slightly.
    """
    desired, weights = problem.desired, np.ones(problem.samples)
    pinned = np.isfinite(problem.pins) & (problem.required == np.floor(problem.required))
    at = problem.required[pinned].astype(np.intp)
    if at.size:
        desired = desired.copy()
        desired[at], weights[at] = problem.pins[pinned], PIN_WEIGHT
    ideal = slope_bounded(desired, problem.step, cyclic=problem.cyclic, weights=weights)
    ideal[at] = problem.pins[pinned]
    return ideal


def slope_bounded(
    desired: Array, step: float, *, cyclic: bool, weights: Array | None = None
) -> Array:
    """Least-squares sequence x with |x[k+1] - x[k]| <= step, by an exact dynamic programme.

    A cycle is cut out of three in a row; where its ends do not meet, as happens when ``step`` is
    tiny, it is solved again as a QP with a knot on every sample.

    Args:
        desired: Sequence to approximate [any unit], shape (n,).
        step: Largest change from one sample to the next, > 0 [same unit].
        cyclic: Whether the first sample follows the last.
        weights: Weight of every sample's squared error, shape (n,); by default all the same.

    Returns:
        The sequence, shape (n,). Cost O(n) in practice.
    """
    ends = desired[-1:] if cyclic else desired[:1]
    if float(np.max(np.abs(np.diff(desired, prepend=ends)))) <= step:
        return desired.copy()
    from planner.approximation.kernel import open_ended

    weights = np.ones(desired.size) if weights is None else weights
    if not cyclic:
        return open_ended(desired, weights, step)
    n = desired.size
    three = open_ended(np.tile(desired, 3), np.tile(weights, 3), step)
    cycle = three[n : 2 * n]
    if abs(three[n] - three[2 * n]) <= 1e-9 * np.ptp(desired) or n > LONGEST_QP:
        return cycle
    return _closed(desired, weights, step, cycle)


def _closed(desired: Array, weights: Array, step: float, near: Array) -> Array:
    """The ideal of a cycle as a QP; ``near`` if that is not solved."""
    middle = 0.5 * (float(desired.max()) + float(desired.min()))
    unit = 0.5 * float(np.ptp(desired))
    at = np.flatnonzero(weights > 1.0)
    problem = Problem(
        desired=(desired - middle) / unit,
        step=step / unit,
        cyclic=True,
        required=at.astype(np.float64),
        pins=(desired[at] - middle) / unit,
    )
    try:
        values = solve_values(problem, np.arange(desired.size, dtype=np.float64))
    except SolverFailed:
        return near
    return middle + unit * values


def attainable_error(desired: Array, step: float, *, cyclic: bool) -> float:
    """Smallest largest error of any sequence with |x[k+1] - x[k]| <= step.

    Half of the most by which two samples are further apart than ``step`` allows.
    """
    lower, upper = envelopes(desired, step, cyclic=cyclic)
    return 0.5 * float(np.max(upper - lower))


def envelopes(desired: Array, step: float, *, cyclic: bool) -> tuple[Array, Array]:
    """The slope-bounded sequences closest to ``desired`` from below and from above.

    Their mean has the smallest largest error of all slope-bounded sequences (McShane's extension).
    """
    n = desired.size
    repeated = np.tile(desired, 3) if cyclic else desired
    ramp = step * np.arange(repeated.size, dtype=np.float64)
    lower, upper = envelope_below(repeated, ramp), -envelope_below(-repeated, ramp)
    middle = slice(n, 2 * n) if cyclic else slice(0, n)
    return lower[middle], upper[middle]


def envelope_below(values: Array, ramp: Array) -> Array:
    """The largest sequence below values whose slopes are within those of a rising ramp, (n,)."""
    forth = np.minimum.accumulate(values - ramp) + ramp
    back = np.minimum.accumulate((values + ramp)[::-1])[::-1] - ramp
    return np.asarray(np.minimum(forth, back))
