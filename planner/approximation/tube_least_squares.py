"""Least squares among the curves of so many segments within a largest error: moves of knots.

Two moves take turns, neither of which leaves the bounds or raises the squared error. One takes a
single knot to the best of all samples between its neighbours, with the best value there. The other
takes many knots at once, each within the gap between two samples where it lies: with the samples
dealt out to the segments, the lines themselves are the unknowns of a convex QP, since the largest
error, the bound on the slopes, and that two neighbours cross in the gap between their samples are
linear in them once it is known which of the two is the steeper one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.problem import (
    BARELY_SHORT,
    Candidate,
    Problem,
    candidate,
    fixed_variables,
    required_knots,
)
from planner.approximation.qp import ValuesQP, polished, run_osqp
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class TubeOptions:
    """How far the moves go.

    What half and twice of a value change was measured on 35 paths and 15 cycles of 100 to 3000
    samples: the rms error in the mean, and at worst.

    Attributes:
        rounds: Most rounds of both moves; 3: +0.2 and +1.7 %, two thirds of the time; 12: -0.1 %.
        progress: Relative decrease of the squared error in two rounds that is worth another one.
        lines: Lines in all rounds together from which on there is none after the first, so that the
            time is in proportion to the samples; 2000: +0.03 and +1.3 %; 8000: -0.01 %.
        window: Lines that one QP moves at once; 50: +0.02 and +5.6 %; 200: +0.05 and +2.0 %.
        batch: Samples that are summed at once, a matter of memory.
        margin: Share of the bounds that the QP leaves to its own tolerance; no effect.
        iterations: OSQP's iterations; what it has then is taken if it is within the bounds; no
            effect.
    """

    rounds: int = 6
    progress: float = 1e-3
    lines: int = 4000
    window: int = 100
    batch: int = 200_000
    margin: float = 1e-7
    iterations: int = 4000


OPTIONS = TubeOptions()

TUBE_ROUNDING = 5e-10
"""Relative excess over the largest error, and 1e-3 of it over a slope, that counts as none."""


def least_squares_within(
    problem: Problem, curve: Candidate, bound: float, options: TubeOptions = OPTIONS
) -> Candidate:
    """A curve with as many segments as ``curve`` and a squared error that moves of knots lower.

    Args:
        problem: What to approximate; samples of size one or less.
        curve: A curve with no error above ``bound``, its slopes within their bound.
        bound: Largest error at any sample.
        options: How far to go.

    Returns:
        The curve, within the same bounds. O(n) a round.
    """
    rounds = min(max(options.lines // curve.knots.size, 1), options.rounds)
    for turn in range(rounds):
        before = curve.error
        curve = _one_by_one(problem, curve, bound, options)
        offset = turn * (options.window // 2 + 1)
        curve = _together(problem, curve, bound, offset, after=bool(turn % 2), options=options)
        if turn % 2 and curve.error >= (1.0 - options.progress) * before:
            break
    return curve


# One knot at a time


class _Reach(NamedTuple):
    """Lines from a point, by the samples that they have passed, each shape (knots, samples)."""

    least: Array  # slope
    most: Array
    s0: Array  # sums of w r², w t r and w t² with the samples' distances t and r from the point
    s1: Array
    s2: Array


def _one_by_one(
    problem: Problem, curve: Candidate, bound: float, options: TubeOptions
) -> Candidate:
    """Move knots to their best samples and values between their neighbours, every other at once."""
    n, size = problem.samples, curve.knots.size
    knots, values = curve.knots.copy(), curve.values.copy()
    movable = ~np.logical_or(*required_knots(problem, knots))
    if size < 3:
        return curve
    turns = [np.arange(0, size - 1, 2), np.arange(1, size, 2)]
    if size % 2:
        turns.append(np.array([size - 1]))  # next to the first one in a cycle
    for turn in turns:
        which = turn[movable[turn]]
        number = which[:, np.newaxis] + np.arange(-1, 2)
        spans = knots[number % size] + n * (number // size)
        which = which[np.argsort(spans[:, 2] - spans[:, 0], kind="stable")]
        while which.size:
            number = which[:, np.newaxis] + np.arange(-1, 2)
            x = knots[number % size] + n * (number // size)
            widths = np.maximum.accumulate(np.ceil(x[:, 2] - x[:, 0]))
            fit = max(int(np.sum(widths * np.arange(1, which.size + 1) <= options.batch)), 1)
            y = values[number % size]
            place, value = _best_places(problem, x[:fit], y[:fit], bound, options)
            knots[which[:fit]], values[which[:fit]] = place, value
            which = which[fit:]
    return candidate(problem, knots, values)


def _best_places(
    problem: Problem, x: Array, y: Array, bound: float, options: TubeOptions
) -> tuple[Array, Array]:
    """Where knots are best, and their values, with their neighbours held; those in x[:, 1] if none.

    The squared error of the two lines is quadratic in the value, its coefficients sums over the
    samples before and after, and what the bounds allow is an interval for every place.

    Args:
        problem: What to approximate.
        x: Neighbour before, knot and neighbour after, shape (knots, 3).
        y: Values there.
        bound: Largest error at any sample.
        options: Room left to rounding.
    """
    first, last = np.floor(x[:, :1]) + 1.0, np.ceil(x[:, 2:]) - 1.0
    places = first + np.arange(int(np.max(last - first)) + 1)
    inside = places <= last
    index = places.astype(np.intp) % problem.samples
    weights, desired = np.where(inside, problem.weights[index], 0.0), problem.desired[index]
    room = np.where(inside, bound * (1.0 - options.margin), np.inf)
    steepest = problem.step * (1.0 - options.margin)
    a, b = places - x[:, :1], np.where(inside, x[:, 2:] - places, 1.0)
    left = _reach(a, desired - y[:, :1], weights, room)
    right = _reach(b[:, ::-1], (desired - y[:, 2:])[:, ::-1], weights[:, ::-1], room[:, ::-1])
    behind = [np.roll(side[:, ::-1], -1, axis=1) for side in right]  # of samples after the place
    for side, none in zip(behind, (-np.inf, np.inf, 0.0, 0.0, 0.0), strict=True):
        side[:, -1] = none
    right = _Reach(*behind)
    lowest = np.maximum(
        y[:, :1] + np.maximum(left.least, -steepest) * a,
        y[:, 2:] + np.maximum(right.least, -steepest) * b,
    )
    highest = np.minimum(
        y[:, :1] + np.minimum(left.most, steepest) * a,
        y[:, 2:] + np.minimum(right.most, steepest) * b,
    )
    by_left, by_right = left.s2 / a**2, right.s2 / b**2
    linear = by_left * y[:, :1] + by_right * y[:, 2:] + left.s1 / a + right.s1 / b
    curvature = np.maximum(by_left + by_right, 1e-300)
    value = np.minimum(np.maximum(linear / curvature, lowest), highest)
    rise, fall = (value - y[:, :1]) / a, (value - y[:, 2:]) / b
    cost = left.s2 * rise**2 - 2.0 * left.s1 * rise + left.s0
    cost += right.s2 * fall**2 - 2.0 * right.s1 * fall + right.s0
    far = (a < problem.shortest - BARELY_SHORT) | (b < problem.shortest - BARELY_SHORT)
    cost[far | ~inside | (lowest > highest)] = np.inf
    row = np.arange(x.shape[0])
    best = np.argmin(cost, axis=1)
    before = (y[:, 1:2] - y[:, :1]) / (x[:, 1:2] - x[:, :1])
    after = (y[:, 2:] - y[:, 1:2]) / (x[:, 2:] - x[:, 1:2])
    own = np.where(places <= x[:, 1:2], y[:, :1] + before * a, y[:, 2:] - after * b)
    now = np.sum(weights * (own - desired) ** 2, axis=1)
    better = cost[row, best] < (1.0 - 1e-9) * now
    return (
        np.where(better, places[row, best], x[:, 1]),
        np.where(better, value[row, best], y[:, 1]),
    )


def _reach(run: Array, rise: Array, weights: Array, room: Array) -> _Reach:
    """Slopes and sums along the samples, each counted with those before it."""
    return _Reach(
        np.maximum.accumulate((rise - room) / run, axis=1),
        np.minimum.accumulate((rise + room) / run, axis=1),
        *(np.cumsum(weights * product, axis=1) for product in (rise * rise, run * rise, run * run)),
    )


# Many knots at once


class _Window(NamedTuple):
    """Successive segments whose lines are sought.

    Attributes:
        x: Knots, of a cycle counted on beyond its end, shape (m + 1,).
        y: Values there.
        low: Least place of each knot, in the gap where it lies, shape (m + 1,).
        high: Largest place of each knot.
        stays: Which of the values stay, shape (m + 1,).
    """

    x: Array
    y: Array
    low: Array
    high: Array
    stays: npt.NDArray[np.bool_]


class _Deal(NamedTuple):
    """Which samples a line passes, and its variables: value in their middle, rise over half."""

    first: npt.NDArray[np.intp]
    last: npt.NDArray[np.intp]
    middle: Array
    half: Array
    level: Array  # the curve's own line
    slope: Array


def _together(
    problem: Problem,
    curve: Candidate,
    bound: float,
    offset: int,
    *,
    after: bool,
    options: TubeOptions,
) -> Candidate:
    """Move the knots of one window after the other, each between knots that stay.

    Args:
        problem: What to approximate.
        curve: The curve.
        bound: Largest error at any sample.
        offset: Number of the knot at which the first window begins.
        after: Whether a knot on a sample moves in the gap after it; else in that before it.
        options: Size of a window, and OSQP's settings.
    """
    n, size = problem.samples, curve.knots.size
    knots, values = curve.knots.copy(), curve.values.copy()
    fixed, pinned = fixed_variables(problem, knots)
    segments = size if problem.cyclic else size - 1
    if problem.cyclic:
        offset = offset % size
        starts = range(offset, offset + size, options.window)
    else:
        starts = range(-(offset % options.window), segments, options.window)
    for start in starts:
        end = start + options.window
        if problem.cyclic:
            end = min(end, offset + size)
        else:
            start, end = max(start, 0), min(end, segments)
        if end <= start:
            continue
        number = np.arange(start, end + 1)
        turn = n * (number // size if problem.cyclic else np.zeros(number.size, dtype=np.intp))
        x, y = knots[number % size] + turn, values[number % size]
        whole = np.abs(x - np.rint(x)) <= BARELY_SHORT
        x = np.where(whole & ~fixed[number % size], np.rint(x), x)
        low = np.where(whole, np.rint(x) - (not after), np.floor(x))
        high = low + 1.0
        spare = np.maximum(np.diff(x) - problem.shortest, 0.0)
        tight = low[1:] - high[:-1] < problem.shortest
        high[:-1] = np.where(tight, np.minimum(high[:-1], x[:-1] + 0.5 * spare), high[:-1])
        low[1:] = np.where(tight, np.maximum(low[1:], x[1:] - 0.5 * spare), low[1:])
        stays = fixed[number % size] | pinned[number % size]
        stays[[0, -1]] = True
        low[stays] = high[stays] = x[stays]
        values_stay = pinned[number % size].copy()
        values_stay[0] |= problem.cyclic or start > 0
        values_stay[-1] |= problem.cyclic or end < segments
        window = _Window(x, y, low, high, values_stay)
        moved = _moved(problem, window, bound, after, options)
        if moved is not None:
            knots[number % size], values[number % size] = moved[0] - turn, moved[1]
    return candidate(problem, knots, values)


def _moved(
    problem: Problem, window: _Window, bound: float, after: bool, options: TubeOptions
) -> tuple[Array, Array] | None:
    """The best knots and values of a window; None if they are no better."""
    deal = _dealt(window, after)
    if deal is None:
        return None
    lines = _solved(problem, window, deal, bound, options)
    if lines is None:
        return None
    x, y = _joined(window, deal, *lines)
    if np.any(np.diff(x) < problem.shortest - BARELY_SHORT):
        return None
    index = np.arange(deal.first[0], deal.last[-1] + 1)
    desired, weights = (row[index % problem.samples] for row in (problem.desired, problem.weights))
    before = np.interp(index, window.x, window.y) - desired
    now = np.interp(index, x, y) - desired
    if not np.sum(weights * now**2) < np.sum(weights * before**2):
        return None
    steepest = problem.step * (1.0 + 1e-3 * TUBE_ROUNDING)
    if np.max(np.abs(now)) > bound * (1.0 + TUBE_ROUNDING) or np.any(
        np.abs(np.diff(y)) > steepest * np.diff(x)
    ):
        return None
    return x, y


def _dealt(window: _Window, after: bool) -> _Deal | None:
    """The samples dealt out to the lines; None if one gets none."""
    x, y = window.x, window.y
    last = np.where(
        window.low < window.high, window.low, np.ceil(x) - 1.0 + after * (x == np.rint(x))
    )
    last[-1] = np.floor(x[-1])
    first = last[:-1] + 1.0
    first[0] = np.ceil(x[0])
    last = last[1:]
    if np.any(last < first):
        return None
    middle, half = 0.5 * (first + last), np.maximum(0.5 * (last - first), 0.5)
    slope = np.diff(y) / np.diff(x)
    level = y[:-1] + slope * (middle - x[:-1])
    return _Deal(first.astype(np.intp), last.astype(np.intp), middle, half, level, slope)


def _solved(
    problem: Problem, window: _Window, deal: _Deal, bound: float, options: TubeOptions
) -> tuple[Array, Array] | None:
    """Levels and slopes of the best lines; None if OSQP finds none."""
    qp = _line_qp(problem, window, deal, bound, 1.0 - options.margin)
    size = deal.level.size
    result = run_osqp(qp, iterations=options.iterations)
    change = np.asarray(result.x, dtype=np.float64)
    if not np.all(np.isfinite(change)):
        return None
    change = polished(qp, change, np.asarray(result.y, dtype=np.float64))
    return deal.level + bound * change[:size], deal.slope + bound * change[size:] / deal.half


def _line_qp(problem: Problem, window: _Window, deal: _Deal, bound: float, room: float) -> ValuesQP:
    """The QP in the lines of a window.

    The unknowns are changes of level and of rise over half a line's samples, in units of ``bound``,
    so that zero is the curve itself. It meets all conditions: where it has less room than the
    margin, the margin gives way.
    """
    from scipy import sparse

    size = deal.level.size
    index = np.arange(deal.first[0], deal.last[-1] + 1)
    line = np.repeat(np.arange(size), deal.last - deal.first + 1)
    share = (index - deal.middle[line]) / deal.half[line]
    weights = problem.weights[index % problem.samples]
    own = deal.level[line] + deal.slope[line] * (index - deal.middle[line])
    missing = (problem.desired[index % problem.samples] - own) / bound
    totals = [
        np.bincount(line, weights * product, minlength=size)
        for product in (1.0 + 0.0 * share, share, share * share, missing, missing * share)
    ]
    level, rise = np.arange(size), size + np.arange(size)
    P = sparse.csc_matrix(
        (
            np.concatenate([totals[0], totals[1], totals[1], totals[2] + 1e-9]),
            (
                np.concatenate([level, level, rise, rise]),
                np.concatenate([level, rise, level, rise]),
            ),
        ),
        shape=(2 * size, 2 * size),
    )
    scale = float(np.max(totals[0]))
    q = -np.concatenate(totals[3:]) / scale

    def values(at: Array, which: npt.NDArray[np.intp]) -> Any:
        """Rows that give the change of a line's value at a place."""
        row = np.arange(at.size)
        along = (at - deal.middle[which]) / deal.half[which]
        entries = (
            np.append(np.ones(at.size), along),
            (
                np.append(row, row),
                np.append(level[which], rise[which]),
            ),
        )
        return sparse.csc_matrix(entries, shape=(at.size, 2 * size))

    def here(at: Array, which: npt.NDArray[np.intp]) -> Array:
        """The curve's own line there."""
        return np.asarray(deal.level[which] + deal.slope[which] * (at - deal.middle[which]))

    kept = _corners(problem.desired[index % problem.samples], deal)
    rows = [values(index[kept].astype(np.float64), line[kept])]
    lower, upper = [missing[kept] - room], [missing[kept] + room]
    reach, now = problem.step * room, deal.slope
    rows.append(sparse.eye(2 * size, format="csc")[size:])
    lower.append((-reach - now) * deal.half / bound)
    upper.append((reach - now) * deal.half / bound)
    before, behind = np.arange(size - 1), np.arange(1, size)
    convex = np.where(np.diff(deal.slope) >= 0.0, 1.0, -1.0)
    for at, way in ((window.low[1:-1], -convex), (window.high[1:-1], convex)):
        turn = sparse.diags(way)
        rows.append(turn @ (values(at, behind) - values(at, before)))
        lower.append(-way * (here(at, behind) - here(at, before)) / bound)
        upper.append(np.full(size - 1, np.inf))
    stay = np.flatnonzero(window.stays)
    rows.append(values(window.x[stay], np.maximum(stay - 1, 0)))
    lower.append(np.zeros(stay.size))
    upper.append(np.zeros(stay.size))
    A = sparse.vstack(rows, format="csc")
    return ValuesQP(
        P=P / scale,
        q=q,
        A=A,
        lower=np.minimum(np.concatenate(lower), 0.0),
        upper=np.maximum(np.concatenate(upper), 0.0),
    )


