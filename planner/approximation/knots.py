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

from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from planner.approximation.moments import Moments, between, running
from planner.approximation.objective import Problem
from planner.approximation.requirements import allowed, grid_of, in_place, nodes_of
from planner.trajectory import Array

Price = Literal["chord", "line"]
Kind = TypeVar("Kind", bound=np.generic)
PRICES: tuple[Price, ...] = ("chord", "line")

FINEST_GRID = 128
"""Most nodes of a grid: prices take this number squared."""

ANCHORS = 6
"""Places of a cycle at which chains begin and end; the sharpest corner is one of them."""


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
        self._all_nodes = nodes
        self._tables = {}
        self._costs = {}
        self._came_from: dict[Price, list[npt.NDArray[np.intp]]] = {}
        # Sums, taken at the nodes once: of a path's segments by end and start, of a cycle's by end
        # and place of the start among as many nodes before it, as they recur.
        totals = [each.take(nodes, axis=-1) for each in running(np.array(sides[:2]), sides[2])]
        if problem.cyclic:
            begun = [_windows(each, count) for each in totals]
            start = _windows(nodes, count)
            ends = slice(count, 2 * count)
        else:
            begun = [each[..., None, :] for each in totals]
            start, ends = nodes[None, :], slice(None)
        end = nodes[ends, None]
        ended = [each[..., ends, None] for each in totals]
        sums = between(start, begun, ended)
        possible = allowed(problem, start, end)
        for price in PRICES:
            table = prices(sides[1], sums, start, end, step=problem.step, price=price)
            table[~possible] = np.inf
            # By end and start, as the least of a row is found faster than that of a column.
            self._tables[price] = _begun_at(table, self._starts) if problem.cyclic else table[None]
            costs = np.full((self._starts.size, count + 1), np.inf)
            costs[:, 0] = 0.0
            self._costs[price] = [costs]
            self._came_from[price] = []
        self._cyclic = problem.cyclic

    def __call__(self, segments: int) -> list[Array]:
        """The cheapest chain of ``segments`` for each price and anchor; none beyond the grid."""
        proposals: dict[bytes, Array] = {}
        if segments >= self.nodes.size:
            return []
        for price in PRICES:
            self._extend(price, segments)
            totals = self._costs[price][segments][:, -1]
            for anchor in np.argsort(totals, kind="stable"):
                if not np.isfinite(totals[anchor]):
                    break
                chain = self._chain(price, segments, int(anchor))
                key = np.sort(chain % self.nodes[-1] if self._cyclic else chain).tobytes()
                if key not in proposals:
                    knots = in_place(self._problem, chain.astype(np.float64))
                    if knots is not None:
                        proposals[key] = knots
        return list(proposals.values())

    def _extend(self, price: Price, segments: int) -> None:
        """Make the costs and the ways of up to ``segments`` segments known."""
        table, costs, came_from = self._tables[price], self._costs[price], self._came_from[price]
        while len(came_from) < segments:
            through = costs[-1][:, None, :] + table
            best = np.argmin(through, axis=2)
            costs.append(np.take_along_axis(through, best[:, :, None], axis=2)[:, :, 0])
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


def _windows(along: npt.NDArray[Kind], count: int) -> npt.NDArray[Kind]:
    """What belongs to ``count`` nodes in a row and the next, shape (..., count, count + 1)."""
    return sliding_window_view(along, count + 1, axis=-1)[..., :count, :]


def _begun_at(table: Array, starts: npt.NDArray[np.intp]) -> Array:
    """Prices in a cycle cut at these nodes.

    Args:
        table: Price by end and place of the start among the nodes from a turn before to the end,
            shape (m, m + 1), infinite for the last.
        starts: Nodes at which the cycle begins, shape (a,).

    Returns:
        Prices by end and start, each counted from the cut, shape (a, m + 1, m + 1).
    """
    count = table.shape[0]
    width = 2 * count
    padded = np.full((width + 1, width + 1), np.inf)
    padded[:count, : count + 1] = padded[count:width, : count + 1] = table
    # A row shorter by one, each begins a place earlier: places become starts.
    along = padded.ravel()
    tables = []
    for first in starts.tolist():
        skewed = along[first * (width + 1) + count :][: (count + 1) * width]
        tables.append(skewed.reshape(count + 1, width)[:, : count + 1])
    return np.array(tables)


def prices(
    ideal: Array,
    sums: Moments,
    start: npt.NDArray[np.intp],
    end: npt.NDArray[np.intp],
    *,
    step: float,
    price: Price,
) -> Array:
    """Squared errors of segments, each over the samples after its start.

    Args:
        ideal: The slope-bounded ideal of the samples, shape (n,).
        sums: Over the samples and over the ideal, one after the other, for every segment.
        start: Samples where the segments start, of any shape.
        end: Samples where they end, of the same shape.
        step: Largest change per sample.
        price: Which price, see the module.

    Returns:
        Prices, of the same shape, infinite where a segment does not end after its start.
    """
    which = 0 if price == "chord" else 1
    w0, w1, w2 = sums.w0, sums.w1, sums.w2
    d0, d1, d2 = sums.d0[which], sums.d1[which], sums.d2[which]
    if price == "chord":
        a = ideal[start]
        m = (ideal[end] - a) / np.maximum(end - start, 1)
        error = w0 * a * a + 2.0 * a * m * w1 + m * m * w2
        error -= 2.0 * (a * d0 + m * d1) - d2
    else:
        weight = np.where(end > start, w0, 1.0)
        sxx = w2 - w1 * w1 / weight
        sxy = d1 - w1 * d0 / weight
        m = np.clip(sxy / np.maximum(sxx, 1e-9), -step, step)
        error = d2 - d0 * d0 / weight + m * (m * sxx - 2.0 * sxy)
    error = np.maximum(error, 0.0)
    error[end <= start] = np.inf
    return np.asarray(error)
