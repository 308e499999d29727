"""Fewer samples for where the knots are sought: means over stretches of many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.approximation.objective import Candidate, Problem, candidate
from planner.trajectory import Array

FEW = 1024
"""Means that stand for the samples."""


def thinned(problem: Problem) -> Problem:
    """The problem with few samples, each the mean of those that are nearest to it; O(n) once.

    Sample k of these few is at k (n - 1) / (m - 1) of a path's samples, at k n / m of a cycle's, so
    that the ends stay the ends. The slopes keep the same bound.
    """
    spacing = _spacing(problem, FEW)
    at = spacing * np.arange(FEW + 1)
    cuts = np.ceil(at - 0.5 * spacing).astype(np.intp)
    first = -int(cuts[0]) if problem.cyclic else 0
    cuts = np.maximum(cuts + first, 0)[:FEW]
    weights = np.roll(problem.weights, first)
    weighed = np.add.reduceat(np.roll(problem.weights * problem.desired, first), cuts)
    totals = np.add.reduceat(weights, cuts)
    return replace(
        problem,
        desired=weighed / totals,
        weights=totals / np.mean(totals),
        step=problem.step * spacing,
    )


def in_full(problem: Problem, knots: Array, values: Array) -> Candidate:
    """The curve through all samples that one through the few of :func:`thinned` stands for."""
    knots = knots * _spacing(problem, FEW)
    if not problem.cyclic:
        knots[-1] = problem.samples - 1.0
    return candidate(problem, knots, values)


def _spacing(problem: Problem, few: int) -> float:
    samples = problem.samples
    return samples / few if problem.cyclic else (samples - 1.0) / (few - 1.0)
