"""Sets of knots moved by what they gain, many at once and without their values."""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from planner.approximation.requirements import BARELY_SHORT
from planner.approximation.segment_sums import SegmentSums
from planner.trajectory import Array

APART = 2.0
"""Distance between knots [samples] up to which two sets are one."""

OF_EACH = 40
"""Sets that are looked at for each one that is picked."""

ANY = 3
"""Knots up to which any of them are moved at once; of more, one or two neighbours."""


def climbed(sums: SegmentSums, sets: Array, spans: tuple[float, ...]) -> tuple[Array, Array]:
    """The sets, each moved to the best around it by one span after the other, the best first.

    Args:
        sums: Of the samples.
        sets: Ends of segments [samples], shape (m, S + 1); of a cycle the last a turn after the
            first.
        spans: By how much knots are moved [samples].

    Returns:
        The sets that differ, and what each gains.
    """
    problem, last = sums.problem, sets[0, -1] - sets[0, 0]
    moves = _moves(sets.shape[1], cyclic=problem.cyclic)
    for span in spans:
        tried = sets[:, None, :] + span * moves
        if problem.cyclic:  # the first knot within the first turn
            tried += np.where(tried[..., :1] < 0.0, last, 0.0)
            tried -= np.where(tried[..., :1] >= last, last, 0.0)
        possible = np.min(np.diff(tried, axis=-1), axis=-1) >= problem.shortest - BARELY_SHORT
        tried = np.where(possible[..., None], tried, sets[:, None, :])
        gains = sums.gains(sums.pieces(tried[..., :-1], tried[..., 1:]))
        rows, best = np.arange(sets.shape[0]), np.argmax(gains, axis=1)
        sets, gained = tried[rows, best], gains[rows, best]
        order = np.argsort(-gained, kind="stable")
        _, first = np.unique(sets[order], axis=0, return_index=True)
        order = order[np.sort(first)]
        sets, gained = sets[order], gained[order]
    return sets, gained


def picked(sets: Array, gains: Array, count: int) -> Array:
    """The best few sets that differ, shape (count or fewer, S + 1)."""
    many = min(gains.size, OF_EACH * count)
    best = np.argpartition(-gains, many - 1)[:many]
    sets = sets[best[np.lexsort((best, -gains[best]))]]
    chosen: list[Array] = []
    left = np.ones(many, dtype=bool)
    while len(chosen) < count and np.any(left):
        chosen.append(sets[int(np.argmax(left))])
        left &= np.max(np.abs(sets - chosen[-1]), axis=1) > APART
    return np.array(chosen)


@lru_cache(maxsize=64)
def _moves(size: int, *, cyclic: bool) -> Array:
    """Moves of the ends of a set, none among them, shape (moves, size)."""
    movable = size - (1 if cyclic else 2)
    if movable <= ANY:
        steps = np.array(list(product((0.0, -1.0, 1.0), repeat=movable)))
    else:
        one = np.eye(movable)
        along, against = one[:-1] + one[1:], one[:-1] - one[1:]
        steps = np.vstack([0.0 * one[:1], one, -one, along, -along, against, -against])
    moves = np.zeros((steps.shape[0], size))
    if cyclic:
        moves[:, :-1] = steps
        moves[:, -1] = steps[:, 0]
    else:
        moves[:, 1:-1] = steps
    moves.setflags(write=False)
    return moves
