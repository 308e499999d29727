"""Where to put the knots: proposals on a grid of samples, best of all by a shortest path.

A segment from sample i to sample j has a price that needs no other segment, so the cheapest chain
of a given number of segments is a shortest path. Two prices are used, as they fail on different
data:

- `chord`: the segment joins two points of the ideal sequence; within the slopes and continuous at
  once, but at the mercy of noise at the two points;
- `line`: the segment is the best line with a slope within the bounds through its own samples;
  indifferent to noise, but the lines need not meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from planner.trajectory import Array

Price = Literal["chord", "line"]

FINEST_GRID = 256
"""Most nodes a shortest path is searched on: prices take this number squared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moments:
    """Running sums over the samples, from which any segment is priced in constant time.

    Attributes:
        desired: The samples, shape (n,); a cycle starts with its seam and repeats it at the end.
        ideal: The slope-bounded ideal, shape (n,).
    """

    desired: Array
    ideal: Array

    @cached_property
    def sums(self) -> tuple[Array, Array, Array]:
        """Sums of d, k d and d² over the samples up to each k, shape (n,) each."""
        k = np.arange(self.desired.size, dtype=np.float64)
        return (
            np.cumsum(self.desired),
            np.cumsum(k * self.desired),
            np.cumsum(self.desired**2),
        )


def prices(moments: Moments, nodes: npt.NDArray[np.intp], step: float, price: Price) -> Array:
    """Squared error of a segment between any two nodes, over the samples after the first of them.

    Args:
        moments: Sums over the samples.
        nodes: Sample indices where knots may lie, shape (m,), increasing.
        step: Largest change per sample.
        price: Which price, see the module.

    Returns:
        Prices, shape (m, m), infinite on and below the diagonal.
    """
    start, end = nodes[:, None], nodes[None, :]
    length = np.maximum(end - start, 1).astype(np.float64)
    d0, d1, d2 = (s[end] - s[start] for s in moments.sums)
    d1 = d1 - start * d0
    k1 = length * (length + 1.0) / 2.0
    k2 = k1 * (2.0 * length + 1.0) / 3.0
    if price == "chord":
        a = moments.ideal[start]
        m = (moments.ideal[end] - a) / length
        error = length * a * a + 2.0 * a * m * k1 + m * m * k2 - 2.0 * (a * d0 + m * d1) + d2
    else:
        sxx = k2 - k1 * k1 / length
        sxy = d1 - k1 * d0 / length
        m = np.clip(sxy / np.maximum(sxx, 1e-9), -step, step)
        error = d2 - d0 * d0 / length + m * (m * sxx - 2.0 * sxy)
    error = np.maximum(error, 0.0)
    error[end <= start] = np.inf
    return np.asarray(error)


def shortest_chains(table: Array, most: int) -> list[npt.NDArray[np.intp]]:
    """Cheapest chains from the first node to the last, of 1, 2, ..., ``most`` segments.

    Args:
        table: Prices, shape (m, m).
        most: Largest number of segments, < m.

    Returns:
        For each number of segments the nodes on the way, both ends included.
    """
    cost = np.full(table.shape[0], np.inf)
    cost[0] = 0.0
    came_from = []
    chains = []
    for segments in range(1, most + 1):
        through = cost[:, None] + table
        best = np.argmin(through, axis=0)
        cost = through[best, np.arange(best.size)]
        came_from.append(best)
        chain = [table.shape[0] - 1]
        for level in range(segments - 1, -1, -1):
            chain.append(int(came_from[level][chain[-1]]))
        chains.append(np.array(chain[::-1], dtype=np.intp))
    return chains
