"""Knots for many segments: neighbours merged one pair at a time, from every sample a segment down.

The order of the merges gives the knots for every number of segments, each set within the next, in
O(n log n) once.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np

from planner.approximation.objective import Problem
from planner.trajectory import Array


class MergedKnots:
    """Knots on samples for any number of segments, by greedy merging."""

    def __init__(self, problem: Problem) -> None:
        """Merge until one segment is left, and note the order."""
        self._cyclic = problem.cyclic
        n = problem.samples
        last = n if problem.cyclic else n - 1
        desired = np.resize(problem.desired, last + 1)
        self._price = _LinePrice(desired, problem.step)
        self._last = last
        self._removed = np.array(self._merge(), dtype=np.intp)

    def __call__(self, segments: int) -> Array:
        """Knots for so many segments, a cycle's first at its first sample."""
        keep = np.concatenate([[0, self._last], self._removed[self._removed.size - segments + 1 :]])
        knots = np.sort(keep).astype(np.float64)
        return knots[:-1] if self._cyclic else knots

    def _merge(self) -> list[int]:
        """Inner samples in the order in which they cease to be knots."""
        price, last = self._price, self._last
        before = list(range(-1, last))
        after = list(range(1, last + 2))
        own = [price(k, k + 1) for k in range(last)]  # of the segment that starts at k

        def loss(knot: int) -> float:
            return price(before[knot], after[knot]) - own[before[knot]] - own[knot]

        version = [0] * (last + 1)
        queue = [(loss(knot), knot, 0) for knot in range(1, last)]
        heapify(queue)
        removed = []
        while queue:
            _, knot, seen = heappop(queue)
            if seen != version[knot]:
                continue
            removed.append(knot)
            version[knot] = -1
            left, right = before[knot], after[knot]
            own[left] = price(left, right)
            after[left], before[right] = right, left
            for neighbour in (left, right):
                if 0 < neighbour < last:
                    version[neighbour] += 1
                    heappush(queue, (loss(neighbour), neighbour, version[neighbour]))
        return removed


class _LinePrice:
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
        d0 = s0[j + 1] - s0[i]
        d1 = s1[j + 1] - s1[i] - 0.5 * (i + j) * d0  # about the middle
        sxx = count * (count * count - 1) / 12.0
        slope = min(max(d1 / sxx, -self._step), self._step)
        error: float = s2[j + 1] - s2[i] - d0 * d0 / count + slope * (slope * sxx - 2.0 * d1)
        return max(error, 0.0)
