"""Knots and values moved together downhill: sequential quadratic programming, many curves at once.

A step minimises the quadratic model of the squared error, damped as Levenberg and Marquardt do,
within the bounds on slopes and lengths (Nocedal and Wright, Numerical Optimization, 2006, Chapter
18). The bounds are linear in knots and values together, so every iterate keeps them. Curves of as
many knots are evaluated together. Each has a dense QP of at most 32 variables, of which a fit
solves 100 to 600: non-negative least squares takes 0.02 ms for 4 and 12 variables and 0.05 for 24,
OSQP 0.35, 0.36 and 0.5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack
from scipy.optimize import nnls

from planner.approximation.least_squares import Evaluation, constraint_rows, evaluate, slacks
from planner.approximation.problem import (
    Candidate,
    Problem,
    candidate,
    feasible_values,
    fixed_variables,
)
from planner.trajectory import Array, Mask

Kind = TypeVar("Kind", bound=np.generic)


@dataclass(frozen=True)
class SqpOptions:
    """Tuning of the descent.

    Attributes:
        damping: Of the first step, relative to the curvature of each variable. 160 fits, mean
            error: 5e-4: 0.02 % more; 2e-3: 0.01 % less, at as many evaluations.
        progress: Relative decrease of the squared error below which a descent ends. 1e-5 and 1e-9:
            no change, as the method converges quadratically.
        none: Squared error, relative to the sum of squares of the samples, that counts as none.
            1e-22 and 1e-30: no change.
        window: Most knots that are moved together; of more, windows of so many are moved in turn.
            80 fits of 14 to 40 segments, mean error: 8: 0.1 % more; 32: 0.3 % less for 2.6 times
            the time, as the dense QP of a step costs its cube.
        race: Evaluations after which all but the best few descents end. 160 fits, mean error: 1:
            0.005 % more; 3: 0.016 % less for about a tenth more time at 12 segments.
        ridge: Damping, relative to the largest curvature, that makes values at knots without
            samples between them determinate. 1e-12 and 1e-8: no change.
        feasible: Violation of a step's bounds, relative to the step, up to which it is solved.
            1e-11 and 1e-7: no change.
        good: Share of the predicted reduction from which on a step is a good one. 160 fits, mean
            error, here and below: 0.25 and 0.8: within 0.0003 %.
        falls: Factor of the damping after a good step. 0.1 and 0.4: within 0.0003 %, 2 to 3 % more
            evaluations.
        falls_slowly: The same after a step that lowered the error less. 0.35: 0.0008 % more error;
            1: 0.0005 % less, 1 % more evaluations.
        grows: The same after a step that did not. 3: 0.0012 % more error; 12: 0.0001 % less.
        unsolved: The same where the sum was not definite or the bounds not kept. 5 and 20: within
            0.0004 %, 3 % more evaluations.
        ends: Damping from which on a step of little progress does not end the descent, as a smaller
            damping may reach further. 0.5 and 2: within 0.0001 %.
        knot_floor: Mean curvature by knots, relative, that is added to that of each: a knot between
            segments of one slope has none. 0.005 and 0.02: within 0.0001 %.
        value_floor: The same of values. 5e-7, 2e-6 and none: no change.
        common_floor: Mean curvature by values that is added to that of knots, as a constant has
            none by its knots. None and 1e-10: no change.
    """

    damping: float = 1e-3
    progress: float = 1e-7
    none: float = 1e-26
    window: int = 16
    race: int = 2
    ridge: float = 1e-10
    feasible: float = 1e-9
    good: float = 0.5
    falls: float = 0.2
    falls_slowly: float = 0.7
    grows: float = 6.0
    unsolved: float = 10.0
    ends: float = 1.0
    knot_floor: float = 1e-2
    value_floor: float = 1e-6
    common_floor: float = 1e-12


SQP = SqpOptions()


def best_values(problem: Problem, several: Sequence[Array]) -> list[Candidate]:
    """The curves of best values within the slopes at given knots: one convex QP each.

    Args:
        problem: What to approximate.
        several: Sets of knots, each shape (K,), at most ``SQP.window`` of them.

    Returns:
        The curves in the same order; where a QP was not solved, the one of feasible values.
    """
    if not several:
        return []
    size = several[0].size
    feasible = _each(several, lambda knots: feasible_values(problem, knots), problem)
    here = evaluate(problem, np.array(several), feasible)
    rows = constraint_rows(size, problem.step, cyclic=problem.cyclic)
    slopes = rows.shape[0] * 2 // 3
    slack = np.maximum(slacks(problem, here.knots, here.values)[:, :slopes], 0.0)
    hessians = here.hessians[:, size:, size:]
    largest = np.max(np.diagonal(hessians, axis1=1, axis2=2), axis=1, keepdims=True)
    free = _each(several, lambda knots: ~fixed_variables(problem, knots)[1], problem)
    steps = minimise_damped(
        SmallQPs(hessians, here.gradients[:, size:], rows[:slopes, size:], slack, free),
        np.broadcast_to(largest, here.values.shape),
        np.full(len(several), SQP.ridge),
    )
    change = (2.0 * here.gradients[:, size:] + _products(hessians, steps.steps)) * steps.steps
    errors = np.maximum(here.errors + np.sum(change, axis=1), 0.0)
    return [
        Candidate(*curve)
        for curve in zip(several, here.values + steps.steps, errors.tolist(), strict=True)
    ]


def descend(
    problem: Problem,
    starts: Sequence[Candidate],
    *,
    rounds: int,
    progress: float = SQP.progress,
    keep: int | None = None,
) -> list[Candidate]:
    """Move knots and values downhill until there is no progress; the ends of a path stay.

    Args:
        problem: What to approximate.
        starts: Where to start, within the slopes, as many knots each, at most ``SQP.window``.
        rounds: Most evaluations of each.
        progress: Relative decrease of the squared error below which a descent ends.
        keep: How many go on after ``SQP.race`` evaluations, the best; None for all.

    Returns:
        The best curve found from each start; never worse than it.
    """
    if not starts:
        return []
    knots, values = np.array([s.knots for s in starts]), np.array([s.values for s in starts])
    free = _each(knots, lambda row: _free_variables(problem, row), problem)
    here = _newton(problem, knots, values, free, rounds=rounds, progress=progress, keep=keep)
    rows = zip(here.knots, here.values, here.errors.tolist(), strict=True)
    return [Candidate(*row) for row in rows]


def descend_by_windows(
    problem: Problem, start: Candidate, *, rounds: int, only: Mask | None = None
) -> Candidate:
    """Move one window of many knots after the other, each between knots that stay.

    Args:
        problem: What to approximate.
        start: Where to start, within the slopes.
        rounds: Most evaluations of each window.
        only: Samples, shape (n,): windows with none of them stay.

    Returns:
        The curve; never worse than the start. Cost O(n) for each round.
    """
    if start.knots.size <= SQP.window:
        return descend(problem, [start], rounds=rounds)[0]
    size, n = start.knots.size, problem.samples
    fixed = ~_free_variables(problem, start.knots)
    knots, values = start.knots.copy(), start.values.copy()
    for first in range(0, size if problem.cyclic else size - 2, SQP.window // 2):
        last = first + SQP.window - 1
        if not problem.cyclic:
            last = min(last, size - 1)
        number = np.arange(first, last + 1)
        places = knots[number % size] + n * (number // size)
        low, high = math.ceil(places[0]), math.floor(places[-1])
        inside = np.arange(low, high + 1) % n
        if only is not None and not np.any(only[inside]):
            continue
        window = replace(
            problem,
            desired=problem.desired[inside],
            cyclic=False,
        )
        free = ~np.concatenate([fixed[number % size], fixed[size + number % size]])
        free[[0, number.size - 1]] = False
        if problem.cyclic or first > 0:
            free[number.size] = False
        if problem.cyclic or last < size - 1:
            free[-1] = False
        after = _newton(
            window,
            (places - low)[np.newaxis],
            values[np.newaxis, number % size],
            free[np.newaxis],
            rounds=rounds,
            progress=SQP.progress,
        )
        knots[number % size] = after.knots[0] + low - n * (number // size)
        values[number % size] = after.values[0]
    return candidate(problem, knots, values)


def _each(
    several: Sequence[Array] | Array, of: Callable[[Array], npt.NDArray[Kind]], problem: Problem
) -> npt.NDArray[Kind]:
    """What each set of knots has, one a row: all the same where no knot is required."""
    if problem.required.size:
        return np.array([of(knots) for knots in several])
    return np.tile(of(several[0]), (len(several), 1))


def _free_variables(problem: Problem, knots: Array) -> Mask:
    return ~np.concatenate(fixed_variables(problem, knots))


def _newton(
    problem: Problem,
    knots: Array,
    values: Array,
    free: Mask,
    *,
    rounds: int,
    progress: float,
    keep: int | None = None,
) -> Evaluation:
    """Newton's method on the free variables of each curve, damped until it goes down.

    Args:
        problem: What to approximate.
        knots: Knots, shape (m, K).
        values: Values, shape (m, K).
        free: Which knots and values move, shape (m, 2K).
        rounds: Most evaluations of each.
        progress: Relative decrease of the squared error below which a descent ends.
        keep: How many go on after ``SQP.race`` evaluations; None for all.
    """
    count, size = knots.shape
    here = evaluate(problem, knots, values)
    rows = constraint_rows(size, problem.step, cyclic=problem.cyclic)
    none = SQP.none * float(problem.desired @ problem.desired)
    damping = np.full(count, SQP.damping)
    active = (here.errors > none) & np.any(free, axis=1)
    for number in range(rounds):
        if number == SQP.race and keep is not None and keep < count:
            active &= here.errors <= np.partition(here.errors, keep - 1)[keep - 1]
        going = np.flatnonzero(active)
        if going.size == 0:
            break
        scales = _scales(here.gauss_newton[going], size)
        slack = np.maximum(slacks(problem, here.knots[going], here.values[going]), 0.0)
        qps = SmallQPs(here.hessians[going], here.gradients[going], rows, slack, free[going])
        moves, solved, damping[going], predicted = minimise_damped(qps, scales, damping[going])
        there = evaluate(
            problem, here.knots[going] + moves[:, :size], here.values[going] + moves[:, size:]
        )
        gains = here.errors[going] - there.errors
        better = solved & (gains > 0.0)
        stop = better & (gains <= progress * there.errors) & (damping[going] < SQP.ends)
        stop |= solved & ~better & (predicted <= progress * here.errors[going])
        for old, new in zip(here, there, strict=True):
            old[going[better]] = new[better]
        factor = np.where(gains > 0.0, SQP.falls_slowly, SQP.grows)
        factor = np.where(gains > SQP.good * predicted, SQP.falls, factor)
        damping[going] *= np.where(solved, factor, SQP.unsolved)
        active[going] = ~stop & (here.errors[going] > none)
    return here


def _scales(gauss_newton: Array, size: int) -> Array:
    """Curvature of each variable, against which damping is measured, shape (m, 2K)."""
    own = gauss_newton.copy()
    by_value = own[:, size:].sum(axis=1, keepdims=True) / size
    by_knot = own[:, :size].sum(axis=1, keepdims=True) / size
    own[:, :size] += SQP.knot_floor * by_knot + SQP.common_floor * by_value
    own[:, size:] += SQP.value_floor * by_value
    return own


class SmallQPs(NamedTuple):
    """Several QPs: minimise ½ pᵀHp + gᵀp subject to A p <= b."""

    hessians: Array  # H, (m, k, k)
    gradients: Array  # g, (m, k)
    rows: Array  # A, (r, k), the same for all
    bounds: Array  # b >= 0, (m, r)
    free: Mask  # which variables are sought, (m, k); the others stay zero


class DampedSteps(NamedTuple):
    """Steps of several curves, and the dampings with which they were found."""

    steps: Array  # (m, k), zero where none was found
    solved: Mask  # (m,)
    damping: Array  # (m,)
    predicted: Array  # by how much the steps should lower twice the programmes, (m,)


def minimise_damped(qps: SmallQPs, scales: Array, damping: Array) -> DampedSteps:
    """The p that minimises ½ pᵀ(H + λS)p + gᵀp among those with A p <= b, for each QP.

    With H + λS = LLᵀ and z = Lᵀp + L⁻¹g this is the point of a polyhedron that is nearest to the
    origin, which one call of non-negative least squares finds (Lawson and Hanson, Solving Least
    Squares Problems, 1974, Chapter 23).

    Args:
        qps: The QPs.
        scales: Diagonal of S, shape (m, k).
        damping: λ, shape (m,); ``SQP.unsolved`` times as large as often as it takes to make the
            sum definite.
    """
    hessians, gradients, rows, bounds, free = qps
    count, size = scales.shape
    diagonal = np.arange(size)
    gradients = np.where(free, gradients, 0.0)
    plain = hessians * (free[:, :, None] & free[:, None, :])
    plain[:, diagonal, diagonal] += ~free
    scales = scales * free
    damped, damping = plain.copy(), damping.copy()
    damped[:, diagonal, diagonal] += damping[:, None] * scales
    inverses, solved = np.zeros_like(damped), np.ones(count, dtype=bool)
    for m in range(count):
        inverse = _inverse_factor(damped[m])
        while inverse is None and damping[m] < 1e12:  # where a number is not finite, it never ends
            damping[m] *= SQP.unsolved
            damped[m, diagonal, diagonal] = plain[m, diagonal, diagonal] + damping[m] * scales[m]
            inverse = _inverse_factor(damped[m])
        solved[m] = inverse is not None
        if inverse is not None:
            inverses[m] = inverse
    offsets = _products(inverses, gradients)
    own_rows = rows * free[:, None, :]
    normals = own_rows @ inverses.transpose(0, 2, 1)
    shortfalls = -(bounds + _products(normals, offsets))  # of z = 0, as normals z <= -shortfalls
    points = -offsets
    for m in np.flatnonzero(solved & (np.max(shortfalls, axis=1) > 0.0)).tolist():
        nearest = _nearest_to_origin(normals[m], shortfalls[m])
        solved[m] = nearest is not None
        if nearest is not None:
            points[m] += nearest
    steps = _products(inverses.transpose(0, 2, 1), points)
    reach = np.max(_products(np.abs(own_rows), np.abs(steps)), axis=1)
    excess = np.max(_products(own_rows, steps) - bounds, axis=1)
    solved &= excess <= SQP.feasible * np.maximum(reach, 1e-300)
    steps[~solved] = 0.0
    predicted = -np.sum((2.0 * gradients + _products(damped, steps)) * steps, axis=1)
    return DampedSteps(steps, solved, damping, predicted)


def _products(matrices: Array, vectors: Array) -> Array:
    """Every matrix times its vector."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _inverse_factor(hessian: Array) -> Array | None:
    """L⁻¹ of H = LLᵀ, shape (k, k); None if H is not positive definite."""
    factor, failed = lapack.dpotrf(hessian, lower=1)
    if failed:
        return None
    # The inverse, as LAPACK's triangular solves start threads that wait for each other even at this
    # size, milliseconds on a busy machine.
    inverse, failed = lapack.dtrtri(factor, lower=1)
    return None if failed else np.asarray(inverse)


def _nearest_to_origin(normals: Array, shortfalls: Array) -> Array | None:
    """The shortest z with N z <= -s; None if non-negative least squares did not end."""
    scale = float(np.abs(shortfalls).max())
    system = np.empty((normals.shape[1] + 1, shortfalls.size))
    np.negative(normals.T, out=system[:-1])
    np.divide(shortfalls, scale, out=system[-1])
    target = np.zeros(system.shape[0])
    target[-1] = 1.0
    try:
        multipliers, _ = nnls(system, target)
    except RuntimeError:  # the caller damps more and asks again
        return None
    residual = target - system @ multipliers
    return None if residual[-1] <= 0.0 else (-scale / residual[-1]) * residual[:-1]
