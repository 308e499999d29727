"""The search for knots: chains on grids, bottom-up merging, descents, and moves of single knots.

Cheapest chains of chords of the ideal (Bellman, On the approximation of curves by line segments
using dynamic programming, 1961; (5a) of docs/math.md) and merged samples are starts of descents.
The squared error has a kink wherever a knot meets a sample, so the knots of the best two curves are
moved across samples, one at a time. Nothing is proved here.
"""

from __future__ import annotations

import math
from functools import cache, cached_property
from heapq import heapify, heappop, heappush

import numpy as np

from planner.approximation.fit_problem import (
    SHORTEST,
    Candidate,
    Problem,
    even_knots,
    nearest_samples,
    required_knots,
    residuals,
    segment_capacity,
    with_required,
)
from planner.approximation.largest_error import minimum_link
from planner.approximation.values import WINDOW, best_values, descend, ideal_of
from planner.arrays import Array

# The effects of half and twice were measured on 640 fits of 2 to 12 segments, and 80 of 14 to 40;
# without moves errors of 100 fits are 2 % larger in the mean, without merging 1.8 %.

FEW = 3  # evaluations after which starts and moves are compared; 4: 0.02 % less error in the mean
MANY = 8  # most evaluations of the descent of a curve that was chosen

PROPOSED = 32
"""Segments up to which knots are sought by chains; beyond, by merging. 16: 0.7 % more error in the
mean, 27 % at worst, in half the time; 64: 0.1 % more in the same time."""

ANCHORS = 8
"""Places of a cycle at which chains begin and end, its sharpest corner among them. 4: 0.03 % more
error in the mean, 3 % at worst."""

RESOLUTION = 2.0**-36
"""Samples are searched as multiples of this, and the largest slope as one of this share of it."""

EQUAL = 1e-9
"""Relative difference up to which two numbers count as equal where the larger one decides, so that
rounding, which differs between processors, does not."""


class KnotSearch:
    """Curves of any number of segments through the same samples, each computed once.

    The samples are searched in a canonical form, so that shifted, mirrored, reversed and scaled
    ones give the same curve, and rounded, so that of equally close curves, such as those of a sine,
    the last digits, which differ between processors, do not choose.
    """

    def __init__(self, problem: Problem) -> None:
        """Find the ideal and the canonical form of a problem whose samples span two units."""
        mantissa, exponent = math.frexp(problem.step)
        coarse = problem._replace(
            desired=np.round(problem.desired / RESOLUTION) * RESOLUTION,
            step=math.ldexp(math.floor(mantissa / RESOLUTION) * RESOLUTION, exponent),
        )
        ideal = ideal_of(coarse)
        self._first, self._way = canonical_order(coarse, ideal)
        self._order = (self._first + self._way * np.arange(problem.samples)) % problem.samples
        self.problem, self.unrounded = self._canonical(coarse), self._canonical(problem)
        self.smooth = self.problem._replace(desired=ideal[self._order])
        most = segment_capacity(self.problem)[1]  # between required knots
        self.fewest = max(2 if problem.cyclic else 1, most.size)
        self.most = int(np.sum(most))
        self.ideal_error = float(np.sum((self.smooth.desired - self.problem.desired) ** 2))
        self.exact = exact_curve(self.unrounded, self.ideal_error)
        self.curve = cache(self._curve)
        self.starts = cache(self._begin)

    def _canonical(self, problem: Problem) -> Problem:
        places = self._way * (problem.required - self._first)
        required, pins = in_order(problem, places, problem.pins)
        return problem._replace(desired=problem.desired[self._order], required=required, pins=pins)

    def restored(self, curve: Candidate) -> Candidate:
        """The curve through the samples as they were given, knots in order and within the cycle."""
        knots = self._first + self._way * curve.knots
        return Candidate(*in_order(self.problem, knots, curve.values), curve.error)

    @cached_property
    def ranked(self) -> Array:
        """Knots on samples, the best first."""
        return ranked_knots(self.smooth)

    def _curve(self, segments: int) -> Candidate:
        """The best curve found with this number of segments."""
        problem = self.problem
        if self.exact is not None and segments == problem.segments(self.exact.knots):
            return self.exact
        starts = self.starts(segments)
        best = starts[0]
        if best.knots.size > WINDOW or best.error <= 1e-22 * problem.samples:
            return best
        if best.error > 1.00001 * self.ideal_error:  # else nothing is left to gain
            begun = [descend(problem, each, rounds=MANY, progress=1e-2) for each in starts[:3]]
            best = improved(problem, sorted(begun, key=by_error)[:2])
        return descend(problem, best, rounds=MANY)

    def _begin(self, segments: int) -> list[Candidate]:
        """Curves a few evaluations from the proposals, the best first."""
        problem = self.problem
        count = segments if problem.cyclic else segments + 1
        merged = with_required(problem, np.sort(self.ranked[:count]))
        chains = (
            [] if segments > PROPOSED else proposed_knots(problem, self.smooth.desired, segments)
        )
        proposals = [*chains, *([] if merged is None else [merged]), even_knots(problem, segments)]
        starts = [best_values(problem, knots) for knots in proposals]
        if proposals[0].size <= WINDOW:
            rough = [descend(problem, start, rounds=FEW, progress=1e-2) for start in starts]
            return sorted(rough, key=by_error)
        best = descend(problem, min(starts, key=by_error), rounds=5)
        return [best_values(problem, best.knots)]


