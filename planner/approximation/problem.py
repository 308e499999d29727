"""The samples in units of the search, and the constraints on knots besides the slopes.

The samples are of size one; time is counted in samples. The ends of a path and required knots are
fixed, and at required knots values may be, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from heapq import heapify, heapreplace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.trajectory import Array

SAME_PLACE = 1e-6
"""Distance [samples] at which a knot counts as one that is required."""

SHORTEST = 1.0 - 1e-9
"""Length of the shortest segment [samples]: a sample, less rounding."""

KNOT_UNIT = 2.0**-32
"""Knots are rounded to multiples of this [samples], so that their sums are exact."""

BARELY = 1e-9
"""Relative distance from a bound on the error that rounding cannot cross."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """What to approximate, in a unit of its own.

    Attributes:
        desired: Samples D, shape (n,).
        step: Largest change per sample v.
        cyclic: Whether the first sample follows the last.
        required: Where there must be a knot [samples], shape (r,), increasing.
        pins: The curve's values there, shape (r,); NaN where they are free.
    """

    desired: Array
    step: float
    cyclic: bool
    required: Array = field(default_factory=lambda: np.zeros(0))
    pins: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return self.desired.size

    def ends(self, knots: Array) -> Array:
        """Ends of the segments [samples]: the knots, and of a cycle the first a period later."""
        return np.append(knots, knots[0] + self.samples) if self.cyclic else knots

    def segments(self, knots: Array) -> int:
        """Number of segments between these knots."""
        return knots.size if self.cyclic else knots.size - 1

    def long_enough(self, knots: Array) -> bool:
        """Whether no segment between these knots is shorter than a sample."""
        return bool(np.min(np.diff(self.ends(knots))) >= SHORTEST)


class Candidate(NamedTuple):
    """A candidate curve and its squared error."""

    knots: Array  # (K,)
    values: Array  # (K,)
    error: float


def candidate(problem: Problem, knots: Array, values: Array) -> Candidate:
    """A curve with its squared error Σ (P - D)²; O(n + K)."""
    residual = residuals(problem, knots, values)
    return Candidate(knots, values, float(residual @ residual))


def residuals(problem: Problem, knots: Array, values: Array) -> Array:
    """Curve minus samples, P - D, shape (n,)."""
    index = np.arange(problem.samples, dtype=np.float64)
    period = problem.samples if problem.cyclic else None
    return np.interp(index, knots, values, period=period) - problem.desired


@lru_cache(maxsize=64)
def segment_ends(size: int, *, cyclic: bool) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Numbers of the knots at which the segments start and end."""
    start = np.arange(size if cyclic else size - 1)
    return start, (start + 1) % size


