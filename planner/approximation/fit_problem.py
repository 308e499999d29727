"""Approximation problem: samples and slope bound, in units of its own; candidate curves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.arrays import LARGEST, Array, as_count, as_positive
from planner.exceptions import InvalidInput

SMALLEST = 1e-30
"""Smallest speed, time or error that is accepted, and half range of samples that are not constant:
no measurement is as exact."""

SHORTEST = 1.0 - 1e-9  # length of the shortest segment [samples]: a sample, less rounding
BARELY = 1e-9  # relative distance from a bound on the error that rounding cannot cross


class Problem(NamedTuple):
    """An approximation problem: samples of size one, time counted in samples.

    Compiled functions take it as it is.
    """

    desired: Array  # samples D, (n,)
    step: float  # largest change per sample v
    cyclic: bool  # whether the first sample follows the last; else the ends are knots
    bound: float = math.inf  # error beyond which descents add a penalty
    penalty: float = 0.0  # weight of the squared excess

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return self.desired.size

    @property
    def most(self) -> int:
        """Most segments: each is a sample long or longer."""
        return self.samples if self.cyclic else self.samples - 1

    def ends(self, knots: Array) -> Array:
        """Ends of the segments [samples]: the knots, and of a cycle the first a period later."""
        return np.append(knots, knots[0] + self.samples) if self.cyclic else knots

    def segments(self, knots: Array) -> int:
        """Number of segments between these knots."""
        return knots.size if self.cyclic else knots.size - 1


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


def even_knots(problem: Problem, segments: int) -> Array:
    """Knots that are evenly spread: (K,)."""
    knots = problem.most * np.arange(segments + 1) / segments
    return knots[:-1] if problem.cyclic else knots


def positive(name: str, value: float, unit: str) -> float:
    """The number; raise InvalidInput unless it is finite, above 0 and of a plausible size."""
    number = as_positive(name, value, f"a finite number above 0 [{unit}]")
    if not SMALLEST <= number <= LARGEST:
        raise InvalidInput(
            f"{name}: got {number:g}, expected {SMALLEST:g} to {LARGEST:g} [{unit}]; check the unit"
        )
    return number


def checked_segments(segments: int | None, desired: Array, *, cyclic: bool) -> int | None:
    """The number of segments; raise InvalidInput where the samples do not allow it."""
    if segments is None:
        return None
    fewest = 1 if not cyclic or np.all(desired == desired[0]) else 2
    most = desired.size if cyclic else desired.size - 1
    of = f"{desired.size} {'cyclic ' if cyclic else ''}samples"
    expected = f"a whole number, {fewest} to {most} for {of}"
    return as_count("segments", segments, expected, least=fewest, most=most)
