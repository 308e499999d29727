"""A path with one knot left out and another put in elsewhere, as long as that helps."""

from __future__ import annotations

import numpy as np

from planner.approximation.climbing import climbed, picked
from planner.approximation.nudged import settled_in_hollows
from planner.approximation.objective import Candidate, Problem
from planner.approximation.segment_sums import SegmentSums
from planner.approximation.together import all_best_values, descend_all
from planner.trajectory import Array

TURNS = 3
"""Times that a knot is exchanged."""

PLACES = 128
"""Most places at which a knot is put in."""

PICKED = 8
"""Exchanges that are followed downhill."""

SPANS = (1.0, 0.5, 0.25)
"""By how much their knots are moved before, one span after the other [samples]."""

ROUNDS, KEPT = 6, 3
"""Evaluations of each descent, and how many go on after the first of them."""

SETTLING = 15
"""Most evaluations of the last descent."""

HELPS = 1e-4
"""Relative decrease of the squared error that is worth another turn."""


def exchanged(problem: Problem, curve: Candidate) -> Candidate:
    """A curve that exchanges of single knots, each followed downhill, lead to; never a worse one.

    Args:
        problem: What to approximate: a path with nothing required, whose slopes hardly bind.
        curve: Where to begin, at least two inner knots.
    """
    sums, best = SegmentSums(problem), curve
    for _ in range(TURNS):
        tried = exchanges(best.knots)
        gains = sums.gains(sums.pieces(tried[:, :-1], tried[:, 1:]))
        sets, _ = climbed(sums, picked(tried, gains, PICKED), SPANS)
        starts = all_best_values(problem, list(sets))
        found = min(descend_all(problem, starts, rounds=ROUNDS, keep=KEPT), key=_error)
        gained = best.error - found.error
        if gained <= 0.0:
            break
        best = settled_in_hollows(problem, found, rounds=SETTLING)
        if gained <= HELPS * best.error:
            break
    return best


def exchanges(knots: Array) -> Array:
    """All sets with one inner knot left out and another put in, shape (m, K)."""
    last, inner = knots[-1], knots.size - 2
    fresh = np.linspace(0.0, last, min(int(last), PLACES) + 1)[1:-1]
    fresh = fresh[np.min(np.abs(fresh[:, None] - knots), axis=1) >= 1.0]
    left = np.array([np.delete(knots, k) for k in range(1, inner + 1)])
    sets = np.column_stack([np.repeat(left, fresh.size, axis=0), np.tile(fresh, inner)])
    return np.sort(sets, axis=1)


def _error(curve: Candidate) -> float:
    return curve.error
