"""What each value at a knot adds to the curve at the samples."""

from __future__ import annotations

import numpy as np

from planner.approximation.objective import Problem, segment_ends
from planner.trajectory import Array


def basis_of(problem: Problem, knots: Array) -> Array:
    """The matrix B of a curve with these knots, B y at the samples; O(n K) memory.

    Args:
        problem: What has the samples.
        knots: Knots, shape (K,).

    Returns:
        B, shape (n, K).
    """
    start, end = segment_ends(knots.size, cyclic=problem.cyclic)
    since = np.arange(problem.samples, dtype=np.float64) - knots[0]
    begun = knots[start] - knots[0]
    length = knots[end] - knots[start]
    if problem.cyclic:
        since = np.mod(since, problem.samples)
        length[-1] += problem.samples
    segment = np.minimum(np.maximum(begun.searchsorted(since, side="right") - 1, 0), start.size - 1)
    share = (since - begun[segment]) / length[segment]
    basis = np.zeros((problem.samples, knots.size))
    sample = np.arange(problem.samples)
    basis[sample, start[segment]] = 1.0 - share
    basis[sample, end[segment]] += share
    return basis
