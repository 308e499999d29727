"""Potentials for the relaxation: from a curve, and uphill from there."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.approximation.objective import Candidate, Problem
from planner.approximation.relaxation import Bound, Potentials, Relaxation
from planner.trajectory import Array


def first_potentials(problem: Problem, curve: Candidate, nodes: npt.NDArray[np.intp]) -> Potentials:
    """The potentials at ``nodes`` that make ``curve`` the cheapest chain with its own knots.

    A segment is at rest if twice the sum of its residuals, w (P - d), equals the potential at its
    start less that at its end; the first one follows from a segment whose slope is free.
    """
    n = problem.samples
    index = np.arange(n, dtype=np.float64)
    fitted = np.interp(index, curve.knots, curve.values, period=n if problem.cyclic else None)
    residual = problem.weights * (fitted - problem.desired)
    along = -2.0 * (np.cumsum(residual) - 0.5 * residual)
    if problem.cyclic:
        along += _first_of_cycle(problem, curve, residual, along)
    else:
        along[[0, -1]] = 0.0
    table = np.tile(along[nodes], (curve.knots.size, 1))
    return Potentials(table, table.copy())


def climb(
    relaxation: Relaxation, potentials: Potentials, found: Bound, reach: float, width: int
) -> bool:
    """Move the potentials up by a step of Polyak's, in place.

    Args:
        relaxation: What they are for.
        potentials: What to move.
        found: The cheapest chain under them.
        reach: How much higher the bound should become.
        width: Neighbours of a knot that learn from its mismatch [nodes].

    Returns:
        False if the chain's segments meet: the bound is as high as can be.
    """
    by_into, by_out = relaxation.mismatches(found.chain, potentials)
    square = float(by_into @ by_into + by_out @ by_out)
    if square < 1e-20:
        return False
    step = 2.0 * reach / square
    for t, knot in enumerate(found.chain):
        near = relaxation.around(knot, width)
        potentials.into[t] += step * by_into[t] * near
        potentials.out[t] += step * by_out[t] * near
    return True


def _first_of_cycle(problem: Problem, curve: Candidate, residual: Array, along: Array) -> float:
    """What to add to the potentials of a cycle, from the segments whose slopes are free if any."""
    n = problem.samples
    ends = np.append(curve.knots, curve.knots[0] + n).astype(np.intp)
    values = np.append(curve.values, curve.values[0])
    found = []
    for i, j, rise in zip(ends[:-1], ends[1:], np.diff(values), strict=True):
        if j == i:  # knots between samples, a hair less than one apart
            continue
        free = abs(rise) < problem.step * (j - i) * (1.0 - 1e-6)
        inside = np.arange(i, j + 1)
        share = np.full(inside.size, 2.0)
        share[[0, -1]] = 1.0
        turn = float(share * residual[inside % n] @ (inside - i))
        start = along[i % n]
        end = start - float(share @ residual[inside % n])
        # d/dm about the start: turn + end (j - i) = 0 at rest, with both raised by the answer.
        found.append((free, -(turn + end * (j - i)) / (j - i)))
    any_free = any(free for free, _ in found)
    return float(np.mean([first for free, first in found if free or not any_free] or [0.0]))
