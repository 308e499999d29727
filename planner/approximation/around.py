"""What is tried around a rough curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.approximation.nudged import nudged
from planner.approximation.objective import Candidate, Problem
from planner.approximation.requirements import held
from planner.approximation.together import all_best_values, descend_all
from planner.approximation.tube import GRIDS, rechained
from planner.trajectory import Array

ROUGH = 1e-3
"""Relative decrease of the squared error below which a rough descent ends."""

ROUNDS = 15
"""Most evaluations of a descent from a chain."""

FINALISTS = 2
"""Curves whose single knots are moved. One: 0.05 % more error in the mean, 19 % at worst; three:
0.003 % less for a tenth more time."""

APART = 1.0
"""Distance between knots [samples] from which on two curves differ."""


def around(problem: Problem, ideal: Array, rough: Sequence[Candidate]) -> Candidate:
    """The best curve found from whole chains on grids, and by moves of single knots.

    Args:
        problem: What to approximate.
        ideal: Its slope-bounded ideal, shape (n,).
        rough: Curves of as many segments, the best first, at most ``LARGEST_WINDOW`` knots.
    """
    best = rough[0]
    anchor = _sharpest_knot(problem, best) if problem.cyclic else 0
    chains = (rechained(problem, ideal, best, grid, anchor=anchor) for grid in GRIDS)
    starts = all_best_values(problem, [knots for knots in chains if knots is not None])
    begun = descend_all(problem, [*starts, *rough[:FINALISTS]], rounds=ROUNDS, progress=ROUGH)
    begun.sort(key=_error)
    if problem.whole or problem.required.size:
        return begun[0]
    return min((nudged(problem, curve) for curve in _apart(begun)[:FINALISTS]), key=_error)


def _sharpest_knot(problem: Problem, curve: Candidate) -> int:
    """Number of the knot of a cycle at which the slope changes most, a required one if any is."""
    ends = np.append(curve.knots, curve.knots[0] + problem.samples)
    slopes = np.diff(np.append(curve.values, curve.values[0])) / np.diff(ends)
    bend = np.abs(slopes - np.roll(slopes, 1))
    if problem.required.size:
        fixed = held(replace(problem, whole=False), curve.knots)[0]
        bend = np.where(fixed, bend, -1.0)
    return int(np.argmax(bend))


def _apart(curves: list[Candidate]) -> list[Candidate]:
    """Those of the curves that have other knots than all before them."""
    chosen: list[Candidate] = []
    for curve in curves:
        knots = np.sort(curve.knots)
        if all(np.max(np.abs(knots - np.sort(other.knots))) > APART for other in chosen):
            chosen.append(curve)
    return chosen


def _error(curve: Candidate) -> float:
    return curve.error
