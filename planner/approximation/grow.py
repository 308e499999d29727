"""A curve with one more knot, and the knot that matters most."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.approximation.objective import Candidate, Problem, residuals
from planner.approximation.requirements import held


def sharpest_knot(problem: Problem, curve: Candidate) -> int:
    """Number of the knot of a cycle at which the slope changes most, a required one if any is."""
    ends = np.append(curve.knots, curve.knots[0] + problem.samples)
    slopes = np.diff(np.append(curve.values, curve.values[0])) / np.diff(ends)
    bend = np.abs(slopes - np.roll(slopes, 1))
    if problem.required.size:
        fixed = held(replace(problem, whole=False), curve.knots)[0]
        bend = np.where(fixed, bend, -1.0)
    return int(np.argmax(bend))


def with_one_more(problem: Problem, curve: Candidate) -> list[Candidate]:
    """The same curve with one more knot, in every segment long enough for it, the worst first."""
    ends, values = curve.knots, curve.values
    index = np.arange(problem.samples, dtype=np.float64)
    if problem.cyclic:
        ends, values = np.append(ends, ends[0] + problem.samples), np.append(values, values[0])
        index = ends[0] + np.mod(index - ends[0], problem.samples)
    length = np.diff(ends)
    segment = np.clip(np.searchsorted(ends, index, side="right") - 1, 0, length.size - 1)
    squares = problem.weights * residuals(problem, curve.knots, curve.values) ** 2
    worst = np.bincount(segment, squares, minlength=length.size) + 1e-12 * length
    shortest = math.ceil(problem.shortest) if problem.whole else problem.shortest
    extended = []
    for split in np.argsort(-worst, kind="stable").tolist():
        if length[split] < 2.0 * shortest:
            continue
        share = 0.5
        if problem.whole:
            share = math.floor(0.5 * length[split]) / length[split]
        knot = ends[split] + share * length[split]
        value = values[split] + share * (values[split + 1] - values[split])
        knots = np.insert(curve.knots, split + 1, knot)
        extended.append(Candidate(knots, np.insert(curve.values, split + 1, value), curve.error))
    return extended