def _joined(window: _Window, deal: _Deal, level: Array, slope: Array) -> tuple[Array, Array]:
    """Knots where the lines cross, and values there."""
    x, y = window.x.copy(), window.y.copy()
    at = window.low[1:-1]
    one = level[:-1] + slope[:-1] * (at - deal.middle[:-1])
    other = level[1:] + slope[1:] * (at - deal.middle[1:])
    turn = np.diff(slope)
    away = np.divide(one - other, turn, out=np.zeros(turn.size), where=turn != 0.0)
    x[1:-1] = np.minimum(np.maximum(at + away, at), window.high[1:-1])
    met = level[:-1] + slope[:-1] * (x[1:-1] - deal.middle[:-1])
    y[1:-1] = np.where(window.stays[1:-1], y[1:-1], met)
    if not window.stays[0]:
        y[0] = level[0] + slope[0] * (x[0] - deal.middle[0])
    if not window.stays[-1]:
        y[-1] = level[-1] + slope[-1] * (x[-1] - deal.middle[-1])
    return x, y


def _corners(desired: Array, deal: _Deal) -> npt.NDArray[np.intp]:
    """Samples that bound a line within the largest error: the corners of their convex hulls."""
    start = deal.first[0]
    kept: set[int] = set()
    for first, last in zip(
        (deal.first - start).tolist(), (deal.last - start).tolist(), strict=True
    ):
        samples = desired[first : last + 1]
        for ends in (samples.tolist(), (-samples).tolist()):
            hull: list[int] = []
            for k, end in enumerate(ends):
                while len(hull) >= 2:
                    i, j = hull[-2:]
                    if (ends[j] - ends[i]) * (k - j) > (end - ends[j]) * (j - i):
                        break
                    hull.pop()
                hull.append(k)
            kept.update(first + k for k in hull)
    return np.array(sorted(kept), dtype=np.intp)
