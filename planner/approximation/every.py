"""Two or three segments: every set of knots on a grid at once, and the best of them downhill."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
import numpy.typing as npt

from planner.approximation.climbing import climbed, picked
from planner.approximation.nudged import settled_in_hollows
from planner.approximation.objective import Candidate, Problem
from planner.approximation.segment_sums import Pieces, SegmentSums
from planner.approximation.together import all_best_values, descend_all
from planner.trajectory import Array

FEW_SAMPLES, MANY_SAMPLES = 8, 200
"""Samples from which on, and up to which, a grid sees enough."""

MOST_SEGMENTS = 3
"""Segments of the longest curves."""

MOST_SETS = 5000
"""Sets of knots on a grid; of more, the grid is coarser."""

PICKED = 8
"""Sets that are moved off the grid."""

SPANS = (1.0, 2.0, 1.0, 1.0, 0.5, 0.25)
"""By how much their knots are moved, one span after the other [samples]."""

ROUNDS, KEPT = 4, 4
"""Evaluations of each descent, and how many go on after the first of them."""

SETTLING = 15
"""Most evaluations of the last descent."""

TOO_STEEP, ROUNDING = 1e-6, 1e-9
"""Squared error over that with the slopes free, relative and absolute, from which they bind."""


def within_reach(problem: Problem, segments: int, ideal_error: float) -> bool:
    """Whether the samples are few enough, the knots free, and the best values known at once."""
    few = FEW_SAMPLES <= problem.samples <= MANY_SAMPLES and 2 <= segments <= MOST_SEGMENTS
    bounded = segments > 2 and not problem.cyclic and ideal_error > 0.0
    return few and not bounded and problem.anywhere


def of_every_set(
    problem: Problem, segments: int, proposed: Sequence[Array] = ()
) -> Candidate | None:
    """The best curve found of two or three segments, from all sets of knots on a grid.

    Args:
        problem: What to approximate, with nothing required.
        segments: Number of segments, at most :data:`MOST_SEGMENTS`.
        proposed: Sets of knots that are moved besides, each shape (K,).

    Returns:
        The curve; None where bounds on the slopes bind a path of three, which the grid leaves out.
    """
    sets, least = best_sets(problem, segments, proposed)
    starts = all_best_values(problem, sets)
    if starts[0].error > (1.0 + TOO_STEEP) * least + ROUNDING:
        return None
    ends = descend_all(problem, starts, rounds=ROUNDS, keep=KEPT)
    return settled_in_hollows(problem, min(ends, key=_error), rounds=SETTLING)


def best_sets(
    problem: Problem, segments: int, proposed: Sequence[Array] = ()
) -> tuple[list[Array], float]:
    """The best sets of knots on and off the grid, and the squared error of the first."""
    sums = SegmentSums(problem)
    last = problem.samples if problem.cyclic else problem.samples - 1
    nodes, ends = _sets(last, segments, cyclic=problem.cyclic)
    table = sums.pieces(nodes[None, :], nodes[:, None])
    flat = ends[:, 1:] * nodes.size + ends[:, :-1]
    gains = sums.gains(Pieces(*(each.ravel()[flat] for each in table)))
    sets = picked(nodes[ends], gains, PICKED)
    for knots in proposed:
        sets = np.vstack([sets, np.append(knots, knots[0] + last) if problem.cyclic else knots])
    sets, gains = climbed(sums, sets, SPANS)
    found = [each[:-1] if problem.cyclic else each for each in sets]
    return found, sums.square - float(gains[0])


@lru_cache(maxsize=16)
def _sets(last: int, segments: int, *, cyclic: bool) -> tuple[Array, npt.NDArray[np.intp]]:
    """Nodes among the samples, and all sets of them that are ends of so many segments.

    A cycle's nodes go on for a second turn, and its sets end where they begin, a turn later.
    """
    inner = segments if cyclic else segments - 1
    count = last if cyclic else last - 1
    while math.comb(count, inner) > MOST_SETS:
        count -= 1
    sets = np.array(list(combinations(range(count), inner)), dtype=np.intp)
    if cyclic:
        nodes = np.round(np.arange(count) * last / count)
        nodes = np.concatenate([nodes, last + nodes])
        sets = np.column_stack([sets, sets[:, 0] + count])
    else:
        nodes = np.round(np.linspace(0.0, last, count + 2))
        sets = np.pad(sets + 1, ((0, 0), (1, 1)))
        sets[:, -1] = count + 1
    nodes.setflags(write=False)
    sets.setflags(write=False)
    return nodes, sets


def _error(curve: Candidate) -> float:
    return curve.error
