"""Knots and values moved together downhill: sequential quadratic programming, many curves at once.

A step minimises the quadratic model of the squared error, damped as Levenberg and Marquardt do,
within the bounds on slopes and lengths (Nocedal and Wright, Numerical Optimization, 2006, Chapter
18). The bounds are linear in knots and values together, so every iterate keeps them. Curves of as
many knots are evaluated together; each solves its own small QP.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from planner.approximation.least_squares import Evaluation, constraint_rows, evaluate, slacks
from planner.approximation.problem import (
    Candidate,
    Problem,
    candidate,
    feasible_values,
    fixed_variables,
)
from planner.approximation.qp import minimize_damped, minimize_quadratic
from planner.trajectory import Array

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class SqpOptions:
    """Tuning of the descent.

    Attributes:
        damping: Of the first step, relative to the curvature of each variable. 5e-4 and 2e-3: the
            mean error of 640 fits changes by less than 0.01 %.
        progress: Relative decrease of the squared error below which a descent ends. It decides
            between one step more or less of a method that converges quadratically.
        none: Squared error, relative to the sum of squares of the samples, that counts as none.
        window: Most knots that are moved together; of more, windows of so many are moved in turn.
            The dense QP of a step costs its cube.
        race: Evaluations after which all but the best few descents end.
    """

    damping: float = 1e-3
    progress: float = 1e-7
    none: float = 1e-26
    window: int = 16
    race: int = 2


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
    here = evaluate(
        problem, np.array(several), np.array([feasible_values(problem, t) for t in several])
    )
    all_rows = constraint_rows(size, problem.step, cyclic=problem.cyclic)
    slopes = all_rows.shape[0] * 2 // 3
    slack = np.maximum(slacks(problem, here.knots, here.values)[:, :slopes], 0.0)
    found = []
    for m, knots in enumerate(several):
        free = size + np.flatnonzero(~fixed_variables(problem, knots)[1])
        values, error = here.values[m].copy(), float(here.errors[m])
        if free.size:
            hessian, gradient = here.hessians[m][np.ix_(free, free)], here.gradients[m, free]
            ridge = 1e-10 * hessian.diagonal().max() * np.eye(free.size)
            step = minimize_quadratic(hessian + ridge, gradient, all_rows[:slopes, free], slack[m])
            if step is not None:
                error += float((2.0 * gradient + hessian @ step) @ step)
                values[free - size] += step
        found.append(Candidate(knots, values, max(error, 0.0)))
    return found


def descend(
    problem: Problem,
    starts: Sequence[Candidate],
    *,
    rounds: int,
    progress: float = SQP.progress,
    keep: int | None = None,
    hold: Mask | None = None,
) -> list[Candidate]:
    """Move knots and values downhill until there is no progress; the ends of a path stay.

    Args:
        problem: What to approximate.
        starts: Where to start, within the slopes, as many knots each, at most ``SQP.window``.
        rounds: Most evaluations of each.
        progress: Relative decrease of the squared error below which a descent ends.
        keep: How many go on after ``SQP.race`` evaluations, the best; None for all.
        hold: Knots that stay, shape (K,), besides those that must.

    Returns:
        The best curve found from each start; never worse than it.
    """
    if not starts:
        return []
    free = np.array([_free_variables(problem, start.knots, hold) for start in starts])
    knots, values = np.array([s.knots for s in starts]), np.array([s.values for s in starts])
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
    fixed = ~_free_variables(problem, start.knots, None)
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
            weights=problem.weights[inside],
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


def _free_variables(problem: Problem, knots: Array, hold: Mask | None) -> Mask:
    fixed, pinned = fixed_variables(problem, knots)
    return ~np.concatenate([fixed if hold is None else fixed | hold, pinned])


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
    variables = [np.flatnonzero(each) for each in free]
    own_rows = [rows[:, v] for v in variables]
    cells = [(v[:, None], v[None, :]) for v in variables]
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
        moves = np.zeros((going.size, 2 * size))
        solved, predicted = np.zeros(going.size, dtype=bool), np.zeros(going.size)
        for g, m in enumerate(going.tolist()):
            v = variables[m]
            step, damping[m], predicted[g] = minimize_damped(
                here.hessians[m][cells[m]],
                scales[g, v],
                float(damping[m]),
                here.gradients[m, v],
                own_rows[m],
                slack[g],
            )
            if step is not None:
                moves[g, v], solved[g] = step, True
        there = evaluate(
            problem, here.knots[going] + moves[:, :size], here.values[going] + moves[:, size:]
        )
        gains = here.errors[going] - there.errors
        better = solved & (gains > 0.0)
        stop = better & (gains <= progress * there.errors) & (damping[going] < 1.0)
        stop |= solved & ~better & (predicted <= progress * here.errors[going])
        for old, new in zip(here, there, strict=True):
            old[going[better]] = new[better]
        factor = np.where(gains > 0.5 * predicted, 0.2, np.where(gains > 0.0, 0.7, 6.0))
        damping[going] *= np.where(solved, factor, 10.0)
        active[going] = ~stop & (here.errors[going] > none)
    return here


def _scales(gauss_newton: Array, size: int) -> Array:
    """Curvature of each variable, against which damping is measured, shape (m, 2K)."""
    own = gauss_newton.copy()
    by_value = own[:, size:].sum(axis=1, keepdims=True) / size
    by_knot = own[:, :size].sum(axis=1, keepdims=True) / size
    own[:, :size] += 1e-2 * by_knot + 1e-12 * by_value
    own[:, size:] += 1e-6 * by_value
    return own
