"""What knots obey besides slopes: where they must be, what the curve is there, how close."""

from __future__ import annotations

import math
from heapq import heapify, heapreplace

import numpy as np
import numpy.typing as npt

from planner.approximation.objective import Problem
from planner.trajectory import Array

SAME_PLACE = 1e-6
"""Distance [samples] at which a knot counts as one that is required."""

BARELY_SHORT = 1e-9
"""Lack of length [samples] that is left to rounding."""


def held(problem: Problem, knots: Array) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Which knots may not move, and which of their values, each shape (K,)."""
    fixed = np.full(knots.size, problem.whole)
    pinned = np.zeros(knots.size, dtype=bool)
    if not problem.cyclic:
        fixed[[0, -1]] = True
    if problem.required.size:
        away = distances(problem, knots)
        which = np.argmin(away, axis=1)
        there = away[np.arange(knots.size), which] <= SAME_PLACE
        fixed |= there
        pinned = there & np.isfinite(problem.pins[which])
    return fixed, pinned


def distances(problem: Problem, places: Array) -> Array:
    """Time between places and required knots [samples], the shorter way round, shape (m, r)."""
    away = np.abs(places[:, None] - problem.required[None, :])
    if problem.cyclic:
        away = np.mod(away, problem.samples)
        away = np.minimum(away, problem.samples - away)
    return np.asarray(away)


def reachable(problem: Problem, places: Array) -> tuple[Array, Array]:
    """Least and largest values at ``places`` from which every pin can be reached, each (m,)."""
    pinned = np.isfinite(problem.pins)
    if not np.any(pinned):
        return np.full(places.size, -np.inf), np.full(places.size, np.inf)
    away = problem.step * distances(problem, places)[:, pinned]
    pins = problem.pins[pinned]
    return np.max(pins - away, axis=1), np.min(pins + away, axis=1)


def at_rest(problem: Problem, knots: Array) -> Array:
    """Values within the slopes that keep the pins: the mean of the samples where that is free."""
    mean = float(np.average(problem.desired, weights=problem.weights))
    lower, upper = reachable(problem, knots)
    values = np.minimum(np.maximum(np.full(knots.size, mean), lower), upper)
    return keeping_pins(problem, knots, values)


def keeping_pins(problem: Problem, knots: Array, values: Array) -> Array:
    """The values, those of pins exactly as required."""
    if not problem.required.size:
        return values
    away = distances(problem, knots)
    which = np.argmin(away, axis=1)
    pins = problem.pins[which]
    there = (away[np.arange(knots.size), which] <= SAME_PLACE) & np.isfinite(pins)
    return np.where(there, pins, values)


def nodes_of(required: Array) -> npt.NDArray[np.intp]:
    """The samples that stand for required knots on grids of samples."""
    return np.floor(required + 0.5).astype(np.intp)


def grid_of(problem: Problem, last: int, count: int) -> npt.NDArray[np.intp]:
    """About ``count`` + 1 samples from 0 to ``last``, those of required knots among them."""
    nodes = np.round(np.linspace(0, last, count + 1)).astype(np.intp)
    fixed = nodes_of(problem.required)
    return np.union1d(nodes, np.mod(fixed, last) if problem.cyclic else fixed)


def in_place(problem: Problem, knots: Array) -> Array | None:
    """Knots from a grid of samples with the required ones where they belong.

    Args:
        problem: What to approximate.
        knots: Knots on samples, shape (K,), among them those of :func:`nodes_of`.

    Returns:
        Knots, shape (K,); None if some segment is too short then.
    """
    moved = np.array(knots, dtype=np.float64)
    for node, place in zip(nodes_of(problem.required), problem.required, strict=True):
        away = knots - node
        there = np.mod(away, problem.samples) == 0.0 if problem.cyclic else away == 0.0
        moved[there] += place - node
    ends = np.append(moved, moved[0] + problem.samples) if problem.cyclic else moved
    return moved if np.all(np.diff(ends) >= problem.shortest - BARELY_SHORT) else None


def allowed(
    problem: Problem, start: npt.NDArray[np.intp], end: npt.NDArray[np.intp]
) -> npt.NDArray[np.bool_]:
    """Whether a segment may lead from one node to another, by length and required knots."""
    moves = bool(np.any(problem.required != np.floor(problem.required)))  # by half a sample or less
    possible = end - start >= max(problem.shortest - 0.5 * moves, 1.0)
    for node in nodes_of(problem.required):
        turns = range(-1, 4) if problem.cyclic else (0,)
        for turn in turns:
            place = node + turn * problem.samples
            possible &= (place <= start) | (place >= end)
    return np.asarray(possible)


def gaps(problem: Problem) -> tuple[Array, npt.NDArray[np.intp]]:
    """Places that are knots in any case, ends included, and most segments between them."""
    n, fixed = problem.samples, problem.required
    if problem.cyclic:
        first = fixed if fixed.size else np.zeros(1)
        places = np.append(first, first[0] + n)
    else:
        places = np.unique(np.concatenate([[0.0], fixed, [n - 1.0]]))
    unit = math.ceil(problem.shortest - BARELY_SHORT) if problem.whole else problem.shortest
    most = np.floor(np.diff(places) / unit + BARELY_SHORT).astype(np.intp)
    return places, most


def spread(problem: Problem, segments: int | None = None) -> Array:
    """Knots as evenly spread as required knots and the shortest segment allow.

    Args:
        problem: What to approximate.
        segments: Number of segments; None for as many as possible.

    Returns:
        Knots, shape (K,), of a cycle without its end.
    """
    places, most = gaps(problem)
    length = np.diff(places)
    parts = np.array(most)
    if segments is not None:
        parts = np.ones(length.size, dtype=np.intp)
        queue = [(-length[k], k) for k in range(length.size) if most[k] > 1]
        heapify(queue)
        for _ in range(segments - length.size):
            if not queue:
                break
            k = queue[0][1]
            parts[k] += 1
            share = -length[k] / parts[k] if parts[k] < most[k] else math.inf
            heapreplace(queue, (share, k))
    pieces = []
    for start, size, count in zip(places[:-1], length, parts, strict=True):
        inner = start + size * np.arange(count) / count
        pieces.append(np.floor(inner + 1e-9) if problem.whole else inner)
    knots = np.concatenate(pieces)
    return knots if problem.cyclic else np.append(knots, places[-1])
