"""The curve of fewest segments within a largest error, and of these one of small squared error.

The number of segments is that of a minimum-link path (:mod:`planner.approximation.fewest`). Then
all knots move at once, each within the gap between two samples where it lies, by a convex QP, (5c)
of docs/math.md, whose unknowns are the lines. A knot that ends on a sample moves on the same way in
the next round, or the other way if it has not moved.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from planner.approximation.fewest import Gates, fewest_links, fewest_links_around
from planner.approximation.fit_problem import (
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
from planner.arrays import Array, Indices, Mask, steps
from planner.exceptions import Infeasible, angle_text

TIE = 0.25 * BARELY
"""Relative excess over the bound with which the segments are counted, so that ties are passed."""

HALVINGS = 12
"""Bisections for the smallest error that so many segments keep, as the curve in the middle of its
bounds is where least squares begin. 48 paths and cycles: 6: 1 % larger rms errors in the mean; 24:
no change for a quarter more time."""

MOST_LINES = 4000
"""Lines in all rounds of least squares together, or in the first, so that the time is in proportion
to the samples. All rounds for 2,500 segments: 9 % smaller errors at best, 2.7 times the time."""

MOST_ROUNDS = 8  # rounds of least squares at most; 14: 0.03 % smaller rms errors in the mean
MARGIN = 1e-9  # share of the bounds that is left to the tolerance of the QP


def within_largest_error(
    problem: Problem, bound: float, most: int | None, unit: float
) -> tuple[Candidate, int]:
    """The fewest segments whose largest error is within ``bound``, as close as they come.

    Returns the curve, no error above ``bound`` (1 + :data:`BARELY`), and below by as much if that
    takes no more segments; and a lower bound on the segments of any: for paths their number itself.
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

    A cycle with required knots has at most one more. All segments of a path are a sample long or
    longer if required knots lie on samples, and those of a cycle nearly always.
    """
    gates, breaks = gates_of(problem, bound)
    least, most = max(gates.lower), min(gates.upper)
    curve: tuple[Array, Array] | None
    if not problem.cyclic:
        curve = fewest_links(gates, breaks)
    elif problem.required.size:
        return _cut(problem, bound, float(problem.required[0]))
    elif least <= most:
        curve = np.zeros(1), np.array([0.5 * (least + most)])
    else:
        curve = fewest_links_around(gates)
    if curve is None:
        return _cut(problem, bound, 0.0)
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


def _cut(problem: Problem, bound: float, place: float) -> tuple[Candidate, int]:
    """A cycle with a knot at a place, as a path from there back to it.

    A path whose ends are free needs no more segments, so that its number bounds that of a cycle;
    one that comes back to where it began takes at most one more.
    """
    gates, breaks = gates_of(problem, bound, place)
    low, high = gates.reachable()
    least, most = max(low[0], low[-1]), min(high[0], high[-1])

    def path(low: float, high: float) -> tuple[Array, Array]:
        lower, upper = [low, *gates.lower[1:-1], low], [high, *gates.upper[1:-1], high]
        return fewest_links(gates._replace(lower=lower, upper=upper), breaks)

    knots, values = path(float(least), float(most))
    fewest = knots.size - 1 - (place not in problem.required)
    first, last = np.clip(values[[0, -1]], least, most)
    starts = [first, last, 0.5 * (first + last), *np.linspace(least, most, 5)[1:-1]]
    cycles = [path(float(value), float(value)) for value in starts]
    knots, values = min(cycles, key=lambda way: (way[0].size, -min(np.min(np.diff(way[0])), 1.0)))
    return candidate(problem, knots[:-1], values[:-1]), fewest


def least_squares_within(problem: Problem, curve: Candidate, bound: float) -> Candidate:
    """A curve of as many segments, within the same bounds, and of no larger squared error.

    The ``curve`` has no error above ``bound``. Each round is one QP with O(n) rows.
    """
    before, after = curve.error, np.ones(curve.knots.size, dtype=bool)
    for turn in range(min(max(MOST_LINES // curve.knots.size, 1), MOST_ROUNDS)):
        moved = _moved(problem, curve, bound, after)
        after = np.where(moved.knots == curve.knots, ~after, moved.knots > curve.knots)
        curve = moved
        if turn % 2:
            if curve.error >= (1.0 - 3e-4) * before:
                break
            before = curve.error
    return curve


class _Lines(NamedTuple):
    """The lines of a curve, the samples that each passes, and where its knots may move."""

    ends: Array  # the knots, and of a cycle the first one a period later, (S + 1,)
    values: Array  # values of the lines at their starts, and then at their ends, (2S,)
    first: Indices  # first sample of each line, of a cycle counted on beyond its end, (S,)
    last: Indices  # last sample of each line
    joints: Indices  # numbers of the knots that join two lines, and of the lines behind, (J,)
    low: Array  # least place of each joint
    high: Array  # largest place of each joint

    def at(self, line: Indices, place: Array) -> Any:
        """The sparse matrix that takes the values to those of lines at places."""
        from scipy import sparse

        share = (place - self.ends[line]) / np.diff(self.ends)[line]
        row, columns = np.tile(np.arange(place.size), 2), np.append(line, self.first.size + line)
        entries = np.append(1.0 - share, share)
        return sparse.csr_matrix((entries, (row, columns)), (place.size, self.values.size))

    def apart(self, place: Array) -> Any:
        """Likewise for the line behind less the line before each joint."""
        turn = np.where(self.joints == 0, self.ends[-1] - self.ends[0], 0.0)
        before = (self.joints - 1) % self.first.size
        return self.at(self.joints, place) - self.at(before, place + turn)


def _moved(problem: Problem, curve: Candidate, bound: float, after: Mask) -> Candidate:
    """The curve with all knots moved within their gaps, or as it is where that is no better.

    Knots on a sample move in the gap after it where ``after`` is true, else in the one before it.
    """
    lines = _lines_of(problem, curve, after)
    if np.any(lines.last < lines.first):  # two knots in one gap
        lines = _lines_of(problem, curve, np.ones_like(after))
    if np.any(lines.last < lines.first):
        return curve
    pins = required_knots(problem, curve.knots)[1]
    values = _best_lines(problem, curve, lines, pins, bound)
    if np.isnan(values[0]):  # the QP was not solved
        return curve
    at_starts, at_ends = np.split(values, 2)
    slopes = (at_ends - at_starts) / np.diff(lines.ends)
    bend = slopes[lines.joints] - slopes[lines.joints - 1]
    gap = -lines.apart(lines.low) @ values
    away = np.divide(gap, bend, out=np.zeros(bend.size), where=bend != 0.0)
    place = np.minimum(np.maximum(lines.low + away, lines.low), lines.high)
    knots = curve.knots.copy()
    heights = at_starts.copy() if problem.cyclic else np.append(at_starts, at_ends[-1])
    knots[lines.joints], heights[lines.joints] = place, lines.at(lines.joints, place) @ values
    moved = candidate(problem, knots, np.where(np.isfinite(pins), curve.values, heights))
    lengths = np.diff(problem.ends(moved.knots))
    rises = np.abs(steps(moved.values, cyclic=problem.cyclic))
    if (
        not moved.error < curve.error
        or np.min(lengths) < SHORTEST
        or np.max(np.abs(residuals(problem, moved.knots, moved.values))) > bound * (1.0 + 5e-10)
        or np.any(rises > problem.step * (1.0 + 5e-13) * lengths)
    ):
        return curve
    return moved


def _lines_of(problem: Problem, curve: Candidate, after: Mask) -> _Lines:
    """The samples dealt out to the lines."""
    n, size = problem.samples, curve.knots.size
    number = np.arange(size + problem.cyclic) % size
    fixed, after = required_knots(problem, curve.knots)[0][number], after[number]
    x, y = problem.ends(curve.knots), curve.values[number]
    whole = np.abs(x - np.rint(x)) <= 1e-6  # [samples], more than the tolerance of the QP
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
    joints = np.arange(not problem.cyclic, x.size - 1)
    first, last = last[:-1].astype(np.intp) + 1, last[1:].astype(np.intp)
    return _Lines(x, np.append(y[:-1], y[1:]), first, last, joints, low[joints], high[joints])


def _best_lines(
    problem: Problem, curve: Candidate, lines: _Lines, pins: Array, bound: float
) -> Array:
    """The values of the best lines that cross where knots may move, (2S,): a QP.

    Its unknowns are changes in units of ``bound``: zero is the curve itself, which meets all
    conditions.
    """
    from scipy import sparse

    size = lines.first.size
    index = np.arange(lines.first[0], lines.last[-1] + 1)
    desired = problem.desired[index % problem.samples]
    passed = lines.at(np.repeat(np.arange(size), lines.last - lines.first + 1), index)
    starts = lines.first - lines.first[0]
    parts = zip(starts, np.split(desired, starts[1:]), strict=True)
    hull = np.concatenate([start + _corners(part) for start, part in parts])
    rises: Any = sparse.eye(size, 2 * size, size) - sparse.eye(size, 2 * size)
    slopes = rises @ lines.values / np.diff(lines.ends)
    convex = np.where(slopes[lines.joints] >= slopes[lines.joints - 1], 1.0, -1.0)
    ordered = [
        sparse.diags(way) @ lines.apart(at)
        for at, way in ((lines.low, -convex), (lines.high, convex))
    ]
    stay = np.flatnonzero(np.isfinite(pins))
    pinned = lines.at(np.minimum(stay, size - 1), curve.knots[stay])
    conditions = sparse.vstack([passed[hull], rises, *ordered, pinned])
    room, steepest = bound * (1.0 - MARGIN), problem.step * (1.0 - MARGIN) * np.diff(lines.ends)
    free = np.full(2 * lines.joints.size, np.inf)
    lower = np.concatenate([desired[hull] - room, -steepest, np.zeros(free.size), pins[stay]])
    upper = np.concatenate([desired[hull] + room, steepest, free, pins[stay]])
    present = conditions @ lines.values
    present[present.size - stay.size :] = pins[stay]
    change, _ = solve_qp(
        # A line through one sample has no slope of its own.
        passed.T @ passed + 1e-9 * sparse.eye(2 * size),
        passed.T @ (passed @ lines.values - desired) / bound,
        conditions,
        np.minimum((lower - present) / bound, 0.0),
        np.maximum((upper - present) / bound, 0.0),
        iterations=2_000,
    )
    return np.asarray(lines.values + bound * change)


def _corners(samples: Array) -> Indices:
    """Numbers of the samples at the corners of their convex hull, which bound a line.

    With all samples as bounds of a QP it may not be solved, as many are active at once.
    """
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
