"""Knots and values at once on a grid around the ideal: a shortest path that sees every chain.

The nodes are samples, and at each node a few angles around the ideal may be taken. A segment
between two of these states has its exact squared error as its price, infinite if it is too steep,
so the cheapest chain is continuous, within the slopes, and best of all on the grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.moments import moments
from planner.approximation.objective import Candidate, Problem
from planner.approximation.requirements import allowed, in_place, nodes_of
from planner.trajectory import Array


class Grid(NamedTuple):
    """Where the knots of a chain may lie."""

    nodes: int  # if the samples are as many; the cost of a chain takes this number squared
    offsets: tuple[float, ...]  # angles around the ideal, in units of a curve's rms error


GRIDS = (
    Grid(29, (-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4)),
    Grid(44, (-1.6, -0.8, 0.0, 0.8, 1.6)),
)
"""Few nodes with many angles and more with fewer, as they fail on different data."""

NODES_PER_SEGMENT = 4
"""Nodes of the grid for every segment, where that is more."""


def rechained(
    problem: Problem, ideal: Array, curve: Candidate, grid: Grid, *, anchor: int = 0
) -> Array | None:
    """Knots of the cheapest chain with as many segments on a grid.

    Args:
        problem: What to approximate.
        ideal: Its slope-bounded ideal, shape (n,).
        curve: What says how many segments, and how far from the ideal.
        grid: Where knots may lie.
        anchor: Number of the knot that is kept, for a cycle.

    Returns:
        Knots; None if no chain is within the slopes.
    """
    n = problem.samples
    first = round(float(curve.knots[anchor])) if problem.cyclic else 0
    last = n if problem.cyclic else n - 1
    segments = curve.knots.size if problem.cyclic else curve.knots.size - 1
    count = min(last, max(grid.nodes, NODES_PER_SEGMENT * segments))
    fixed = nodes_of(problem.required)
    fixed = np.mod(fixed - first, n) if problem.cyclic else fixed
    nodes = np.union1d(np.round(np.linspace(0, last, count + 1)).astype(np.intp), fixed)
    unit = float(np.sqrt(curve.error / n))
    states = ideal[(nodes + first) % n][:, None] + unit * np.array(grid.offsets)
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
    weights = np.resize(np.roll(problem.weights, -first), last + 1)
    table = _prices(desired, weights, states, nodes, problem.step)
    possible = allowed(problem, nodes[:, None] + first, nodes[None, :] + first)
    table.transpose(0, 2, 1, 3)[~possible] = np.inf
    at_start = weights[0] * (states[0] - desired[0]) ** 2
    path = _cheapest(table, at_start, segments)
    if path is None:
        return None
    chain = nodes[path[:-1] if problem.cyclic else path].astype(np.float64) + first
    return in_place(problem, chain)


def _cheapest(table: Array, at_start: Array, segments: int) -> npt.NDArray[np.intp] | None:
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
    path: npt.NDArray[np.intp] = np.array(chain[::-1], dtype=np.intp) // g
    return path


def _prices(
    desired: Array, weights: Array, states: Array, nodes: npt.NDArray[np.intp], step: float
) -> Array:
    """Squared error of a segment between any two states, shape (m, g, m, g)."""
    start, end = nodes[:, None], nodes[None, :]
    sums = moments(desired, weights, start, end)
    length = np.maximum(end - start, 1).astype(np.float64)
    k1, k2, d1 = sums.w1 / length, sums.w2 / length**2, sums.d1 / length
    usable = np.isfinite(states)
    states = np.where(usable, states, 0.0)
    a, b = states[:, :, None], states[None, :, :]
    # With u the share of the segment behind a sample: the sums of (1-u)², 2u(1-u), u² and so on.
    by_start = (sums.w0 - 2.0 * k1 + k2)[:, None, :] * a * a - 2.0 * (sums.d0 - d1)[:, None, :] * a
    by_end = k2[:, :, None] * b * b - 2.0 * d1[:, :, None] * b
    cross = (2.0 * (k1 - k2))[:, None, :] * a
    price = cross[:, :, :, None] * states[None, None, :, :]
    price += (by_start + sums.d2[:, None, :])[:, :, :, None]
    price += by_end[:, None, :, :]
    rise = np.abs(states[None, None, :, :] - states[:, :, None, None])
    reach = np.where(end > start, step * length * (1.0 + 1e-9), -1.0)
    price[rise > reach[:, None, :, None]] = np.inf
    price[~usable] = np.inf
    price[:, :, ~usable] = np.inf
    return np.asarray(price)
