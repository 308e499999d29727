"""Knots proposed on grids of samples, from which descents start.

A segment from one sample to another has a cost that needs no other segment, so the cheapest chain
of a given number of segments is a shortest path (Bellman, On the approximation of curves by line
segments using dynamic programming, 1961; (5a) of docs/math.md). Three costs are used, as they
fail on different data:

- `chord`: the segment joins two points of the ideal sequence; within the slopes and continuous at
  once, but sensitive to noise at the two points;
- `line`: the segment is the best line with a slope within the bounds through its own samples of the
  ideal; insensitive to noise, but the lines need not meet;
- of a lattice, :func:`lattice_chain`: at each node a few angles around the ideal may be taken, and
  a segment between two of these states has its exact squared error as its cost, infinite if it is
  too steep. So the cheapest chain is continuous, within the slopes, and best of all on the lattice.

Many segments come from :class:`MergedKnots`, bottom-up merging.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from heapq import heapify, heappop, heappush
from typing import Literal, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from planner.approximation.problem import (
    Candidate,
    Problem,
    even_knots,
    nearest_samples,
    segment_allowed,
    with_required,
)
from planner.trajectory import Array

Indices = npt.NDArray[np.intp]
CostKind = Literal["chord", "line"]
Kind = TypeVar("Kind", bound=np.generic)
COST_KINDS: tuple[CostKind, ...] = ("chord", "line")

NODES = 128
"""Most nodes of a grid without angles: costs take this number squared. 64: 2.5 % of the fits at
n = 88 worse by 0.1 %, by 2 % at worst; 256: no change there."""

ANCHORS = 6
"""Places of a cycle at which chains begin and end, its sharpest corner among them."""


class ChainProposals:
    """Knots of any number of segments, by chord and by line; one more costs O(m²) for m nodes."""

    def __init__(self, problem: Problem, ideal: Array) -> None:
        """Work out the costs of all segments between nodes.

        Args:
            problem: What to approximate; a cycle begins where a knot is likely.
            ideal: Its slope-bounded ideal, shape (n,).
        """
        last = problem.samples if problem.cyclic else problem.samples - 1
        count = min(last, NODES)
        self._problem = problem
        nodes = np.round(np.linspace(0, last, count + 1)).astype(np.intp)
        fixed = nearest_samples(problem.required)
        self.nodes = np.union1d(nodes, np.mod(fixed, last) if problem.cyclic else fixed)
        count = self.nodes.size - 1
        sides = [problem.desired, ideal]
        if not problem.cyclic:
            self._starts = np.zeros(1, dtype=np.intp)
            nodes = self.nodes
        else:
            self._starts = np.unique(np.arange(ANCHORS) * count // ANCHORS)
            if problem.required.size:
                fixed = np.unique(nearest_samples(problem.required) % last)
                self._starts = np.searchsorted(self.nodes, fixed)[:ANCHORS]
            nodes = np.append(self.nodes[:-1], last + self.nodes)
            sides = [np.resize(side, 2 * last + 1) for side in sides]
        self._all_nodes = nodes
        self._tables = {}
        self._costs = {}
        self._came_from: dict[CostKind, list[Indices]] = {}
        # Sums, taken at the nodes once: of a path's segments by end and start, of a cycle's by end
        # and place of the start among as many nodes before it, as they recur.
        totals = [each.take(nodes, axis=-1) for each in running(np.array(sides))]
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
        possible = segment_allowed(problem, start, end)
        for kind in COST_KINDS:
            table = _segment_costs(sides[1], sums, start, end, step=problem.step, kind=kind)
            table[~possible] = np.inf
            # By end and start, as the least of a row is found faster than that of a column.
            self._tables[kind] = _begun_at(table, self._starts) if problem.cyclic else table[None]
            costs = np.full((self._starts.size, count + 1), np.inf)
            costs[:, 0] = 0.0
            self._costs[kind] = [costs]
            self._came_from[kind] = []
        self._cyclic = problem.cyclic

    def __call__(self, segments: int) -> list[Array]:
        """The cheapest chain of ``segments`` by cost and anchor; none beyond the grid."""
        proposals: dict[bytes, Array] = {}
        if segments >= self.nodes.size:
            return []
        for kind in COST_KINDS:
            self._extend(kind, segments)
            totals = self._costs[kind][segments][:, -1]
            for anchor in np.argsort(totals, kind="stable"):
                if not np.isfinite(totals[anchor]):
                    break
                chain = self._chain(kind, segments, int(anchor))
                key = np.sort(chain % self.nodes[-1] if self._cyclic else chain).tobytes()
                if key not in proposals:
                    knots = with_required(self._problem, chain.astype(np.float64))
                    if knots is not None:
                        proposals[key] = knots
        return list(proposals.values())

    def _extend(self, kind: CostKind, segments: int) -> None:
        """Make the costs and the ways of up to ``segments`` segments known."""
        table, costs, came_from = self._tables[kind], self._costs[kind], self._came_from[kind]
        while len(came_from) < segments:
            through = costs[-1][:, None, :] + table
            best = np.argmin(through, axis=2)
            costs.append(np.take_along_axis(through, best[:, :, None], axis=2)[:, :, 0])
            came_from.append(best)

    def _chain(self, kind: CostKind, segments: int, anchor: int) -> Indices:
        """The samples on the way, in order; of a cycle without its end."""
        chain = [self.nodes.size - 1]
        for level in reversed(self._came_from[kind][:segments]):
            chain.append(int(level[anchor, chain[-1]]))
        way: Indices = self._all_nodes[int(self._starts[anchor]) + np.array(chain[::-1])]
        return way[:-1] if self._cyclic else way


def _windows(along: npt.NDArray[Kind], count: int) -> npt.NDArray[Kind]:
    """What belongs to ``count`` nodes in a row and the next, shape (..., count, count + 1)."""
    return sliding_window_view(along, count + 1, axis=-1)[..., :count, :]


def _begun_at(table: Array, starts: Indices) -> Array:
    """Costs in a cycle cut at these nodes.

    Args:
        table: Cost by end and place of the start among the nodes from a turn before to the end,
            shape (m, m + 1), infinite for the last.
        starts: Indices at which the cycle begins, shape (a,).

    Returns:
        Costs by end and start, each counted from the cut, shape (a, m + 1, m + 1).
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
        problem: What to approximate.
        ideal: Its slope-bounded ideal, shape (n,).
        curve: What says how many segments, and how far from the ideal.
        nodes: Places where knots may lie, if the samples are as many; four for every segment where
            that is more. The cost of a chain takes this number squared.
        offsets: Angles that a knot may have around the ideal, in units of the curve's rms error.
        anchor: Number of the knot that is kept, for a cycle.

    Returns:
        Knots; None if no chain is within the slopes.
    """
    n = problem.samples
    first = round(float(curve.knots[anchor])) if problem.cyclic else 0
    last = n if problem.cyclic else n - 1
    segments = curve.knots.size if problem.cyclic else curve.knots.size - 1
    count = min(last, max(nodes, 4 * segments))
    fixed = nearest_samples(problem.required)
    fixed = np.mod(fixed - first, n) if problem.cyclic else fixed
    grid = np.union1d(np.round(np.linspace(0, last, count + 1)).astype(np.intp), fixed)
    unit = float(np.sqrt(curve.error / n))
    states = ideal[(grid + first) % n][:, None] + unit * np.array(offsets)
    if problem.cyclic:
        states[[0, -1], 0] = float(np.interp(first, curve.knots, curve.values, period=n))
        states[[0, -1], 1:] = np.inf
    for place, pin in zip(fixed, problem.pins, strict=True):
        if np.isfinite(pin):
            node = int(np.searchsorted(grid, place))
            states[node, 0], states[node, 1:] = pin, np.inf
            if problem.cyclic and node == 0:
                states[-1, 0] = pin
    desired = np.resize(np.roll(problem.desired, -first), last + 1)
    table = _state_costs(desired, states, grid, problem.step)
    possible = segment_allowed(problem, grid[:, None] + first, grid[None, :] + first)
    table.transpose(0, 2, 1, 3)[~possible] = np.inf
    at_start = (states[0] - desired[0]) ** 2
    path = _cheapest(table, at_start, segments)
    if path is None:
        return None
    chain = grid[path[:-1] if problem.cyclic else path].astype(np.float64) + first
    return with_required(problem, chain)


def _cheapest(table: Array, at_start: Array, segments: int) -> Indices | None:
    """Indices on the cheapest way from the first to the last, ends included."""
    m, g = table.shape[:2]
    flat = np.ascontiguousarray(table.reshape(m * g, m * g).T)  # by end and start
    cost = np.full(m * g, np.inf)
    cost[:g] = at_start
    came_from = []
    for _ in range(segments):
        through = cost + flat
        best = np.argmin(through, axis=1)
        cost = through[np.arange(best.size), best]
        came_from.append(best)
    state = (m - 1) * g + int(np.argmin(cost[-g:]))
    if not np.isfinite(cost[state]):
        return None
    chain = [state]
    for level in reversed(came_from):
        chain.append(int(level[chain[-1]]))
    path: Indices = np.array(chain[::-1], dtype=np.intp) // g
    return path


def _state_costs(desired: Array, states: Array, nodes: Indices, step: float) -> Array:
    """Squared error of a segment between any two states, shape (m, g, m, g)."""
    start, end = nodes[:, None], nodes[None, :]
    sums = moments(desired, start, end)
    length = np.maximum(end - start, 1).astype(np.float64)
    k1, k2, d1 = sums.w1 / length, sums.w2 / length**2, sums.d1 / length
    usable = np.isfinite(states)
    states = np.where(usable, states, 0.0)
    a, b = states[:, :, None], states[None, :, :]
    # With u the share of the segment behind a sample: the sums of (1-u)², 2u(1-u), u² and so on.
    by_start = (sums.w0 - 2.0 * k1 + k2)[:, None, :] * a * a - 2.0 * (sums.d0 - d1)[:, None, :] * a
    by_end = k2[:, :, None] * b * b - 2.0 * d1[:, :, None] * b
    cross = (2.0 * (k1 - k2))[:, None, :] * a
    cost = cross[:, :, :, None] * states[None, None, :, :]
    cost += (by_start + sums.d2[:, None, :])[:, :, :, None]
    cost += by_end[:, None, :, :]
    rise = np.abs(states[None, None, :, :] - states[:, :, None, None])
    reach = np.where(end > start, step * length * (1.0 + 1e-9), -1.0)
    cost[rise > reach[:, None, :, None]] = np.inf
    cost[~usable] = np.inf
    cost[:, :, ~usable] = np.inf
    return np.asarray(cost)


def _segment_costs(
    ideal: Array,
    sums: Moments,
    start: Indices,
    end: Indices,
    *,
    step: float,
    kind: CostKind,
) -> Array:
    """Squared errors of segments, each over the samples after its start.

    Args:
        ideal: The slope-bounded ideal of the samples, shape (n,).
        sums: Over the samples and over the ideal, one after the other, for every segment.
        start: Samples where the segments start, of any shape.
        end: Samples where they end, of the same shape.
        step: Largest change per sample.
        kind: Which cost, see the module.

    Returns:
        Costs, of the same shape, infinite where a segment does not end after its start.
    """
    which = 0 if kind == "chord" else 1
    w0, w1, w2 = sums.w0, sums.w1, sums.w2
    d0, d1, d2 = sums.d0[which], sums.d1[which], sums.d2[which]
    if kind == "chord":
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


class Moments(NamedTuple):
    """Sums over stretches of samples, time counted from the first node of each; any shape."""

    w0: Array  # Σ 1
    w1: Array  # Σ k
    w2: Array  # Σ k²
    d0: Array  # Σ d
    d1: Array  # Σ k d
    d2: Array  # Σ d²


def moments(desired: Array, start: Indices, end: Indices) -> Moments:
    """Sums over the samples after ``start`` up to ``end``, with k = 0 at ``start``.

    Args:
        desired: Samples, shape (..., n); their sums have the same leading axes.
        start: Sample before each stretch, of any shape that broadcasts with ``end``.
        end: Last sample of each.

    Returns:
        The sums, each of the common shape. Cost O(n) and a few operations per stretch.
    """
    totals = running(desired)
    begun = [total[..., start] for total in totals]
    ended = [total[..., end] for total in totals]
    return between(start, begun, ended)


def running(desired: Array) -> tuple[Array, Array]:
    """Sums over the samples up to each, with k = 0 at the first.

    Those of 1, k and k², shape (3, n), and of d, k d and d², shape (3, ..., n).
    """
    k = np.arange(desired.shape[-1], dtype=np.float64)
    of_index, of_samples = [np.ones(k.size), k, k * k], [desired, k * desired, desired * desired]
    return np.cumsum(of_index, axis=-1), np.cumsum(of_samples, axis=-1)


def between(start: Indices | Array, begun: Sequence[Array], ended: Sequence[Array]) -> Moments:
    """Sums about ``start``, whole or not, from those of :func:`running` there and at the ends."""
    # In C order, as sliding views would otherwise leave theirs to all that is made of them.
    (w0, w1, w2), (d0, d1, d2) = (
        np.subtract(after, before, order="C") for before, after in zip(begun, ended, strict=True)
    )
    since = start.astype(np.float64)
    w2 = w2 - since * (2.0 * w1 - since * w0)
    return Moments(w0, w1 - since * w0, w2, d0, d1 - since * d0, d2)


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
