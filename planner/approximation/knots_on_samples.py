"""Knots on samples, moved one at a time to the next samples as long as that helps."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter

import numpy as np

from planner.approximation.problem import Candidate, Problem, required_knots
from planner.approximation.sqp import best_values
from planner.trajectory import Array

MOVES = (-1.0, 1.0, -2.0, 2.0, -4.0, 4.0)
"""What a knot is moved by [samples]."""

HELPS = 1e-12
"""Relative decrease of the squared error that counts as one."""


class KnotsOnSamples:
    """Curves of best values at sets of knots on samples, each solved once."""

    def __init__(self, problem: Problem) -> None:
        """Nothing is solved yet."""
        self._problem = problem
        self._solved: dict[tuple[float, ...], Candidate] = {}

    def curve(self, knots: Array) -> Candidate:
        """The curve of best values at these knots."""
        return self.curves([knots])[0]

    def curves(self, several: Sequence[Array]) -> list[Candidate]:
        """The curves of best values at as many knots each."""
        keys = [tuple(np.asarray(knots, dtype=np.float64).tolist()) for knots in several]
        new = [key for key in dict.fromkeys(keys) if key not in self._solved]
        found = best_values(self._problem, [np.array(key) for key in new])
        self._solved.update(zip(new, found, strict=True))
        return [self._solved[key] for key in keys]

    def moved(self, knots: Array) -> Candidate:
        """The best curve that moves of single knots, and of pairs of neighbours, lead to."""
        best = self.curve(knots)
        size = best.knots.size
        movable = ~required_knots(self._problem, best.knots)[0]
        groups = [[k] for k in range(size)] + [[k, (k + 1) % size] for k in range(size)]
        groups = [group for group in groups if size > 1 and np.all(movable[group])]
        improved = True
        while improved:
            improved = False
            for group in groups:
                moves = np.zeros((len(MOVES), size))
                moves[:, group] = np.array(MOVES)[:, None]
                tried = [each for each in best.knots + moves if self._problem.long_enough(each)]
                other = min(self.curves(tried), key=attrgetter("error"), default=best)
                if other.error < (1.0 - HELPS) * best.error:
                    best, improved = other, True
        return best