def canonical_order(problem: Problem, ideal: Array) -> tuple[int, int]:
    """The sample that comes first, and -1 where time runs backwards, else 1.

    The sharpest corner of a cycle comes first, the larger half last. Sharp is where the ideal
    bends; of many turns at top speed, where the samples do.
    """
    n, cyclic, first = problem.samples, problem.cyclic, 0
    if cyclic:
        reach = max(1, n // 32)
        bend, own_bend = (
            np.abs(np.roll(curve, -reach) - 2.0 * curve + np.roll(curve, reach))
            for curve in (ideal, problem.desired)
        )
        sharpness = bend + 1e-3 * own_bend
        first = int(np.argmax(sharpness >= (1.0 - EQUAL) * np.max(sharpness)))
    rolled, k = np.roll(problem.desired, -first), np.arange(n)
    # Odd under reversal: sample k goes to -k in a cycle, to n - 1 - k otherwise. A sine instead
    # gives zero for samples whose second half is the first one mirrored.
    side = np.where(k > 0, 0.5 * n - k, 0.0) if cyclic else 0.5 * (n - 1) - k
    power = (rolled - np.mean(rolled)) ** 2
    if side @ power > EQUAL * (np.abs(side) @ power):
        return first if cyclic else n - 1, -1
    return first, 1


def in_order(problem: Problem, places: Array, values: Array) -> tuple[Array, Array]:
    """Places [samples], within the cycle if there is one, and their values, in order."""
    places = np.mod(places, problem.samples) if problem.cyclic else places
    order = np.argsort(places)
    return places[order], values[order]


def by_error(curve: Candidate) -> float:
    """The squared error to nine digits, so that rounding decides nothing: the first one counts."""
    return float(f"{curve.error:.8e}")


def improved(problem: Problem, curves: list[Candidate]) -> Candidate:
    """A curve reached from the best by moving single knots, each followed by a descent."""
    best, bases = curves[0], curves
    for _ in range(3):  # one: 0.05 % more error in the mean; six: 0.003 % less
        starts = [each for curve in bases for each in (curve, *moved(problem, curve))]
        result = min((descend(problem, each, rounds=FEW) for each in starts), key=by_error)
        gain = best.error - result.error
        if gain <= 0.0:
            break
        best, bases = result, [result]
        if gain <= 1e-3 * best.error:
            break
    return best


def moved(problem: Problem, curve: Candidate) -> list[Candidate]:
    """Curves with one knot elsewhere on the curve; their errors are not yet computed."""
    n, own, ends = problem.samples, curve.knots, problem.ends(curve.knots)
    period = n if problem.cyclic else None
    index = np.arange(n) if period is None else own[0] + np.mod(np.arange(n) - own[0], n)
    segment = np.clip(np.searchsorted(own, index, side="right") - 1, 0, ends.size - 2)
    errors = np.bincount(segment, residuals(problem, own, curve.values) ** 2, ends.size - 1)
    worst = np.argmax(np.where(np.diff(ends) >= 2.0 * SHORTEST, errors, -1.0))
    movable = np.flatnonzero(~required_knots(problem, own)[0])
    # Without half a sample 0.3 % more of the fits are worse by 0.1 %.
    moves = np.array([-0.5, 0.5, -1.0, 1.0, -2.0, 2.0, -5.0, 5.0, np.nan])
    places = own[movable, np.newaxis] + moves
    places[:, -1] = 0.5 * (ends[worst] + ends[worst + 1])
    knots = np.tile(own, (places.size, 1))
    knots[np.arange(places.size), np.repeat(movable, places.shape[1])] = places.ravel()
    knots.sort(axis=1)
    values = np.interp(knots, own, curve.values, period=period)
    last = knots[:, :1] + n if problem.cyclic else np.empty((len(knots), 0))
    allowed = np.min(np.diff(np.hstack([knots, last]), axis=1), axis=1) >= SHORTEST
    if not problem.cyclic:
        allowed &= (knots[:, 0] == own[0]) & (knots[:, -1] == own[-1])
    pairs = zip(knots[allowed], values[allowed], strict=True)
    return [Candidate(*pair, curve.error) for pair in pairs]


def exact_curve(problem: Problem, ideal_error: float) -> Candidate | None:
    """The curve that samples of size one lie on, if it keeps the slopes and has few segments."""
    n = problem.samples
    bent = np.count_nonzero(np.abs(np.diff(problem.desired, n=2)) > 1e-10)
    if problem.required.size or ideal_error > 1e-20 * n or 3 * bent > 2 * n:
        return None
    curve = minimum_link(problem, 1e-10)[0]
    if not 2 <= curve.knots.size <= n / 3 + 1:
        return None
    return descend(problem, curve, rounds=MANY, progress=1e-13)


def proposed_knots(problem: Problem, ideal: Array, segments: int) -> list[Array]:
    """Knots of the cheapest chains of chords of the ideal on a grid, without duplicates.

    Chains of a cycle begin and end at several samples, one after the other.
    """
    from planner.approximation.inner_loops import cheapest_chain

    n, cyclic, starts = problem.samples, problem.cyclic, np.zeros(1, dtype=np.intp)
    nearest, last = nearest_samples(problem.required), n if cyclic else n - 1
    if cyclic:
        fixed = np.unique(nearest % n)
        starts = fixed[:ANCHORS] if fixed.size else np.unique(np.arange(ANCHORS) * n // ANCHORS)
    # Costs take the square of the nodes. 64: 2.5 % of the fits worse by 0.1 %; 256: no change.
    even = np.round(np.linspace(0, last, min(last, 128) + 1)).astype(np.intp)
    proposals: dict[bytes, Array] = {}
    for first in starts.tolist():
        required = (nearest - first) % n if cyclic else nearest
        grid = np.union1d(even, required)
        index, around = np.arange(last + 1), np.arange(first, first + last + 1) % n
        desired, stays = problem.desired[around], np.isin(grid, required)
        sums = np.cumsum([desired, index * desired, desired**2], axis=1)[:, grid]
        way = cheapest_chain(grid, ideal[around][grid], sums, stays, problem.step, segments)
        if not way.size:
            continue
        places = grid[way].astype(np.float64) + first
        knots = with_required(problem, places[:-1] if cyclic else places)
        if knots is not None:
            proposals.setdefault(np.sort(knots % n if cyclic else knots).tobytes(), knots)
    return list(proposals.values())


def ranked_knots(problem: Problem) -> Array:
    """Knots on samples by bottom-up merging, of a cycle without its end: the first ones are best.

    The order in which neighbours of all segments between two samples are merged gives the knots for
    every number of segments at once, in O(n log n).
    """
    n, nearest = problem.samples, nearest_samples(problem.required)
    every = even_knots(problem._replace(required=nearest.astype(np.float64)))
    first, ends = int(every[0]), problem.ends(every)
    grid = (ends - first).astype(np.intp).tolist()
    last = len(grid) - 1
    stays = np.isin(np.mod(grid, n), np.mod(nearest - first, n))
    stays[[0, -1]] = True
    turned = np.resize(np.roll(problem.desired, -first), grid[-1] + 1)
    k = np.arange(turned.size, dtype=np.float64)
    s0, s1, s2 = (
        np.concatenate([[0.0], np.cumsum(total)]).tolist()
        for total in (turned, k * turned, turned**2)
    )

    def cost(start: int, end: int) -> float:
        """Squared error of the best line within the slopes through the samples between knots."""
        i, j = grid[start], grid[end]
        count = j + 1 - i
        middle, sxx = 0.5 * (i + j), count * (count * count - 1) / 12.0
        d0 = s0[j + 1] - s0[i]
        d1 = s1[j + 1] - s1[i] - middle * d0  # about the middle
        slope = min(max(d1 / sxx, -problem.step), problem.step)
        error: float = s2[j + 1] - s2[i] - d0 * d0 / count + slope * (slope * sxx - 2.0 * d1)
        return max(error, 0.0)

    before, after = list(range(-1, last)), list(range(1, last + 2))
    own = [cost(knot, knot + 1) for knot in range(last)]  # of the segment from a knot on

    def loss(knot: int) -> float:
        return cost(before[knot], after[knot]) - own[before[knot]] - own[knot]

    losses = {knot: loss(knot) for knot in np.flatnonzero(~stays).tolist()}
    queue = [(value, knot) for knot, value in losses.items()]
    heapify(queue)
    removed = []
    while queue:
        value, knot = heappop(queue)
        if losses.get(knot) != value:  # removed, or changed since
            continue
        removed.append(knot)
        del losses[knot]
        left, right = before[knot], after[knot]
        after[left], before[right] = right, left
        own[left] = cost(left, right)
        for neighbour in {left, right} & losses.keys():
            losses[neighbour] = loss(neighbour)
            heappush(queue, (losses[neighbour], neighbour))
    kept = ends[stays]
    return np.append(kept[:-1] if problem.cyclic else kept, ends[removed[::-1]])
