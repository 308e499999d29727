"""The corners of samples that are piecewise linear already."""

from __future__ import annotations

import numpy as np

from planner.approximation.problem import Candidate, Problem, candidate
from planner.trajectory import Array

STRAIGHT = 1e-10
"""Second difference, relative to the size of the samples, that counts as none."""


def exact_curve(problem: Problem) -> Candidate | None:
    """The curve that the samples lie on, if it keeps the slopes and has few segments.

    A corner on a sample shows in one second difference; a corner between two samples in two, and
    lies where the lines on its two sides meet.

    Args:
        problem: What to approximate; samples of size one.

    Returns:
        The curve; None if it is too steep somewhere or has more than one segment in three samples.
    """
    d, n = problem.desired, problem.samples
    if problem.required.size or problem.on_samples:
        return None
    bent = np.abs(np.roll(d, 1) - 2.0 * d + np.roll(d, -1)) > STRAIGHT
    if not problem.cyclic:
        bent[[0, -1]] = True
    if 3 * np.count_nonzero(bent) > 2 * n:
        return None
    at = np.flatnonzero(bent)
    gap = np.diff(np.append(at, at[0] + n)) if problem.cyclic else np.append(np.diff(at), n)
    pairs = (gap == 1) & (np.roll(gap, 1) != 1) & (np.roll(gap, -1) != 1)
    knots: list[float] = []
    values: list[float] = []
    skip = False
    for first, paired in zip(at.tolist(), pairs.tolist(), strict=True):
        if skip:
            skip = False
            continue
        meeting = _meeting(d, first) if paired else None
        if meeting is not None and (problem.cyclic or 0 < first < n - 2):
            knots.append(first + meeting[0])
            values.append(meeting[1])
            skip = True
        else:
            knots.append(float(first))
            values.append(float(d[first]))
    if problem.cyclic and skip and knots and at[0] == 0 and at[-1] == n - 1 and len(knots) > 1:
        knots, values = knots[1:], values[1:]
    if len(knots) < 2 or 3 * len(knots) > n + 3:
        return None
    return _kept(problem, np.array(knots), np.array(values))


def _meeting(d: Array, k: int) -> tuple[float, float] | None:
    """Where between samples k and k + 1 the lines on their two sides meet, and the value there."""
    n = d.size
    before, here = d[(k - 1) % n], d[k % n]
    there, after = d[(k + 1) % n], d[(k + 2) % n]
    left, right = here - before, after - there
    if left == right:
        return None
    share = (there - right - here) / (left - right)
    return (float(share), float(here + share * left)) if 0.0 < share < 1.0 else None


def _kept(problem: Problem, knots: Array, values: Array) -> Candidate | None:
    """The curve, if it is one within the slopes that the samples lie on."""
    curve = candidate(problem, knots, values)
    ends = np.append(knots, knots[0] + problem.samples) if problem.cyclic else knots
    rises = np.diff(np.append(values, values[0]) if problem.cyclic else values)
    lengths = np.diff(ends)
    steep = np.abs(rises) > problem.step * lengths * (1.0 + 1e-9)
    off = curve.error > problem.samples * (100.0 * STRAIGHT) ** 2
    return None if np.any(steep) or np.any(lengths < problem.shortest) or off else curve
