"""The curve of fewest segments within a largest error, and of these one of small squared error.

The number of segments is that of a minimum-link path (:mod:`planner.approximation.fewest`). Then
knots and values descend together, with a penalty on what exceeds the bound.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from planner.approximation.fewest import Gates, fewest_links, fewest_links_around
from planner.approximation.fit_problem import (
    BARELY,
    SHORTEST,
    Candidate,
    Problem,
    candidate,
    error_at_pins,
    residuals,
)
from planner.approximation.values import attainable_error, by_windows
from planner.arrays import Array, Mask, steps
from planner.exceptions import Infeasible, angle_text

TIE = 0.25 * BARELY
"""Relative excess over the bound with which the segments are counted, so that ties are passed."""

HALVINGS = 12
"""Bisections for the smallest error that so many segments keep, as the curve in the middle of its
bounds is where least squares begin. 48 paths and cycles: 6: 1 % larger rms errors in the mean; 24:
no change for a quarter more time."""


def within_largest_error(
    problem: Problem, bound: float, most: int | None, unit: float
) -> tuple[Candidate, int]:
    """The fewest segments whose largest error is within ``bound``, as close as they come.

    Returns the curve, no error above ``bound`` (1 + :data:`BARELY`), and below by as much if that
    takes no more segments; and a lower bound on the segments of any, see :func:`minimum_link`.
    ``most`` are the most segments; messages take the samples times ``unit`` [rad].
    """
    attainable = attainable_error(problem.desired, problem.step, cyclic=problem.cyclic)
    if bound < attainable * (1.0 - BARELY):
        raise Infeasible(
            f"max_error: got {angle_text(bound * unit)}, but with slopes within ±v_max the "
            f"smallest attainable is {angle_text(attainable * unit)}; allow that much or a larger "
            "v_max"
        )
    widest = max(bound, attainable) * (1.0 + TIE) + 1e-15
    tight, fewest = minimum_link(problem, widest)
    count = problem.segments(tight.knots)
    if most is not None and count > most:
        word = "needed" if fewest > most else "found"
        raise Infeasible(
            f"max_error and the number of segments: got {angle_text(bound * unit)} with at most "
            f"{most} segments, but the fewest {word} are {count}; allow more error or more "
            "segments"
        )
    least = float(np.max(error_at_pins(problem), initial=attainable))
    low, high, spare = least * (1.0 + TIE) + 1e-15, widest, bound * (1.0 - BARELY)
    for turn in range(HALVINGS + 1):
        middle = spare if turn == 0 else 0.5 * (low + high)
        trial = minimum_link(problem, middle)[0] if middle > low else None
        if trial is not None and problem.segments(trial.knots) == count:
            tight, high = trial, middle
        elif turn > 0:
            low = middle
    if tight.knots.size == 1:
        middle = 0.5 * (np.max(problem.desired) + np.min(problem.desired))
        room = max(spare - 0.5 * np.ptp(problem.desired), 0.0)
        value = middle + np.clip(np.mean(problem.desired) - middle, -room, room)
        return candidate(problem, tight.knots, np.array([value])), fewest
    return least_squares_within(problem, tight, max(spare, high)), fewest


def minimum_link(problem: Problem, bound: float) -> tuple[Candidate, int]:
    """The curve of fewest segments with no error above ``bound``, and a lower bound on them; O(n).

    The bound is their number itself; for a cycle with required knots it may be one less. All
    segments of a path are a sample long or longer if required knots lie on samples, and those of a
    cycle nearly always.
    """
    if problem.cyclic and problem.required.size:
        return _cut(problem, bound)
    gates, breaks = gates_of(problem, bound)
    least, most = max(gates.lower), min(gates.upper)
    if not problem.cyclic:
        curve = fewest_links(gates, breaks)
    elif least <= most:
        curve = np.zeros(1), np.array([0.5 * (least + most)])
    else:
        curve = fewest_links_around(gates)
    return candidate(problem, *curve), problem.segments(curve[0])


def gates_of(problem: Problem, bound: float, start: float | None = None) -> tuple[Gates, list[int]]:
    """Gates at samples and required knots, and the numbers of the latter, ends left out.

    A cycle with a ``start`` is cut there to be a path; the last gate is a turn later.
    """
    n, ends = problem.samples, list[float]()
    places, required = np.arange(n), problem.required
    if start is not None:
        ends = [start, start + n]
        places = np.arange(math.ceil(start), math.floor(start + n) + 1)
        required = np.where(required > start, required, required + n)
    every = np.unique(np.concatenate([places, required, ends]))
    lower, upper = np.full(every.size, -np.inf), np.full(every.size, np.inf)
    samples, knots = np.searchsorted(every, places), np.searchsorted(every, required)
    desired = problem.desired[places % n]
    lower[samples], upper[samples] = desired - bound, desired + bound
    pinned = np.isfinite(problem.pins)
    lower[knots[pinned]] = upper[knots[pinned]] = problem.pins[pinned]
    gates = Gates(every.tolist(), lower.tolist(), upper.tolist(), problem.step)
    return gates, sorted(k for k in knots.tolist() if 0 < k < every.size - 1)


def _cut(problem: Problem, bound: float) -> tuple[Candidate, int]:
    """A cycle as a path from its first required knot back to it.

    A path whose ends are free needs no more segments, so that its number bounds that of a cycle;
    one that comes back to where it began takes at most one more.
    """
    gates, breaks = gates_of(problem, bound, float(problem.required[0]))
    low, high = gates.reachable()
    least, most = max(low[0], low[-1]), min(high[0], high[-1])

    def path(low: float, high: float) -> tuple[Array, Array]:
        lower, upper = [low, *gates.lower[1:-1], low], [high, *gates.upper[1:-1], high]
        return fewest_links(gates._replace(lower=lower, upper=upper), breaks)

    knots, values = path(float(least), float(most))
    fewest = knots.size - 1
    first, last = np.clip(values[[0, -1]], least, most)
    starts = [first, last, 0.5 * (first + last), *np.linspace(least, most, 5)[1:-1]]
    cycles = [path(float(value), float(value)) for value in starts]
    knots, values = min(cycles, key=lambda way: (way[0].size, -min(np.min(np.diff(way[0])), 1.0)))
    return candidate(problem, knots[:-1], values[:-1]), fewest


def least_squares_within(problem: Problem, curve: Candidate, bound: float) -> Candidate:
    """A curve of as many segments, within the same bounds, and of no larger squared error.

    The ``curve`` has no error above ``bound``. Fewer passes over many segments, so that the time is
    in proportion to the samples.
    """
    for _ in range(min(max(4000 // curve.knots.size, 1), 3)):
        curve = by_windows(problem, curve, partial(_descended, bound=bound))
    return curve


def _descended(problem: Problem, curve: Array, free: Mask, bound: float) -> tuple[Array, float]:
    """The best curve within the bound, (2K,), of descents with growing penalties on its excess.

    What is left of the excess at a high penalty is taken off the bound for the next descent. Of 120
    paths and cycles the rms errors are 2.5 % larger in the mean with the first penalty alone.
    """
    from planner.approximation.inner_loops import descend

    best = candidate(problem, *np.split(curve, 2))
    for first in (1.0, 1e2, 1e4):
        trial, inside, penalty = curve, bound, first
        for _ in range(12):
            # A margin of slopes for the rounding of descents
            nearer = problem._replace(
                step=problem.step * (1.0 - 1e-9), bound=inside, penalty=penalty
            )
            trial, _ = descend(nearer, trial, free, 12, 1e-3)
            knots, values = np.split(trial, 2)
            excess = float(np.max(np.abs(residuals(problem, knots, values)))) - bound
            if excess <= 5e-10 * bound:
                there = candidate(problem, knots, values)
                if there.error < best.error and keeps_slopes(problem, there):
                    best = there
                break
            penalty = min(30.0 * penalty, 1e6)
            if penalty == 1e6 and excess < 0.01 * bound:
                inside -= 1.5 * excess
    return np.append(best.knots, best.values), best.error


def keeps_slopes(problem: Problem, curve: Candidate) -> bool:
    """Whether all slopes keep the bound, and all segments are a sample long."""
    lengths = np.diff(problem.ends(curve.knots))
    rises = np.abs(steps(curve.values, cyclic=problem.cyclic))
    steep = np.any(rises > problem.step * (1.0 + 5e-13) * lengths)
    return bool(np.min(lengths) >= SHORTEST and not steep)
