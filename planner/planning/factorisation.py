"""The factorisation L D L' of a sparse quasi-definite matrix, compiled.

Quasi-definite matrices, such as those of KKT systems with regularised conditions, have it under any
symmetric permutation (R. J. Vanderbei, SIAM J. Optim. 5, 1995). The pattern of L is computed once
from the pattern of the matrix, by its elimination tree; the numbers follow row by row, as in QDLDL
(B. Stellato, G. Banjac, P. Goulart, A. Bemporad, S. Boyd, *OSQP: an operator splitting solver for
quadratic programs*, Math. Prog. Comp. 12, 2020).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, Indices
from planner.compilation import inner

Places = npt.NDArray[np.uint32]
"""Unsigned: Numba tests each signed index for being negative, a sixth of the time of a solution."""


class Factor(NamedTuple):
    """Storage of the entries of a symmetric matrix, of one triangle, and of its factor L."""

    rows: Places  # row and column of each entry
    columns: Places
    position: Places  # of each unknown in the order of elimination, (unknowns,)
    place: Places  # of each entry among the stored ones; equal places are one
    column: Indices  # first stored entry of each column of the upper triangle, (unknowns + 1,)
    row: Places  # row of each stored entry
    reach: Indices  # first of the columns of L with an entry in each row, (unknowns + 1,)
    reached: Places  # these columns, ascending
    below: Indices  # first entry of each column of L, (unknowns + 1,)
    lower: Places  # row of each entry of L


@inner
def factor_of(rows: Places, columns: Places, position: Places) -> Factor:
    """The storage of a matrix with these entries, of one triangle, and the pattern of its factor.

    The matrix is stored in columns of the permuted upper triangle; equal places are one.
    """
    size, count = len(position), len(rows)
    column = np.zeros(size + 1, np.int64)
    for e in range(count):
        column[max(position[rows[e]], position[columns[e]]) + 1] += 1
    for k in range(size):
        column[k + 1] += column[k]
    order, following = np.empty(count, np.int64), column.copy()
    for e in range(count):
        k = max(position[rows[e]], position[columns[e]])
        order[following[k]] = e
        following[k] += 1
    place, row = np.empty(count, np.uint32), np.empty(count, np.uint32)
    seen, first, number = np.zeros(size, np.int64), 0, 0  # seen: places so far, with the row's own
    for k in range(size):
        begin, last = number, column[k + 1]
        for at in range(first, last):
            e = order[at]
            i = min(position[rows[e]], position[columns[e]])
            if seen[i] <= begin:
                row[number] = i
                number += 1
                seen[i] = number
            place[e] = seen[i] - 1
        first, column[k + 1] = last, number
    parent, seen = np.zeros(size, np.int64), np.zeros(size, np.int64)  # 0 is no column's parent
    reach, below = np.zeros(size + 1, np.int64), np.zeros(size + 1, np.int64)
    for k in range(size):  # the elimination tree, and how many entries
        seen[k] = k
        for at in range(column[k], column[k + 1]):
            i = row[at]
            while i < k and seen[i] != k:
                if parent[i] == 0:
                    parent[i] = k
                seen[i] = k
                reach[k + 1] += 1
                below[i + 1] += 1
                i = parent[i]
    for k in range(size):
        reach[k + 1] += reach[k]
        below[k + 1] += below[k]
    reached, entries = np.empty(reach[size], np.uint32), np.empty(reach[size], np.uint32)
    following = below.copy()
    for k in range(size):
        seen[k] = size + k
        for at in range(column[k], column[k + 1]):
            i = row[at]
            while i < k and seen[i] != size + k:
                seen[i] = size + k
                entries[following[i]] = k
                following[i] += 1
                i = parent[i]
    following = reach.copy()
    for i in range(size):  # so that they ascend
        for at in range(below[i], below[i + 1]):
            k = entries[at]
            reached[following[k]] = i
            following[k] += 1
    stored = row[:number].copy()
    return Factor(rows, columns, position, place, column, stored, reach, reached, below, entries)


class Space(NamedTuple):
    """Work space of :func:`solved`."""

    unknowns: Array  # (3, unknowns)
    following: Indices  # (unknowns,)
    lower: Array  # entries of L


@inner
def solved(pattern: Factor, space: Space, values: Array, right: Array, answer: Array) -> bool:
    """Fill the solution, in the unknowns' own order; False where a pivot vanishes.

    Row by row the factor L, the pivots D and the solution of L y = b, by the up-looking algorithm
    of QDLDL (B. Stellato and others, OSQP, Math. Prog. Comp. 12, 2020); then back. ``values`` are
    the stored entries of the matrix.
    """
    size, position = len(right), pattern.position
    column, row, reach, reached = pattern.column, pattern.row, pattern.reach, pattern.reached
    below, rows, following, lower = pattern.below, pattern.lower, space.following, space.lower
    work, pivots, permuted = space.unknowns
    for number in range(size):
        permuted[position[number]], work[number] = right[number], 0.0
        following[number] = below[number]
    for k in range(size):
        pivot, known = 0.0, permuted[k]
        for at in range(column[k], column[k + 1]):
            i = row[at]
            if i == k:
                pivot = values[at]
            else:
                work[i] = values[at]
        for at in range(reach[k], reach[k + 1]):
            i = reached[at]
            value = work[i]
            work[i] = 0.0
            end = following[i]
            for p in range(below[i], end):
                work[rows[p]] -= lower[p] * value
            share = value / pivots[i]
            lower[end] = share
            following[i] = end + 1
            pivot -= share * value
            known -= share * permuted[i]
        if not abs(pivot) > 0.0 or not abs(pivot) < np.inf:
            return False
        pivots[k], permuted[k] = pivot, known
    for i in range(size - 1, -1, -1):
        value = permuted[i] / pivots[i]
        for p in range(below[i], below[i + 1]):
            value -= lower[p] * permuted[rows[p]]
        permuted[i] = value
    for number in range(size):
        answer[number] = permuted[position[number]]
    return True
