"""The best curve found for each number of segments."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from planner.approximation.descent import LARGEST_WINDOW, best_values, descend
from planner.approximation.ideal import slope_bounded
from planner.approximation.knots import FINEST_GRID, Moments, Price, prices, shortest_chains
from planner.approximation.objective import Iterate, Problem, evaluate
from planner.approximation.values import solve_values
from planner.trajectory import Array

ROUNDS = 25
"""Most evaluations of one descent."""


class Search:
    """Curves of any number of segments through the same samples, each found once.

    A cycle is searched from its sharpest corner on, so that a cycle which starts elsewhere gives
    the same curve.
    """

    def __init__(self, desired: Array, step: float, *, cyclic: bool) -> None:
        """Find the ideal and the place to start.

        Args:
            desired: Samples of size one or less, shape (n,).
            step: Largest change per sample.
            cyclic: Whether the first sample follows the last.
        """
        ideal = slope_bounded(desired, step, cyclic=cyclic)
        self.seam = _sharpest_corner(ideal) if cyclic else 0
        self.ideal = np.roll(ideal, -self.seam)
        self.problem = Problem(desired=np.roll(desired, -self.seam), step=step, cyclic=cyclic)
        self._found: dict[int, Iterate] = {}

    @property
    def fewest(self) -> int:
        """Least number of segments of a curve that is not a constant."""
        return 2 if self.problem.cyclic else 1

    @property
    def most(self) -> int:
        """Most segments that the samples allow."""
        n = self.problem.samples
        return n if self.problem.cyclic else n - 1

    @cached_property
    def ideal_error(self) -> float:
        """Squared error of the ideal: no curve within the slopes has less."""
        return float(np.sum((self.ideal - self.problem.desired) ** 2))

    def curve(self, segments: int) -> Iterate:
        """The best curve found with this number of segments."""
        if segments not in self._found:
            self._found[segments] = self._improve(segments)
        return self._found[segments]

    def placed(self, curve: Iterate) -> tuple[Array, Array]:
        """Knots within the cycle of the samples as they were given, in order, and their values."""
        if not self.problem.cyclic:
            return curve.knots, curve.values
        # Powers of two make sums and differences of knots exact.
        exact = np.round(curve.knots * 2.0**32) / 2.0**32
        knots = np.mod(exact + self.seam, self.problem.samples)
        order = np.argsort(knots)
        return knots[order], curve.values[order]

    def _improve(self, segments: int) -> Iterate:
        problem = self.problem
        candidates = []
        for price in ("chord", "line"):
            knots = self._proposed(price, segments)
            if knots is not None:
                candidates.append(self._descend(knots))
        if segments - 1 in self._found or (self.fewest < segments <= LARGEST_WINDOW):
            knots = _with_one_more(problem, self.curve(segments - 1))
            candidates.append(self._descend(knots))
        return min(candidates, key=lambda curve: curve.error)

    def _descend(self, knots: Array) -> Iterate:
        problem = self.problem
        free = np.ones(2 * knots.size, dtype=bool)
        if not problem.cyclic:
            free[[0, knots.size - 1]] = False
        if knots.size > LARGEST_WINDOW:
            return evaluate(problem, knots, solve_values(problem, knots))
        values = best_values(problem, knots)
        return descend(problem, knots, values, free=free, rounds=ROUNDS)

    @cached_property
    def _nodes(self) -> np.ndarray:
        last = self.problem.samples if self.problem.cyclic else self.problem.samples - 1
        return np.unique(np.round(np.linspace(0, last, min(last, FINEST_GRID) + 1))).astype(np.intp)

    def _proposed(self, price: Price, segments: int) -> Array | None:
        """Knots of the cheapest chain."""
        if segments > self._nodes.size - 1:
            return None
        wrap = slice(0, 1 if self.problem.cyclic else 0)
        moments = Moments(
            desired=np.append(self.problem.desired, self.problem.desired[wrap]),
            ideal=np.append(self.ideal, self.ideal[wrap]),
        )
        table = prices(moments, self._nodes, self.problem.step, price)
        chain = self._nodes[shortest_chains(table, segments)[-1]].astype(np.float64)
        return chain[:-1] if self.problem.cyclic else chain


def _sharpest_corner(ideal: Array) -> int:
    reach = max(1, ideal.size // 32)
    bend = np.abs(np.roll(ideal, -reach) - 2.0 * ideal + np.roll(ideal, reach))
    return int(np.argmax(bend))


def _with_one_more(problem: Problem, curve: Iterate) -> Array:
    """The knots and one more, in the middle of the longest of the worst segments."""
    ends = curve.knots
    if problem.cyclic:
        ends = np.append(ends, ends[0] + problem.samples)
    index = np.arange(problem.samples, dtype=np.float64)
    if problem.cyclic:
        index = ends[0] + np.mod(index - ends[0], problem.samples)
    values = np.append(curve.values, curve.values[0]) if problem.cyclic else curve.values
    residual = np.interp(index, ends, values) - problem.desired
    segment = np.clip(np.searchsorted(ends, index, side="right") - 1, 0, ends.size - 2)
    worst = np.bincount(segment, residual**2, minlength=ends.size - 1)
    worst[np.diff(ends) < 2.0 * problem.shortest] = -1.0
    split = int(np.argmax(worst))
    return np.insert(curve.knots, split + 1, 0.5 * (ends[split] + ends[split + 1]))
