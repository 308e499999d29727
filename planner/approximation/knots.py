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

from planner.approximation.objective import Problem
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
        self.nodes = np.round(np.linspace(0, last, count + 1)).astype(np.intp)
        if not problem.cyclic:
            self._starts = np.zeros(1, dtype=np.intp)
            nodes = self.nodes
            sides = problem.desired, ideal
        else:
            self._starts = np.unique(np.arange(ANCHORS) * count // ANCHORS)
            nodes = np.append(self.nodes[:-1], last + self.nodes)
            sides = np.resize(problem.desired, 2 * last + 1), np.resize(ideal, 2 * last + 1)
        self._all_nodes = nodes
        self._tables = {}
        self._costs = {}
        self._came_from: dict[Price, list[npt.NDArray[np.intp]]] = {}
        for price in PRICES:
            table = prices(*sides, nodes, problem.step, price)
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
                chain = self._chain(price, segments, int(anchor))
                key = np.sort(chain % self.nodes[-1] if self._cyclic else chain).tobytes()
                if key not in proposals:
                    proposals[key] = chain.astype(np.float64)
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
    desired: Array, ideal: Array, nodes: npt.NDArray[np.intp], step: float, price: Price
) -> Array:
    """Squared error of a segment between any two nodes, over the samples after the first of them.

    Args:
        desired: Samples, shape (n,).
        ideal: Their slope-bounded ideal, shape (n,).
        nodes: Samples where knots may lie, shape (m,), increasing.
        step: Largest change per sample.
        price: Which price, see the module.

    Returns:
        Prices, shape (m, m), infinite on and below the diagonal.
    """
    priced = desired if price == "chord" else ideal
    start, end = nodes[:, None], nodes[None, :]
    length = np.maximum(end - start, 1).astype(np.float64)
    k = np.arange(priced.size, dtype=np.float64)
    d0, d1, d2 = (
        total[end] - total[start]
        for total in (np.cumsum(priced), np.cumsum(k * priced), np.cumsum(priced**2))
    )
    d1 = d1 - start * d0
    k1 = length * (length + 1.0) / 2.0
    k2 = k1 * (2.0 * length + 1.0) / 3.0
    if price == "chord":
        a = ideal[start]
        m = (ideal[end] - a) / length
        error = length * a * a + 2.0 * a * m * k1 + m * m * k2 - 2.0 * (a * d0 + m * d1) + d2
    else:
        sxx = k2 - k1 * k1 / length
        sxy = d1 - k1 * d0 / length
        m = np.clip(sxy / np.maximum(sxx, 1e-9), -step, step)
        error = d2 - d0 * d0 / length + m * (m * sxx - 2.0 * sxy)
    error = np.maximum(error, 0.0)
    error[end <= start] = np.inf
    return np.asarray(error)
