"""Knots moved across samples, one at a time and all at once downhill.

The squared error has a kink wherever a knot meets a sample, and so a hollow of its own between any
two samples; Newton's method ends in the nearest one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import PiecewiseLinear
from planner.approximation.descent import descend
from planner.approximation.objective import Candidate, Problem, candidate
from planner.approximation.requirements import BARELY_SHORT, held
from planner.approximation.together import descend_all

MOVES = (-0.5, 0.5, -1.0, 1.0, -2.0, 2.0, -5.0, 5.0)
"""What a knot is moved by [samples]."""

ROUNDS = 4
"""Evaluations after which the best of them is chosen."""

SETTLING = 8
"""Evaluations before knots are moved."""

TURNS = 3
"""Times that this is done over, as long as it helps."""

KEPT = 12
"""Curves of all those that go on after the first of them."""

NEAR = 0.1
"""Distance from a sample at which a knot counts as in the hollow there."""

HELPS = 1e-4
"""Relative decrease of the squared error that is worth another turn."""


def nudged(problem: Problem, curve: Candidate) -> Candidate:
    """A curve that moves of single knots, each followed downhill, lead to; never a worse one."""
    best = descend(problem, curve, rounds=SETTLING)
    for _ in range(TURNS):
        starts = [best, *moved(problem, best)]
        found = min(descend_all(problem, starts, rounds=ROUNDS, keep=KEPT), key=_error)
        gained = best.error - found.error
        if gained <= 0.0:
            break
        best = found
        if gained <= HELPS * best.error:
            break
    return best


def settled_in_hollows(problem: Problem, curve: Candidate, *, rounds: int) -> Candidate:
    """A curve downhill of ``curve``, also where knots in hollows held the others back."""
    best = descend(problem, curve, rounds=rounds)
    here, still = in_hollows(problem, best)
    if not np.any(still):
        return best
    return min(best, descend(problem, here, rounds=rounds, hold=still), key=_error)


def in_hollows(problem: Problem, curve: Candidate) -> tuple[Candidate, npt.NDArray[np.bool_]]:
    """The curve with the knots that lie next to a hollow put into it, and which those are.

    A knot moved past a sample takes it from one line to the other, so the derivative of the squared
    error jumps there by twice the residual times the change of slope. Where it jumps upwards, the
    hollow's bottom is the sample itself, which Newton's method jumps over to and fro, while damping
    holds all other knots back too.
    """
    knots, n = curve.knots, problem.samples
    whole = np.floor(knots + 0.5)
    ends, values = knots, curve.values
    if problem.cyclic:
        ends, values = np.append(knots, knots[0] + n), np.append(values, values[0])
    slopes = np.diff(values) / np.diff(ends)
    bend = slopes - np.roll(slopes, 1) if problem.cyclic else np.diff(slopes, prepend=0, append=0)
    residual = np.interp(whole, knots, curve.values, period=n if problem.cyclic else None)
    residual = residual - problem.desired[whole.astype(np.intp) % n]
    still = (np.abs(knots - whole) <= NEAR) & (residual * bend > 0.0) & ~held(problem, knots)[0]
    if not np.any(still):
        return curve, still
    knots = np.where(still, whole, knots)
    ends = np.append(knots, knots[0] + n) if problem.cyclic else knots
    if np.min(np.diff(ends)) < problem.shortest - BARELY_SHORT:
        return curve, np.zeros(knots.size, dtype=bool)
    return candidate(problem, knots, _along(problem, curve)(knots)), still


def _along(problem: Problem, curve: Candidate) -> PiecewiseLinear:
    return PiecewiseLinear(
        knots=curve.knots,
        values=curve.values,
        samples=problem.samples,
        tick=1.0,
        cyclic=problem.cyclic,
    )


def _error(curve: Candidate) -> float:
    return curve.error


def moved(problem: Problem, curve: Candidate) -> list[Candidate]:
    """The curves with one knot moved along the curve; their errors are left to be found."""
    along = _along(problem, curve)
    movable = np.flatnonzero(~held(problem, curve.knots)[0])
    moves = np.tile(MOVES, movable.size)
    which = np.repeat(movable, len(MOVES))
    knots = np.tile(curve.knots, (which.size, 1))
    row = np.arange(which.size)
    knots[row, which] += moves
    ends = knots
    if problem.cyclic:
        ends = np.concatenate([knots, knots[:, :1] + problem.samples], axis=1)
    possible = np.min(np.diff(ends, axis=1), axis=1) >= problem.shortest - BARELY_SHORT
    values = np.tile(curve.values, (which.size, 1))
    values[row, which] = along(knots[row, which])
    return [
        Candidate(k, v, curve.error) for k, v in zip(knots[possible], values[possible], strict=True)
    ]
