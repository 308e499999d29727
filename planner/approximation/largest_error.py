"""The curve of fewest segments within a largest error, and of these one of small squared error.

The number of segments is that of a minimum-link path (:mod:`planner.approximation.fewest`). Then
all knots move at once, each within the gap between two samples where it lies: with the samples
dealt out to the segments, the lines themselves are the unknowns of a convex QP, (5c) of
docs/math.md, since the largest error, the bound on the slopes, and that two neighbours cross in the
gap between their samples are linear in them once it is known which of the two is the steeper one. A
knot that ends on a sample moves on the same way in the next round, or the other way if it has not
moved. No round leaves the bounds or raises the squared error.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from planner.approximation.fewest import Course, Gates, fewest_links, fewest_links_around
from planner.approximation.problem import (
    BARELY,
    SHORTEST,
    Candidate,
    Problem,
    candidate,
    error_at_pins,
    required_knots,
    residuals,
)
from planner.approximation.values import attainable_error, solve_qp
from planner.exceptions import Infeasible, angle_text
from planner.trajectory import Array, Indices, Mask, steps

TIE = 0.25 * BARELY
"""Relative excess over the bound with which the segments are counted, so that ties are passed."""

HALVINGS = 12
"""Bisections for the smallest error that so many segments keep, as the curve in the middle of its
bounds is where least squares begin. 48 paths and cycles: 6: 1 % larger rms errors in the mean; 24:
no change for a quarter more time. 4 series of 12,000: 3: half the time, but up to 75 % larger
errors."""

MOST_LINES = 4000
"""Lines in all rounds of least squares together from which on there is none after the first, so
that the time is in proportion to the samples. All rounds for 2,500 segments: 9 % smaller errors at
best, 2.7 times the time."""

MOST_ROUNDS = 14
"""Rounds of least squares at most; 6: rms errors 1.3 % larger at worst."""

MARGIN = 1e-7
"""Share of the bounds that is left to OSQP's tolerance. None: rms errors 3 % larger in the mean, 78
% at worst; 1e-6: no change."""


def within_largest_error(
    problem: Problem, bound: float, most: int | None, unit: float
) -> tuple[Candidate, int]:
    """The fewest segments whose largest error is within ``bound``, as close as they come.

    Args:
        problem: The approximation problem, samples of size one.
        bound: Largest error [unit of the samples]; kept with :data:`BARELY` to spare if that takes
            no more segments.
        most: Most segments; None for any number.
        unit: Unit of the samples [rad], for the messages.

    Returns:
        The curve, no error above ``bound`` (1 + :data:`BARELY`), and a lower bound on the segments
        of any: for paths their number itself.

    Raises:
        Infeasible: No curve within the slopes, or none of at most so many segments, is as close.
    """
    attainable = attainable_error(problem.desired, problem.step, cyclic=problem.cyclic)
    if bound < attainable * (1.0 - BARELY):
        raise Infeasible(
            f"max_error: got {angle_text(bound * unit)}, but with slopes within ±v_max the "
            f"smallest attainable is {angle_text(attainable * unit)}; allow that much or a larger "
            "v_max"
        )
    widest = max(bound, attainable) * (1.0 + TIE) + 1e-15
    course = minimum_link(problem, widest)
    count = problem.segments(course.knots)
    if most is not None and count > most:
        word = "needed" if course.fewest > most else "found"
        raise Infeasible(
            f"max_error and the number of segments: got {angle_text(bound * unit)} with at most "
            f"{most} segments, but the fewest {word} are {count}; allow more error or more "
            "segments"
        )
    spare = bound * (1.0 - BARELY)
    tight = course
    least = float(np.max(error_at_pins(problem), initial=attainable))
    low, high = least * (1.0 + TIE) + 1e-15, widest
    for turn in range(HALVINGS + 1):
        middle = spare if turn == 0 else 0.5 * (low + high)
        trial = minimum_link(problem, middle) if middle > low else None
        if trial is not None and problem.segments(trial.knots) == count:
            tight, high = trial, middle
        elif turn > 0:
            low = middle
    limit = spare if high <= spare else high
    if tight.knots.size == 1:
        middle = 0.5 * (np.max(problem.desired) + np.min(problem.desired))
        room = max(spare - 0.5 * np.ptp(problem.desired), 0.0)
        value = middle + np.clip(np.mean(problem.desired) - middle, -room, room)
        return candidate(problem, tight.knots, np.array([value])), course.fewest
    curve = candidate(problem, tight.knots, tight.values)
    return least_squares_within(problem, curve, limit), course.fewest


def minimum_link(problem: Problem, bound: float) -> Course:
    """The curve of fewest segments with no error above ``bound``; O(n).

    Returns:
        The curve. It has as few segments as possible; a cycle with required knots at most one more.
        All segments of a path are a sample long or longer if required knots lie on samples, and
        those of a cycle nearly always.
    """
    if not problem.cyclic:
        return fewest_links(*gates_of(problem, bound))
    if problem.required.size:
        return _cut(problem, bound, float(problem.required[0]))
    gates, _ = gates_of(problem, bound)
    least, most = max(gates.lower), min(gates.upper)
    if least <= most:
        return Course(np.zeros(1), np.array([0.5 * (least + most)]), 1)
    return fewest_links_around(gates) or _cut(problem, bound, 0.0)


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


def _cut(problem: Problem, bound: float, place: float) -> Course:
    """A cycle with a knot at a place, as a path from there back to it.

    A path whose ends are free needs no more segments; one that comes back to where it began takes
    at most one more.

    Returns:
        The cycle, its ``fewest`` for any place where no knot is required.
    """
    gates, breaks = gates_of(problem, bound, place)
    low, high = gates.reachable()
    least, most = max(low[0], low[-1]), min(high[0], high[-1])

    def path(low: float, high: float) -> Course:
        lower, upper = [low, *gates.lower[1:-1], low], [high, *gates.upper[1:-1], high]
        return fewest_links(gates._replace(lower=lower, upper=upper), breaks)

    free = path(float(least), float(most))
    first, last = np.clip(free.values[[0, -1]], least, most)
    starts = [first, last, 0.5 * (first + last), *np.linspace(least, most, 5)[1:-1]]
    cycles = [path(float(value), float(value)) for value in starts]
    best = min(
        cycles, key=lambda each: (each.fewest, -min(float(np.min(np.diff(each.knots))), 1.0))
    )
    here = bool(np.any(problem.required == place))
    return Course(best.knots[:-1], best.values[:-1], free.fewest - (not here))


def least_squares_within(problem: Problem, curve: Candidate, bound: float) -> Candidate:
    """A curve of as many segments, within the same bounds, and of no larger squared error.

    The ``curve`` has no error above ``bound``. Each round is one QP of OSQP with O(n) rows.
    """
    before, after = curve.error, np.ones(curve.knots.size, dtype=bool)
    for turn in range(min(max(MOST_LINES // curve.knots.size, 1), MOST_ROUNDS)):
        # Hundreds of lines take OSQP long: at first it may be far from the bounds.
        margin = max(MARGIN, 1e-2 / 10.0**turn)
        moved = _together(problem, curve, bound, after, margin)
        stays = moved.knots == curve.knots
        after = np.where(stays, ~after, moved.knots > curve.knots)
        curve = moved
        if turn % 2:
            if curve.error >= (1.0 - 3e-4) * before:
                break
            before = curve.error
    return curve


def _together(
    problem: Problem, curve: Candidate, bound: float, after: Mask, margin: float
) -> Candidate:
    """The curve with all knots moved within their gaps, or as it is where that is no better.

    ``margin`` is the share of the bounds that is left to OSQP's tolerance.
    """
    lines = _lines_of(problem, curve, after)
    if np.any(lines.last < lines.first):
        return curve
    change = _changes(problem, curve, lines, bound, margin)
    if not np.all(np.isfinite(change)):
        return curve
    level, rise = np.split(bound * change, 2)
    lines = lines._replace(level=lines.level + level, slope=lines.slope + rise / lines.half)
    moved = candidate(problem, *_joined(problem, curve, lines))
    steepest = problem.step * (1.0 + 5e-13) * np.diff(problem.ends(moved.knots))
    if (
        not moved.error < curve.error
        or np.min(np.diff(problem.ends(moved.knots))) < SHORTEST
        or np.max(np.abs(residuals(problem, moved.knots, moved.values))) > bound * (1.0 + 5e-10)
        or np.any(np.abs(steps(moved.values, cyclic=problem.cyclic)) > steepest)
    ):
        return curve
    return moved


class _Lines(NamedTuple):
    """The lines of a curve, the samples that each passes, and where its knots may move."""

    first: Indices  # first sample of each line, of a cycle counted on beyond its end, (S,)
    last: Indices  # last sample of each line
    middle: Array  # middle of these samples
    half: Array  # half of their extent
    level: Array  # value of the line in their middle
    slope: Array  # its slope
    before: Indices  # number of the line before each joint, (J,)
    behind: Indices  # that of the line behind it, and of the knot in the curve
    turn: Array  # how much later the line before is
    low: Array  # least place of each joint
    high: Array  # largest place of each joint

    def at(self, line: Indices, place: Array) -> Array:
        """Values of lines at places."""
        return self.level[line] + self.slope[line] * (place - self.middle[line])


def _lines_of(problem: Problem, curve: Candidate, after: Mask) -> _Lines:
    """The samples dealt out to the lines.

    Knots on a sample move in the gap after it where ``after`` is true, else in the one before it.
    """
    n, size = problem.samples, curve.knots.size
    number = np.arange(size + problem.cyclic) % size
    fixed, after = required_knots(problem, curve.knots)[0][number], after[number]
    x, y = problem.ends(curve.knots), curve.values[number]
    whole = np.abs(x - np.rint(x)) <= 1.0 - SHORTEST
    x = np.where(whole & ~fixed, np.rint(x), x)
    low = np.where(whole, np.rint(x) - ~after, np.floor(x))
    last = np.where(fixed, np.ceil(x) - 1.0 + after * (x == np.rint(x)), low)
    high = low + 1.0
    spare = 0.5 * np.maximum(np.diff(x) - 1.0, 0.0)
    tight = low[1:] - high[:-1] < 1.0
    high[:-1] = np.where(tight, np.minimum(high[:-1], x[:-1] + spare), high[:-1])
    low[1:] = np.where(tight, np.maximum(low[1:], x[1:] - spare), low[1:])
    low, high = np.where(fixed, x, low), np.where(fixed, x, high)
    if problem.cyclic:
        low[0] = low[-1] - n
    else:
        last[0], last[-1] = -1.0, n - 1.0
    behind = np.arange(not problem.cyclic, x.size - 1)
    first = last[:-1] + 1.0
    middle, half = 0.5 * (first + last[1:]), np.maximum(0.5 * (last[1:] - first), 0.5)
    slope = np.diff(y) / np.diff(x)
    return _Lines(
        first=first.astype(np.intp),
        last=last[1:].astype(np.intp),
        middle=middle,
        half=half,
        level=y[:-1] + slope * (middle - x[:-1]),
        slope=slope,
        before=(behind - 1) % slope.size,
        behind=behind,
        turn=np.where(behind == 0, float(n), 0.0),
        low=low[behind],
        high=high[behind],
    )


def _changes(
    problem: Problem, curve: Candidate, lines: _Lines, bound: float, margin: float
) -> Array:
    """The QP in the lines: changes of level, and of rise over half a line's samples, (2S,).

    They are in units of ``bound``, so that zero is the curve itself, which meets all conditions.
    """
    from scipy import sparse

    size = lines.level.size
    index = np.arange(lines.first[0], lines.last[-1] + 1)
    desired = problem.desired[index % problem.samples]
    line = np.repeat(np.arange(size), lines.last - lines.first + 1)

    def values(which: Indices, at: Array) -> Any:
        """Rows that give the change of a line's value at a place."""
        along = (at - lines.middle[which]) / lines.half[which]
        entries = np.append(np.ones(at.size), along)
        row = np.tile(np.arange(at.size), 2)
        columns = np.append(which, size + which)
        return sparse.csr_matrix((entries, (row, columns)), shape=(at.size, 2 * size))

    passed = values(line, index)
    residual = (desired - lines.at(line, index)) / bound
    starts = lines.first - lines.first[0]
    hull = np.concatenate(
        [k + _corners(part) for k, part in zip(starts, np.split(desired, starts[1:]), strict=True)]
    )
    rows = [passed[hull], sparse.eye(2 * size, format="csr")[size:]]
    room = 1.0 - margin
    lower = [residual[hull] - room, (-problem.step * room - lines.slope) * lines.half / bound]
    upper = [residual[hull] + room, (problem.step * room - lines.slope) * lines.half / bound]
    before, behind = lines.before, lines.behind
    convex = np.where(lines.slope[behind] >= lines.slope[before], 1.0, -1.0)
    for at, way in ((lines.low, -convex), (lines.high, convex)):
        rows.append(sparse.diags(way) @ (values(behind, at) - values(before, at + lines.turn)))
        lower.append(-way * (lines.at(behind, at) - lines.at(before, at + lines.turn)) / bound)
        upper.append(np.full(at.size, np.inf))
    stay = np.flatnonzero(np.isfinite(required_knots(problem, curve.knots)[1]))
    rows.append(values(np.minimum(stay, size - 1), curve.knots[stay]))
    lower.append(np.zeros(stay.size))
    upper.append(np.zeros(stay.size))
    return solve_qp(
        # A line through one sample has no slope of its own.
        passed.T @ passed + 1e-9 * sparse.diags(np.repeat([0.0, 1.0], size)),
        -(passed.T @ residual),
        sparse.vstack(rows),
        np.minimum(np.concatenate(lower), 0.0),
        np.maximum(np.concatenate(upper), 0.0),
        np.zeros(2 * size),
        iterations=2_000,
    )[0]


