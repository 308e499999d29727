"""Knots moved across samples, one at a time and all at once downhill.

The squared error has a kink wherever a knot meets a sample, and so a hollow of its own between any
two samples; Newton's method ends in the nearest one.
"""

from __future__ import annotations

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.approximation.objective import Candidate, Problem
from planner.approximation.requirements import BARELY_SHORT, held
from planner.approximation.together import descend_all

MOVES = (-1.0, 1.0, -2.0, 2.0, -5.0, 5.0)
"""What a knot is moved by [samples]."""

ROUNDS = 4
"""Evaluations after which the best of them is chosen."""

TURNS = 4
"""Times that this is done over, as long as it helps."""

HELPS = 1e-4
"""Relative decrease of the squared error that is worth another turn."""


def nudged(problem: Problem, curve: Candidate) -> Candidate:
    """A curve that moves of single knots, each followed downhill, lead to; never a worse one."""
    best = curve
    for _ in range(TURNS):
        starts = [best, *moved(problem, best)]
        found = min(descend_all(problem, starts, rounds=ROUNDS), key=lambda other: other.error)
        gained = best.error - found.error
        if gained <= 0.0:
            break
        best = found
        if gained <= HELPS * best.error:
            break
    return best


def moved(problem: Problem, curve: Candidate) -> list[Candidate]:
    """The curves with one knot moved along the curve; their errors are left to be found."""
    along = PiecewiseLinear(
        knots=curve.knots,
        values=curve.values,
        samples=problem.samples,
        tick=1.0,
        cyclic=problem.cyclic,
    )
    movable = np.flatnonzero(~held(problem, curve.knots)[0])
    moves = np.tile(MOVES, movable.size)
    which = np.repeat(movable, len(MOVES))
    knots = np.tile(curve.knots, (which.size, 1))
    row = np.arange(which.size)
    knots[row, which] += moves
    ends = knots
    if problem.cyclic:
        ends = np.concatenate([knots, knots[:, :1] + problem.samples], axis=1)
    possible = np.min(np.diff(ends, axis=1), axis=1) >= problem.shortest - BARELY_SHORT
    values = np.tile(curve.values, (which.size, 1))
    values[row, which] = along(knots[row, which])
    return [
        Candidate(k, v, curve.error) for k, v in zip(knots[possible], values[possible], strict=True)
    ]
