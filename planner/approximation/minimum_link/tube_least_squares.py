"""Least squares among the curves of so many segments within a largest error: moves of knots.

Two moves take turns, neither of which leaves the bounds or raises the squared error. One takes a
single knot to the best of all samples between its neighbours, with the best value there. The other
takes all knots at once, each within the gap between two samples where it lies: with the samples
dealt out to the segments, the lines themselves are the unknowns of a convex QP, since the largest
error, the bound on the slopes, and that two neighbours cross in the gap between their samples are
linear in them once it is known which of the two is the steeper one. A knot that ends on a sample
moves on the same way in the next round, or the other way if it has not moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.problem import (
    SHORTEST,
    Candidate,
    Problem,
    candidate,
    fixed_variables,
    required_knots,
    residuals,
)
from planner.approximation.qp import QP, ValuesQP, polished, run_osqp
from planner.trajectory import Array, Mask


@dataclass(frozen=True, kw_only=True)
class TubeOptions:
    """How far the knots move.

    Measured on 48 paths and cycles of 60 to 1,500 samples.

    Attributes:
        rounds: Most rounds; 12 and 24: no change, as there is no progress any more.
        progress: Relative decrease of the squared error in two rounds that is worth two more. 1e-3
            and 1e-2: no change.
        lines: Lines in all rounds together from which on there is none after the first, so that the
            time is in proportion to the samples. All rounds for 2,500 segments: 9 % smaller errors
            at best, 2.7 times the time.
        margin: Share of the bounds that is left to OSQP's tolerance. None: rms errors 3 % larger in
            the mean, 78 % at worst; 1e-6: no change.
        first_margin: The same in the first round, a tenth of it in each that follows. 5e-3 and
            2e-2: within 0.01 % in the mean; 1e-7: 0.06 % larger, 2 % at worst.
        ridge: Curvature added to that of a line's rise, in samples, as a line through one sample
            has none. 5e-10 and 2e-9: no change; none: 0.1 % larger at worst.
        rounding: Relative excess over the largest error, and 1e-3 of it over a slope, that counts
            as none.
    """

    rounds: int = 6
    progress: float = 3e-3
    lines: int = 4000
    margin: float = 1e-7
    first_margin: float = 1e-2
    ridge: float = 1e-9
    rounding: float = 5e-10


TUBE = TubeOptions()


class _Lines(NamedTuple):
    """The lines of a curve, the samples that each passes, and where its knots may move.

    Attributes:
        first: First sample of each line, of a cycle counted on beyond its end, shape (S,).
        last: Last sample of each line.
        middle: Middle of these samples.
        half: Half of their extent.
        level: Value of the line in their middle.
        slope: Its slope.
        joints: Numbers of the knots between two lines, shape (J,), as they are in the curve.
        low: Least place of each joint, shape (J,).
        high: Largest place of each joint.
    """

    first: npt.NDArray[np.intp]
    last: npt.NDArray[np.intp]
    middle: Array
    half: Array
    level: Array
    slope: Array
    joints: npt.NDArray[np.intp]
    low: Array
    high: Array

    def at(self, line: npt.NDArray[np.intp], place: Array) -> Array:
        """Values of lines at places."""
        return self.level[line] + self.slope[line] * (place - self.middle[line])


def least_squares_within(problem: Problem, curve: Candidate, bound: float) -> Candidate:
    """A curve with as many segments as ``curve`` and a squared error that is no larger.

    Args:
        problem: What to approximate; samples of size one or less.
        curve: A curve with no error above ``bound``, its slopes within their bound.
        bound: Largest error at any sample.

    Returns:
        The curve, within the same bounds. One QP of OSQP with O(n) rows a round.
    """
    before, after = curve.error, np.ones(curve.knots.size, dtype=bool)
    for turn in range(min(max(TUBE.lines // curve.knots.size, 1), TUBE.rounds)):
        curve = _one_by_one(problem, curve, bound)
        # Hundreds of lines take OSQP long: at first it may be far from the bounds.
        margin = max(TUBE.margin, TUBE.first_margin / 10.0**turn)
        moved = _together(problem, curve, bound, after, margin)
        stays = moved.knots == curve.knots
        after = np.where(stays, ~after, moved.knots > curve.knots)
        curve = moved
        if turn % 2:
            if curve.error >= (1.0 - TUBE.progress) * before:
                break
            before = curve.error
    return curve


def _together(
    problem: Problem, curve: Candidate, bound: float, after: Mask, margin: float
) -> Candidate:
    """The curve with all knots moved within their gaps, or as it is where that is no better.

    Args:
        problem: What to approximate.
        curve: The curve.
        bound: Largest error at any sample.
        after: Which knots, where they are on a sample, move in the gap after it; see `_lines_of`.
        margin: Share of the bounds that is left to OSQP's tolerance.
    """
    lines = _lines_of(problem, curve, after)
    if np.any(lines.last < lines.first):
        return curve
    qp = _line_qp(problem, curve, lines, bound, margin)
    result = run_osqp(qp, iterations=QP.tube_iterations)
    change = np.asarray(result.x, dtype=np.float64)
    if not np.all(np.isfinite(change)):
        return curve
    change = bound * polished(qp, change, np.asarray(result.y, dtype=np.float64))
    level, rise = np.split(change, 2)
    lines = lines._replace(level=lines.level + level, slope=lines.slope + rise / lines.half)
    moved = candidate(problem, *_joined(problem, curve, lines))
    if not moved.error < curve.error or not problem.long_enough(moved.knots):
        return curve
    values = np.append(moved.values, moved.values[0]) if problem.cyclic else moved.values
    steepest = problem.step * (1.0 + 1e-3 * TUBE.rounding) * np.diff(problem.ends(moved.knots))
    largest = np.max(np.abs(residuals(problem, moved.knots, moved.values)))
    if largest > bound * (1.0 + TUBE.rounding) or np.any(np.abs(np.diff(values)) > steepest):
        return curve
    return moved


def _lines_of(problem: Problem, curve: Candidate, after: Mask) -> _Lines:
    """The samples dealt out to the lines.

    Args:
        problem: What to approximate.
        curve: The curve.
        after: Which knots, where they are on a sample, move in the gap after it, shape (K,); the
            others move in that before it.
    """
    n, size = problem.samples, curve.knots.size
    number = np.arange(size + problem.cyclic) % size
    fixed, after = fixed_variables(problem, curve.knots)[0][number], after[number]
    x = problem.ends(curve.knots)
    y = curve.values[number]
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
        joints = np.arange(size)
    else:
        last[0], last[-1] = -1.0, n - 1.0
        joints = np.arange(1, size - 1)
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
        joints=joints,
        low=low[joints],
        high=high[joints],
    )


def _line_qp(
    problem: Problem, curve: Candidate, lines: _Lines, bound: float, margin: float
) -> ValuesQP:
    """The QP in the lines.

    The unknowns are changes of level and of rise over half a line's samples, in units of ``bound``,
    so that zero is the curve itself, which meets all conditions.
    """
    from scipy import sparse

    size = lines.level.size
    index = np.arange(lines.first[0], lines.last[-1] + 1)
    line = np.repeat(np.arange(size), lines.last - lines.first + 1)
    share = (index - lines.middle[line]) / lines.half[line]
    missing = (problem.desired[index % problem.samples] - lines.at(line, index)) / bound
    s0, s1, s2, d0, d1 = (
        np.bincount(line, product, minlength=size)
        for product in (np.ones(index.size), share, share * share, missing, missing * share)
    )
    scale = float(np.max(s0))
    P: Any = sparse.bmat(
        [[sparse.diags(s0), sparse.diags(s1)], [sparse.diags(s1), sparse.diags(s2 + TUBE.ridge)]],
        "csc",
    )

    def values(which: npt.NDArray[np.intp], at: Array) -> Any:
        """Rows that give the change of a line's value at a place."""
        along = (at - lines.middle[which]) / lines.half[which]
        entries = np.append(np.ones(at.size), along)
        row = np.tile(np.arange(at.size), 2)
        columns = np.append(which, size + which)
        return sparse.csc_matrix((entries, (row, columns)), shape=(at.size, 2 * size))

    hull = np.concatenate(
        [
            first + _corners(problem.desired[np.arange(first, last + 1) % problem.samples])
            for first, last in zip(lines.first, lines.last, strict=True)
        ]
    )
    hull -= lines.first[0]
    rows = [values(line[hull], index[hull]), sparse.eye(2 * size, format="csc")[size:]]
    room = 1.0 - margin
    lower = [missing[hull] - room, (-problem.step * room - lines.slope) * lines.half / bound]
    upper = [missing[hull] + room, (problem.step * room - lines.slope) * lines.half / bound]
    before, behind, turn = _beside(problem, lines)
    convex = np.where(lines.slope[behind] >= lines.slope[before], 1.0, -1.0)
    for at, way in ((lines.low, -convex), (lines.high, convex)):
        rows.append(sparse.diags(way) @ (values(behind, at) - values(before, at + turn)))
        lower.append(-way * (lines.at(behind, at) - lines.at(before, at + turn)) / bound)
        upper.append(np.full(at.size, np.inf))
    stay = np.flatnonzero(fixed_variables(problem, curve.knots)[1])
    rows.append(values(np.minimum(stay, size - 1), curve.knots[stay]))
    lower.append(np.zeros(stay.size))
    upper.append(np.zeros(stay.size))
    return ValuesQP(
        P=P / scale,
        q=-np.append(d0, d1) / scale,
        A=sparse.vstack(rows, format="csc"),
        lower=np.minimum(np.concatenate(lower), 0.0),
        upper=np.maximum(np.concatenate(upper), 0.0),
    )


