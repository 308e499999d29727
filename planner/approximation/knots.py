"""Where to put the knots: proposals on a grid of samples, each the cheapest chain of segments.

A segment from one sample to another has a price that needs no other segment, so the cheapest chain
of a given number of segments is a shortest path. Two prices are used, as they fail on different
data:

- `chord`: the segment joins two points of the ideal sequence; within the slopes and continuous at
  once, but at the mercy of noise at the two points;
- `line`: the segment is the best line with a slope within the bounds through its own samples of the
  ideal; indifferent to noise, but the lines need not meet.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from planner.approximation.moments import moments
from planner.approximation.objective import Problem
from planner.approximation.requirements import allowed, grid_of, in_place, nodes_of
from planner.trajectory import Array

Price = Literal["chord", "line"]
PRICES: tuple[Price, ...] = ("chord", "line")

FINEST_GRID = 128
"""Most nodes of a grid: prices take this number squared."""

ANCHORS = 6
"""Places of a cycle at which chains begin and end; the sharpest corner is one of them."""

PROPOSALS = 2
"""Chains that are proposed for every price."""


class KnotProposals:
    """Knots for any number of segments; one segment more costs O(m²) for m nodes of the grid."""

    def __init__(self, problem: Problem, ideal: Array) -> None:
        """Price all segments between nodes.

        Args:
            problem: What to approximate; a cycle begins where a knot is likely.
            ideal: Its slope-bounded ideal, shape (n,).
        """
        last = problem.samples if problem.cyclic else problem.samples - 1
        count = min(last, FINEST_GRID)
        self._problem = problem
        self.nodes = grid_of(problem, last, count)
        count = self.nodes.size - 1
        sides = [problem.desired, ideal, problem.weights]
        if not problem.cyclic:
            self._starts = np.zeros(1, dtype=np.intp)
            nodes = self.nodes
        else:
            self._starts = np.unique(np.arange(ANCHORS) * count // ANCHORS)
            if problem.required.size:
                fixed = np.unique(nodes_of(problem.required) % last)
                self._starts = np.searchsorted(self.nodes, fixed)[:ANCHORS]
            nodes = np.append(self.nodes[:-1], last + self.nodes)
            sides = [np.resize(side, 2 * last + 1) for side in sides]
        possible = allowed(problem, nodes[:, None], nodes[None, :])
        self._all_nodes = nodes
        self._tables = {}
        self._costs = {}
        self._came_from: dict[Price, list[npt.NDArray[np.intp]]] = {}
        for price in PRICES:
            table = prices(*sides, nodes=nodes, step=problem.step, price=price)
            table[~possible] = np.inf
            # One table for every place where the cycle may begin, shape (anchors, m + 1, m + 1).
            self._tables[price] = np.stack(
                [table[a : a + count + 1, a : a + count + 1] for a in self._starts]
            )
            start = np.full((self._starts.size, count + 1), np.inf)
            start[:, 0] = 0.0
            self._costs[price] = [start]
            self._came_from[price] = []
        self._cyclic = problem.cyclic

    def __call__(self, segments: int) -> list[Array]:
        """The cheapest chains of ``segments`` for either price, as knots; none beyond the grid."""
        proposals: dict[bytes, Array] = {}
        if segments >= self.nodes.size:
            return []
        for price in PRICES:
            self._extend(price, segments)
            totals = self._costs[price][segments][:, -1]
            new = 0
            for anchor in np.argsort(totals, kind="stable"):
                if not np.isfinite(totals[anchor]):
                    break
                chain = self._chain(price, segments, int(anchor))
                key = np.sort(chain % self.nodes[-1] if self._cyclic else chain).tobytes()
                if key not in proposals:
                    knots = in_place(self._problem, chain.astype(np.float64))
                    if knots is not None:
                        proposals[key] = knots
                    new += 1
                if new == PROPOSALS:
                    break
        return list(proposals.values())

    def _extend(self, price: Price, segments: int) -> None:
        """Make the costs and the ways of up to ``segments`` segments known."""
        table, costs, came_from = self._tables[price], self._costs[price], self._came_from[price]
        while len(came_from) < segments:
            through = costs[-1][:, :, None] + table
            best = np.argmin(through, axis=1)
            costs.append(np.take_along_axis(through, best[:, None, :], axis=1)[:, 0, :])
            came_from.append(best)

    def _chain(self, price: Price, segments: int, anchor: int) -> npt.NDArray[np.intp]:
        """The samples on the way, in order; of a cycle without its end."""
        chain = [self.nodes.size - 1]
        for level in reversed(self._came_from[price][:segments]):
            chain.append(int(level[anchor, chain[-1]]))
        way: npt.NDArray[np.intp] = self._all_nodes[
            int(self._starts[anchor]) + np.array(chain[::-1])
        ]
        return way[:-1] if self._cyclic else way


def prices(
    desired: Array,
    ideal: Array,
    weights: Array,
    *,
    nodes: npt.NDArray[np.intp],
    step: float,
    price: Price,
) -> Array:
    """Squared error of a segment between any two nodes, over the samples after the first of them.

    Args:
        desired: Samples, shape (n,).
        ideal: Their slope-bounded ideal, shape (n,).
        weights: Their weights, shape (n,).
        nodes: Samples where knots may lie, shape (m,), increasing.
        step: Largest change per sample.
        price: Which price, see the module.

    Returns:
        Prices, shape (m, m), infinite on and below the diagonal.
    """
    start, end = nodes[:, None], nodes[None, :]
    sums = moments(desired if price == "chord" else ideal, weights, start, end)
    if price == "chord":
        a = ideal[start]
        m = (ideal[end] - a) / np.maximum(end - start, 1)
        error = sums.w0 * a * a + 2.0 * a * m * sums.w1 + m * m * sums.w2
        error -= 2.0 * (a * sums.d0 + m * sums.d1) - sums.d2
    else:
        weight = np.where(end > start, sums.w0, 1.0)
        sxx = sums.w2 - sums.w1 * sums.w1 / weight
        sxy = sums.d1 - sums.w1 * sums.d0 / weight
        m = np.clip(sxy / np.maximum(sxx, 1e-9), -step, step)
        error = sums.d2 - sums.d0 * sums.d0 / weight + m * (m * sxx - 2.0 * sxy)
    error = np.maximum(error, 0.0)
    error[end <= start] = np.inf
    return np.asarray(error)
