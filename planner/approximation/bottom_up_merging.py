"""Knots for many segments: neighbours merged one pair at a time, from every sample a segment down.

The order of the merges gives the knots for every number of segments, each set within the next, in
O(n log n) once.
"""

from __future__ import annotations

from dataclasses import replace
from heapq import heapify, heappop, heappush

import numpy as np

from planner.approximation.problem import Problem, even_knots, nearest_samples, with_required
from planner.trajectory import Array


class MergedKnots:
    """Knots on samples for any number of segments, by greedy merging."""

    def __init__(self, problem: Problem) -> None:
        """Merge until no knot is left that may go, and note the order."""
        self._problem = problem
        n = problem.samples
        every: Array = np.arange(n, dtype=np.float64)
        if problem.required.size:
            nearest = nearest_samples(problem.required).astype(np.float64)
            every = even_knots(replace(problem, required=nearest))
        last = n if problem.cyclic else n - 1
        self._first = int(every[0])
        self._grid = problem.ends(every)
        self._grid = (self._grid - self._first).astype(np.intp)
        turned = np.resize(np.roll(problem.desired, -self._first), last + 1)
        self._cost = _LineCost(turned, problem.step)
        fixed = nearest_samples(problem.required) - self._first
        stays = np.isin(self._grid, np.mod(fixed, n) if problem.cyclic else fixed)
        stays[[0, -1]] = True
        self._removed = np.array(self._merge(stays.tolist()), dtype=np.intp)
        self._stay = self._grid[stays]

    def __call__(self, segments: int) -> Array | None:
        """Knots for so many segments, a cycle's first at its first sample; None if too many."""
        more = segments + 1 - self._stay.size
        if not 0 <= more <= self._removed.size:
            return None
        keep = np.append(self._stay, self._removed[self._removed.size - more :])
        knots = np.sort(keep).astype(np.float64) + self._first
        return with_required(self._problem, knots[:-1] if self._problem.cyclic else knots)

    def _merge(self, stays: list[bool]) -> list[int]:
        """Samples in the order in which they cease to be knots."""
        grid = [int(k) for k in self._grid]
        cost, last = self._cost, len(grid) - 1
        before = list(range(-1, last))
        after = list(range(1, last + 2))
        own = [cost(grid[k], grid[k + 1]) for k in range(last)]  # of the segment from k on

        def loss(knot: int) -> float:
            joined = cost(grid[before[knot]], grid[after[knot]])
            return joined - own[before[knot]] - own[knot]

        version = [0] * (last + 1)
        queue = [(loss(knot), knot, 0) for knot in range(1, last) if not stays[knot]]
        heapify(queue)
        removed = []
        while queue:
            _, knot, seen = heappop(queue)
            if seen != version[knot]:
                continue
            removed.append(grid[knot])
            version[knot] = -1
            left, right = before[knot], after[knot]
            own[left] = cost(grid[left], grid[right])
            after[left], before[right] = right, left
            for neighbour in (left, right):
                if not stays[neighbour]:
                    version[neighbour] += 1
                    heappush(queue, (loss(neighbour), neighbour, version[neighbour]))
        return removed


class _LineCost:
    """Squared error of the best line within the slopes through the samples from i to j."""

    def __init__(self, desired: Array, step: float) -> None:
        k = np.arange(desired.size, dtype=np.float64)
        self._sums: list[list[float]] = [
            np.concatenate([[0.0], np.cumsum(total)]).tolist()
            for total in (desired, k * desired, desired**2)
        ]
        self._step = step

    def __call__(self, i: int, j: int) -> float:
        s0, s1, s2 = self._sums
        count = j + 1 - i
        middle, sxx = 0.5 * (i + j), count * (count * count - 1) / 12.0
        d0 = s0[j + 1] - s0[i]
        d1 = s1[j + 1] - s1[i] - middle * d0  # about the middle
        slope = min(max(d1 / sxx, -self._step), self._step)
        error: float = s2[j + 1] - s2[i] - d0 * d0 / count + slope * (slope * sxx - 2.0 * d1)
        return max(error, 0.0)