def _beside(problem: Problem, lines: _Lines) -> tuple[Any, Any, Array]:
    """Numbers of the lines before and behind each joint, and how much later the first is."""
    before, behind = lines.joints - 1, lines.joints
    turn = np.where(before < 0, float(problem.samples), 0.0)
    return before % lines.level.size, behind, turn


def _joined(problem: Problem, curve: Candidate, lines: _Lines) -> tuple[Array, Array]:
    """Knots where the lines cross, and values there."""
    knots, values = curve.knots.copy(), curve.values.copy()
    before, behind, turn = _beside(problem, lines)
    apart = lines.at(before, lines.low + turn) - lines.at(behind, lines.low)
    bend = lines.slope[behind] - lines.slope[before]
    away = np.divide(apart, bend, out=np.zeros(bend.size), where=bend != 0.0)
    place = np.minimum(np.maximum(lines.low + away, lines.low), lines.high)
    knots[lines.joints], values[lines.joints] = place, lines.at(behind, place)
    if not problem.cyclic:
        ends, at = np.array([0, -1]), np.array([0, lines.level.size - 1])
        values[ends] = lines.at(at, knots[ends])
    pinned = fixed_variables(problem, knots)[1]
    return knots, np.where(pinned, curve.values, values)


def _one_by_one(problem: Problem, curve: Candidate, bound: float) -> Candidate:
    """Move one knot after the other to the best sample between its neighbours, which stay.

    The squared error of the two lines that meet there is quadratic in the value, its coefficients
    sums over the samples before and after, and what the bounds allow is an interval.
    """
    knots, values = curve.knots.copy(), curve.values.copy()
    steepest, room = problem.step * (1.0 - TUBE.margin), bound * (1.0 - TUBE.margin)
    for k in np.flatnonzero(~required_knots(problem, knots)[0]):
        number = np.arange(k - 1, k + 2)
        x = knots[number % knots.size] + problem.samples * (number // knots.size)
        y = values[number % knots.size]
        places = np.arange(np.floor(x[0]) + 1.0, np.ceil(x[2]))
        index = places.astype(np.intp) % problem.samples
        desired = problem.desired[index]
        to_left, to_right = places - x[0], x[2] - places
        left = _lines_from(to_left, desired - y[0], room)
        right = _lines_from(to_right[::-1], (desired - y[2])[::-1], room)
        right = np.append(right[:, -2::-1], [[-np.inf], [np.inf], [0.0], [0.0], [0.0]], axis=1)
        lowest, highest = (
            np.maximum(
                y[0] + np.maximum(left[0], -steepest) * to_left,
                y[2] + np.maximum(right[0], -steepest) * to_right,
            ),
            np.minimum(
                y[0] + np.minimum(left[1], steepest) * to_left,
                y[2] + np.minimum(right[1], steepest) * to_right,
            ),
        )
        curvature = left[4] / to_left**2 + right[4] / to_right**2
        linear = left[4] / to_left**2 * y[0] + right[4] / to_right**2 * y[2]
        linear += left[3] / to_left + right[3] / to_right
        value = np.clip(linear / np.maximum(curvature, 1e-300), lowest, highest)
        cost = np.zeros(places.size)
        for side, rise in ((left, (value - y[0]) / to_left), (right, (value - y[2]) / to_right)):
            cost += side[2] - 2.0 * side[3] * rise + side[4] * rise**2
        near = np.minimum(to_left, to_right) < SHORTEST
        cost[near | (lowest > highest)] = np.inf
        own = np.interp(places, x, y) - desired
        best = int(np.argmin(cost))
        if cost[best] < float(own @ own):
            knots[k], values[k] = places[best], value[best]
    moved = candidate(problem, knots, values)
    return moved if moved.error < curve.error else curve


def _lines_from(run: Array, rise: Array, room: float) -> Array:
    """Least and largest slope, Σ rise², Σ run rise and Σ run² by sample, shape (5, samples).

    Of lines from a point at a distance of ``run`` and ``rise`` that pass all samples up to each.
    """
    sums = np.cumsum([rise * rise, run * rise, run * run], axis=1)
    least = np.maximum.accumulate((rise - room) / run)
    return np.vstack([least, np.minimum.accumulate((rise + room) / run), sums])


def _corners(samples: Array) -> npt.NDArray[np.intp]:
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
