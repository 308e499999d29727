"""What is tried around a rough curve, and when a curve of a segment less may still be better."""

from __future__ import annotations

import numpy as np

from planner.approximation.grow import sharpest_knot
from planner.approximation.nudged import nudged
from planner.approximation.objective import Candidate, Problem
from planner.approximation.together import all_best_values, descend_all
from planner.approximation.tube import GRIDS, rechained
from planner.trajectory import Array

ROUGH = 1e-3
"""Relative decrease of the squared error below which a rough descent ends."""

ROUNDS = 15
"""Most evaluations of a descent from a chain."""

SEVERAL_FROM = 6
"""Segments from which on two curves are looked around, not one alone."""

APART = 1.0
"""Distance between knots [samples] from which on two curves are two."""

HARDLY_LESS = 0.9
"""Squared error over that of a rough curve with a segment less up to which it is surely less."""

HARDLY_NEARER = 0.5
"""The same for what either has more than the ideal, of which a descent can do away with most."""

NEXT_TO_NOTHING = 0.001
"""Squared error beyond the ideal's, relative to it, all of which a descent may do away with."""


def around(problem: Problem, ideal: Array, rough: Candidate) -> Candidate:
    """The best curve found from whole chains on grids, and by moves of single knots.

    Args:
        problem: What to approximate.
        ideal: Its slope-bounded ideal, shape (n,).
        rough: A curve of as many segments, at most ``LARGEST_WINDOW`` knots.
    """
    anchor = sharpest_knot(problem, rough) if problem.cyclic else 0
    chains = (rechained(problem, ideal, rough, grid, anchor=anchor) for grid in GRIDS)
    starts = all_best_values(problem, [knots for knots in chains if knots is not None])
    begun = descend_all(problem, [*starts, rough], rounds=ROUNDS, progress=ROUGH)
    begun.sort(key=_error)
    if problem.whole or problem.required.size:
        return begun[0]
    several = begun[:1]
    if rough.knots.size - (not problem.cyclic) >= SEVERAL_FROM:
        several += [curve for curve in begun[1:] if _apart(curve, begun[0])][:1]
    return min((nudged(problem, curve) for curve in several), key=_error)


def might_be_worse(curve: Candidate, rough: Candidate, ideal_error: float) -> bool:
    """Whether ``curve`` could be worse than one of a segment less once that is sought as well.

    Args:
        curve: A curve.
        rough: A rough one of a segment less.
        ideal_error: Squared error that none falls below.
    """
    if curve.error <= HARDLY_LESS * rough.error:
        return False
    beyond, ahead = curve.error - ideal_error, rough.error - ideal_error
    return beyond > HARDLY_NEARER * ahead or ahead < NEXT_TO_NOTHING * ideal_error


def _apart(curve: Candidate, other: Candidate) -> bool:
    return bool(np.max(np.abs(np.sort(curve.knots) - np.sort(other.knots))) > APART)


def _error(curve: Candidate) -> float:
    return curve.error
