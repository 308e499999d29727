"""Knots by dynamic programming: the cheapest chain of segments between the nodes of a grid.

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
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from planner.approximation.least_squares import Moments, between, moments, running
from planner.approximation.problem import (
    Candidate,
    Problem,
    nearest_samples,
    segment_allowed,
    with_required,
)
from planner.trajectory import Array

Nodes = npt.NDArray[np.intp]
CostKind = Literal["chord", "line"]
Kind = TypeVar("Kind", bound=np.generic)
COST_KINDS: tuple[CostKind, ...] = ("chord", "line")


class Lattice(NamedTuple):
    """Where the knots of a chain may lie."""

    nodes: int  # if the samples are as many; the cost of a chain takes this number squared
    offsets: tuple[float, ...]  # angles around the ideal, in units of a curve's rms error


@dataclass(frozen=True)
class ChainOptions:
    """Tuning of the grids.

    Attributes:
        nodes: Most nodes of a grid without angles: costs take this number squared. 64: 2.5 % of the
            fits at n = 88 worse by 0.1 %, by 2 % at worst; 256: no change there.
        anchors: Places of a cycle at which chains begin and end; the sharpest corner is one of
            them. 3: 0.001 % more error in the mean, 0.1 % at worst; 12: 0.001 % less for a tenth
            more time.
        lattices: Few nodes with many angles and more with fewer, as they fail on different data;
            without both, errors are 11 % higher at worst.
        nodes_per_segment: Nodes of a lattice for every segment, where that is more. 2: 0.02 % more
            error in the mean of 80 fits of 14 to 40 segments; 8: 2 % of the fits with 12 segments
            and fewer worse by 0.1 %.
    """

    nodes: int = 128
    anchors: int = 6
    lattices: tuple[Lattice, ...] = (
        Lattice(29, (-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4)),
        Lattice(44, (-1.6, -0.8, 0.0, 0.8, 1.6)),
    )
    nodes_per_segment: int = 4


CHAINS = ChainOptions()


class ChainProposals:
    """Knots of any number of segments, by chord and by line; one more costs O(m²) for m nodes."""

    def __init__(self, problem: Problem, ideal: Array) -> None:
        """Work out the costs of all segments between nodes.

        Args:
            problem: What to approximate; a cycle begins where a knot is likely.
            ideal: Its slope-bounded ideal, shape (n,).
        """
        last = problem.samples if problem.cyclic else problem.samples - 1
        count = min(last, CHAINS.nodes)
        self._problem, self._last = problem, last
        nodes = np.round(np.linspace(0, last, count + 1)).astype(np.intp)
        fixed = nearest_samples(problem.required)
        self.nodes = np.union1d(nodes, np.mod(fixed, last) if problem.cyclic else fixed)
        count = self.nodes.size - 1
        sides = [problem.desired, ideal]
        if not problem.cyclic:
            self._starts = np.zeros(1, dtype=np.intp)
            nodes = self.nodes
        else:
            self._starts = np.unique(np.arange(CHAINS.anchors) * count // CHAINS.anchors)
            if problem.required.size:
                fixed = np.unique(nearest_samples(problem.required) % last)
                self._starts = np.searchsorted(self.nodes, fixed)[: CHAINS.anchors]
            nodes = np.append(self.nodes[:-1], last + self.nodes)
            sides = [np.resize(side, 2 * last + 1) for side in sides]
        self._all_nodes = nodes
        self._tables = {}
        self._costs = {}
        self._came_from: dict[CostKind, list[Nodes]] = {}
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

    def least_error(self, segments: int) -> float | None:
        """Squared error of the cheapest chain of chords; None where not every sample is a node."""
        if self.nodes.size <= self._last or segments >= self.nodes.size:
            return None
        self._extend("chord", segments)
        return float(np.min(self._costs["chord"][segments][:, -1]))

    def _extend(self, kind: CostKind, segments: int) -> None:
        """Make the costs and the ways of up to ``segments`` segments known."""
        table, costs, came_from = self._tables[kind], self._costs[kind], self._came_from[kind]
        while len(came_from) < segments:
            through = costs[-1][:, None, :] + table
            best = np.argmin(through, axis=2)
            costs.append(np.take_along_axis(through, best[:, :, None], axis=2)[:, :, 0])
            came_from.append(best)

    def _chain(self, kind: CostKind, segments: int, anchor: int) -> Nodes:
        """The samples on the way, in order; of a cycle without its end."""
        chain = [self.nodes.size - 1]
        for level in reversed(self._came_from[kind][:segments]):
            chain.append(int(level[anchor, chain[-1]]))
        way: Nodes = self._all_nodes[int(self._starts[anchor]) + np.array(chain[::-1])]
        return way[:-1] if self._cyclic else way


def _windows(along: npt.NDArray[Kind], count: int) -> npt.NDArray[Kind]:
    """What belongs to ``count`` nodes in a row and the next, shape (..., count, count + 1)."""
    return sliding_window_view(along, count + 1, axis=-1)[..., :count, :]


def _begun_at(table: Array, starts: Nodes) -> Array:
    """Costs in a cycle cut at these nodes.

    Args:
        table: Cost by end and place of the start among the nodes from a turn before to the end,
            shape (m, m + 1), infinite for the last.
        starts: Nodes at which the cycle begins, shape (a,).

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
    problem: Problem, ideal: Array, curve: Candidate, lattice: Lattice, *, anchor: int = 0
) -> Array | None:
    """Knots of the cheapest chain with as many segments on a grid.

    Args:
        problem: What to approximate.
        ideal: Its slope-bounded ideal, shape (n,).
        curve: What says how many segments, and how far from the ideal.
        lattice: Where knots may lie.
        anchor: Number of the knot that is kept, for a cycle.

    Returns:
        Knots; None if no chain is within the slopes.
    """
    n = problem.samples
    first = round(float(curve.knots[anchor])) if problem.cyclic else 0
    last = n if problem.cyclic else n - 1
    segments = curve.knots.size if problem.cyclic else curve.knots.size - 1
    count = min(last, max(lattice.nodes, CHAINS.nodes_per_segment * segments))
    fixed = nearest_samples(problem.required)
    fixed = np.mod(fixed - first, n) if problem.cyclic else fixed
    nodes = np.union1d(np.round(np.linspace(0, last, count + 1)).astype(np.intp), fixed)
    unit = float(np.sqrt(curve.error / n))
    states = ideal[(nodes + first) % n][:, None] + unit * np.array(lattice.offsets)
    if problem.cyclic:
        states[[0, -1], 0] = float(np.interp(first, curve.knots, curve.values, period=n))
        states[[0, -1], 1:] = np.inf
    for place, pin in zip(fixed, problem.pins, strict=True):
        if np.isfinite(pin):
            node = int(np.searchsorted(nodes, place))
            states[node, 0], states[node, 1:] = pin, np.inf
            if problem.cyclic and node == 0:
                states[-1, 0] = pin
    desired = np.resize(np.roll(problem.desired, -first), last + 1)
    table = _state_costs(desired, states, nodes, problem.step)
    possible = segment_allowed(problem, nodes[:, None] + first, nodes[None, :] + first)
    table.transpose(0, 2, 1, 3)[~possible] = np.inf
    at_start = (states[0] - desired[0]) ** 2
    path = _cheapest(table, at_start, segments)
    if path is None:
        return None
    chain = nodes[path[:-1] if problem.cyclic else path].astype(np.float64) + first
    return with_required(problem, chain)


def _cheapest(table: Array, at_start: Array, segments: int) -> Nodes | None:
    """Nodes on the cheapest way from the first to the last, ends included."""
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
    path: Nodes = np.array(chain[::-1], dtype=np.intp) // g
    return path


def _state_costs(desired: Array, states: Array, nodes: Nodes, step: float) -> Array:
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
    start: Nodes,
    end: Nodes,
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
