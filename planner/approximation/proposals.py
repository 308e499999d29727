"""Knots proposed on grids of samples, from which descents start.

A segment from one sample to another has a cost that needs no other segment, so the cheapest chain
of a given number of segments is a shortest path (Bellman, On the approximation of curves by line
segments using dynamic programming, 1961; (5a) of docs/math.md). Three costs are used, as they
fail on different data:

- `chord`: the segment joins two points of the ideal sequence; within the slopes and continuous at
  once, but sensitive to noise at the two points;
- `line`: the segment is the best line with a slope within the bounds through its own samples of the
  ideal; insensitive to noise, but the lines need not meet. Of 150 fits of 2 to 15 segments 7 % are
  worse by 0.1 % or more without it, by 21 % at worst, and 13 % without chords, by 7 % at worst;
- of a lattice, :func:`lattice_chain`: at each node a few angles around the ideal may be taken, and
  a segment between two of these states has its exact squared error as its cost, infinite if it is
  too steep. So the cheapest chain is continuous, within the slopes, and best of all on the lattice.

Many segments come from :class:`MergedKnots`, bottom-up merging.
"""

from __future__ import annotations

from dataclasses import replace
from heapq import heapify, heappop, heappush

import numpy as np
import numpy.typing as npt

from planner.approximation.problem import (
    Candidate,
    Problem,
    even_knots,
    nearest_samples,
    with_required,
)
from planner.trajectory import Array

Indices = npt.NDArray[np.intp]

NODES = 128
"""Most nodes of a grid without angles: costs take this number squared. 64: 2.5 % of the fits at
n = 88 worse by 0.1 %, by 2 % at worst; 256: no change there."""

ANCHORS = 6
"""Places of a cycle at which chains begin and end, its sharpest corner among them. 3: 0.03 % more
error in the mean, 6 % at worst."""


def chain_proposals(problem: Problem, ideal: Array, segments: int) -> list[Array]:
    """Knots of the cheapest chains by chord and by line, without duplicates.

    Args:
        problem: The approximation problem; a cycle begins where a knot is likely.
        ideal: Its slope-bounded ideal, shape (n,).
        segments: Number of segments.
    """
    from planner.approximation import kernel

    n = problem.samples
    last = n if problem.cyclic else n - 1
    fixed = np.unique(nearest_samples(problem.required) % n)
    nodes = np.round(np.linspace(0, last, min(last, NODES) + 1)).astype(np.intp)
    nodes = np.union1d(nodes % n, fixed)
    starts = np.zeros(1, dtype=np.intp)
    if problem.cyclic:
        even = nodes[np.unique(np.arange(ANCHORS) * nodes.size // ANCHORS)]
        starts = fixed[:ANCHORS] if fixed.size else even
    proposals: dict[bytes, Array] = {}
    for by_chord in (True, False):
        for first in starts.tolist():
            grid, around, stays = _grid(problem, nodes, fixed, first)
            desired, sequence = problem.desired[around], ideal[around]
            if by_chord:
                states = sequence[grid][:, None]
                costs = kernel.chord_costs(desired, problem.step, grid, states, stays)
            else:
                costs = kernel.line_costs(sequence, problem.step, grid, stays)
            way = kernel.cheapest_chain(costs, np.zeros(1), segments)
            knots = _knots(problem, grid, way, first)
            if knots is not None:
                order = np.sort(knots % n if problem.cyclic else knots)
                proposals.setdefault(order.tobytes(), knots)
    return list(proposals.values())


def _grid(
    problem: Problem, nodes: Indices, fixed: Indices, first: int
) -> tuple[Indices, Indices, npt.NDArray[np.bool_]]:
    """Nodes after a sample, a cycle's end included, all samples from there, and fixed nodes."""
    n = problem.samples
    if not problem.cyclic:
        return nodes, np.arange(n), np.isin(nodes, fixed)
    grid = np.append(np.sort((nodes - first) % n), n)
    return grid, np.arange(first, first + n + 1) % n, np.isin(grid, (fixed - first) % n)


def _knots(problem: Problem, grid: Indices, way: Indices, first: int) -> Array | None:
    """Knots of a chain of nodes, a cycle's without its end; None if there is none."""
    if not way.size:
        return None
    way = way[:-1] if problem.cyclic else way
    return with_required(problem, grid[way].astype(np.float64) + first)


def lattice_chain(
    problem: Problem,
    ideal: Array,
    curve: Candidate,
    *,
    nodes: int,
    offsets: tuple[float, ...],
    anchor: int,
) -> Array | None:
    """Knots of the cheapest chain with as many segments on a grid.

    Args:
        problem: The approximation problem.
        ideal: Its slope-bounded ideal, shape (n,).
        curve: Sets the number of segments and the distance from the ideal.
        nodes: Places where knots may lie, if the samples are as many; four for every segment where
            that is more. The cost of a chain takes this number squared.
        offsets: Angles that a knot may have around the ideal, in units of the curve's rms error.
        anchor: Number of the knot that is kept, for a cycle.

    Returns:
        Knots; None if no chain is within the slopes.
    """
    from planner.approximation import kernel

    n, segments = problem.samples, problem.segments(curve.knots)
    first = round(float(curve.knots[anchor])) if problem.cyclic else 0
    last = n if problem.cyclic else n - 1
    fixed = nearest_samples(problem.required) % n
    places = np.linspace(0, last, min(last, max(nodes, 4 * segments)) + 1)
    even = (np.round(places).astype(np.intp) + first) % n
    grid, around, stays = _grid(problem, np.union1d(even, fixed), fixed, first)
    desired, unit = problem.desired[around], float(np.sqrt(curve.error / n))
    states = ideal[around][grid][:, None] + unit * np.array(offsets)
    if problem.cyclic:
        states[[0, -1], 0] = float(np.interp(first, curve.knots, curve.values, period=n))
        states[[0, -1], 1:] = np.inf
    for place, pin in zip((fixed - first) % n, problem.pins, strict=True):
        if np.isfinite(pin):
            states[grid % n == place] = np.inf
            states[grid % n == place, 0] = pin
    costs = kernel.chord_costs(desired, problem.step, grid, states, stays)
    way = kernel.cheapest_chain(costs, (states[0] - desired[0]) ** 2, segments)
    return _knots(problem, grid, way // len(offsets), first)


class MergedKnots:
    """Knots on samples for any number of segments: neighbours merged one pair at a time.

    From a segment between any two samples down. The order of the merges gives the knots for every
    number of segments, each set within the next, in O(n log n) once.
    """

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