def fixed_variables(
    problem: Problem, knots: Array
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Which knots may not move, and which of their values, each shape (K,)."""
    required, pins = required_knots(problem, knots)
    return required, np.isfinite(pins)


def required_knots(problem: Problem, knots: Array) -> tuple[npt.NDArray[np.bool_], Array]:
    """Which knots are required or the ends of a path, and their pins, NaN where free, each (K,)."""
    required, pins = np.zeros(knots.size, dtype=bool), np.full(knots.size, np.nan)
    if not problem.cyclic:
        required[[0, -1]] = True
    if problem.required.size:
        away = distances(problem, knots)
        which = np.argmin(away, axis=1)
        there = away[np.arange(knots.size), which] <= SAME_PLACE
        required |= there
        pins[there] = problem.pins[which[there]]
    return required, pins


def distances(problem: Problem, places: Array) -> Array:
    """Time between places and required knots [samples], the shorter way round, shape (m, r)."""
    away = np.abs(places[:, None] - problem.required[None, :])
    if problem.cyclic:
        away = np.mod(away, problem.samples)
        away = np.minimum(away, problem.samples - away)
    return np.asarray(away)


def reachable_interval(problem: Problem, places: Array) -> tuple[Array, Array]:
    """Least and largest values at ``places`` from which every pin can be reached, each (m,)."""
    pinned = np.isfinite(problem.pins)
    if not np.any(pinned):
        return np.full(places.size, -np.inf), np.full(places.size, np.inf)
    away = problem.step * distances(problem, places)[:, pinned]
    pins = problem.pins[pinned]
    return np.max(pins - away, axis=1), np.min(pins + away, axis=1)


def feasible_values(problem: Problem, knots: Array) -> Array:
    """Values within the slopes that keep the pins, elsewhere as near as possible to the mean.

    Args:
        problem: What to approximate.
        knots: Knots [samples], shape (k,).

    Returns:
        Values at the knots [unit of the samples], shape (k,).
    """
    mean = float(np.mean(problem.desired))
    if not problem.required.size:
        return np.full(knots.size, mean)
    lower, upper = reachable_interval(problem, knots)
    values = np.minimum(np.maximum(np.full(knots.size, mean), lower), upper)
    return with_pins(problem, knots, values)


def with_pins(problem: Problem, knots: Array, values: Array) -> Array:
    """Values at knots [unit of the samples], shape (k,), those of pins exactly as required."""
    pins = required_knots(problem, knots)[1]
    return np.where(np.isfinite(pins), pins, values)


def round_knots(knots: npt.ArrayLike) -> Array:
    """The nearest multiples of :data:`KNOT_UNIT` [samples], an array like ``knots``."""
    return np.asarray(np.round(np.asarray(knots) / KNOT_UNIT) * KNOT_UNIT)


def nearest_samples(required: Array) -> npt.NDArray[np.intp]:
    """The samples that stand for required knots on grids of samples."""
    return np.floor(required + 0.5).astype(np.intp)


def with_required(problem: Problem, knots: Array) -> Array | None:
    """Knots from a grid of samples, with the nearest ones replaced by required knots.

    Args:
        problem: What to approximate.
        knots: Knots on samples, shape (K,), among them those of :func:`nearest_samples`.

    Returns:
        Knots, shape (K,); None if some segment is too short then.
    """
    moved = np.array(knots, dtype=np.float64)
    for node, place in zip(nearest_samples(problem.required), problem.required, strict=True):
        away = knots - node
        there = np.mod(away, problem.samples) == 0.0 if problem.cyclic else away == 0.0
        moved[there] += place - node
    return moved if problem.long_enough(moved) else None


def segment_allowed(
    problem: Problem, start: npt.NDArray[np.intp], end: npt.NDArray[np.intp]
) -> npt.NDArray[np.bool_]:
    """Whether a segment may lead from one node to another, by length and required knots."""
    possible = end - start >= 1
    for node in nearest_samples(problem.required):
        turns = range(-1, 4) if problem.cyclic else (0,)
        for turn in turns:
            place = node + turn * problem.samples
            possible &= (place <= start) | (place >= end)
    return np.asarray(possible)


def segment_capacity(problem: Problem) -> tuple[Array, npt.NDArray[np.intp]]:
    """Places that are knots in any case, ends included, and most segments between them."""
    n, fixed = problem.samples, problem.required
    if problem.cyclic:
        first = fixed if fixed.size else np.zeros(1)
        places = np.append(first, first[0] + n)
    else:
        places = np.unique(np.concatenate([[0.0], fixed, [n - 1.0]]))
    most = np.floor(np.diff(places) + (1.0 - SHORTEST)).astype(np.intp)
    return places, most


def least_count(problem: Problem) -> int:
    """Least number of segments of a curve that is not a constant."""
    return max(2 if problem.cyclic else 1, segment_capacity(problem)[1].size)


def most_segments(problem: Problem) -> int:
    """Most segments of a sample or more."""
    return int(np.sum(segment_capacity(problem)[1]))


def even_knots(problem: Problem, segments: int | None = None) -> Array:
    """Knots as evenly spread as required knots allow.

    Args:
        problem: What to approximate.
        segments: Number of segments; None for as many as possible.

    Returns:
        Knots, shape (K,), of a cycle without its end.
    """
    places, most = segment_capacity(problem)
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
        pieces.append(start + size * np.arange(count) / count)
    knots = np.concatenate(pieces)
    return knots if problem.cyclic else np.append(knots, places[-1])