def _joined(problem: Problem, curve: Candidate, lines: _Lines) -> tuple[Array, Array]:
    """Knots where the lines cross, and values there."""
    knots, values = curve.knots.copy(), curve.values.copy()
    apart = lines.at(lines.before, lines.low + lines.turn) - lines.at(lines.behind, lines.low)
    bend = lines.slope[lines.behind] - lines.slope[lines.before]
    away = np.divide(apart, bend, out=np.zeros(bend.size), where=bend != 0.0)
    place = np.minimum(np.maximum(lines.low + away, lines.low), lines.high)
    knots[lines.behind], values[lines.behind] = place, lines.at(lines.behind, place)
    if not problem.cyclic:
        ends, at = np.array([0, -1]), np.array([0, lines.level.size - 1])
        values[ends] = lines.at(at, knots[ends])
    pinned = np.isfinite(required_knots(problem, knots)[1])
    return knots, np.where(pinned, curve.values, values)


def _corners(samples: Array) -> Indices:
    """Numbers of the samples at the corners of their convex hull, which bound a line."""
    kept: set[int] = set()
    for ends in (samples.tolist(), (-samples).tolist()):
        hull: list[int] = []
        for k, end in enumerate(ends):
            while len(hull) >= 2:
                i, j = hull[-2:]
                if (ends[j] - ends[i]) * (k - j) > (end - ends[j]) * (j - i):
                    break
                hull.pop()
            hull.append(k)
        kept.update(hull)
    return np.array(sorted(kept))
