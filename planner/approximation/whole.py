"""Knots on samples, moved one at a time to the next samples as long as that helps."""

from __future__ import annotations

import math

import numpy as np

from planner.approximation.descent import best_values
from planner.approximation.objective import Candidate, Problem
from planner.approximation.requirements import BARELY_SHORT, held, spread
from planner.trajectory import Array

MOVES = (-1.0, 1.0, -2.0, 2.0, -4.0, 4.0)
"""What a knot is moved by [samples]."""

HELPS = 1e-12
"""Relative decrease of the squared error that counts as one."""


class WholeKnots:
    """Curves of best values at sets of knots on samples, each solved once."""

    def __init__(self, problem: Problem) -> None:
        """Nothing is solved yet."""
        self._problem = problem
        self._solved: dict[tuple[float, ...], Candidate] = {}

    def curve(self, knots: Array) -> Candidate:
        """The curve of best values at these knots."""
        key = tuple(np.asarray(knots, dtype=np.float64).tolist())
        if key not in self._solved:
            self._solved[key] = best_values(self._problem, np.array(key))
        return self._solved[key]

    def nudged(self, knots: Array) -> Candidate:
        """The best curve that moves of single knots, and of pairs of neighbours, lead to."""
        best = self.curve(knots)
        size = best.knots.size
        movable = ~held(_anywhere(self._problem), best.knots)[0]
        groups = [[k] for k in range(size)] + [[k, (k + 1) % size] for k in range(size)]
        groups = [group for group in groups if size > 1 and np.all(movable[group])]
        improved = True
        while improved:
            improved = False
            for group in groups:
                for move in MOVES:
                    moved = best.knots.copy()
                    moved[group] += move
                    if self._possible(moved):
                        other = self.curve(moved)
                        if other.error < (1.0 - HELPS) * best.error:
                            best, improved = other, True
        return best

    def _possible(self, knots: Array) -> bool:
        problem = self._problem
        ends = np.append(knots, knots[0] + problem.samples) if problem.cyclic else knots
        return bool(np.min(np.diff(ends)) >= problem.shortest - BARELY_SHORT)


def rounded(problem: Problem, knots: Array) -> Array:
    """Knots on samples near ``knots``, no closer than the shortest segment, the held ones kept."""
    unit = math.ceil(problem.shortest - BARELY_SHORT)
    fixed = held(_anywhere(problem), knots)[0]
    whole = np.floor(knots + 0.5)
    ends = np.append(whole, whole[0] + problem.samples) if problem.cyclic else whole
    if np.min(np.diff(ends), initial=np.inf) >= unit:
        return whole
    for way in (1, -1):  # push apart, forwards and back
        order = range(1, whole.size) if way > 0 else range(whole.size - 2, -1, -1)
        for k in order:
            least = whole[k - way] + way * unit
            if not fixed[k] and way * (whole[k] - least) < 0.0:
                whole[k] = least
    ends = np.append(whole, whole[0] + problem.samples) if problem.cyclic else whole
    segments = whole.size if problem.cyclic else whole.size - 1
    return whole if np.min(np.diff(ends)) >= unit else spread(problem, segments)


def _anywhere(problem: Problem) -> Problem:
    from dataclasses import replace

    return replace(problem, whole=False)
