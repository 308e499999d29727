"""The search for knots: chains on grids, descents, and moves of single knots.

Nothing is proved here. Cheapest chains are starts of descents
(:mod:`planner.approximation.values`); a lattice around the best of them gives more. The squared
error has a kink wherever a knot meets a sample, so a local minimum between any two samples is
possible; so the knots of the best two curves are moved across samples, one at a time, each move
with a descent of its own. Beyond 32 segments, knots come from bottom-up merging and one descent.
Samples that are piecewise linear already have their corners read off.

A segment from one sample to another has a cost that needs no other segment, so the cheapest chain
of a given number of segments is a shortest path (Bellman, On the approximation of curves by line
segments using dynamic programming, 1961; (5a) of docs/math.md). Three costs are used, as they
fail on different data:

- `chord`: the segment joins two points of the ideal sequence; within the slopes and continuous at
  once, but sensitive to noise at the two points;
- `line`: the segment is the best line with a slope within the bounds through its own samples of the
  ideal; insensitive to noise, but the lines need not meet. Of 150 fits of 2 to 15 segments 7 % are
  worse by 0.1 % or more without it, by 21 % at worst, and 13 % without chords, by 7 % at worst;
- of a lattice, :func:`lattice_chain`: at each node a few angles around the ideal may be taken, and
  a segment between two of these states has its exact squared error as its cost, infinite if it is
  too steep. So the cheapest chain is continuous, within the slopes, and best of all on the lattice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from heapq import heapify, heappop, heappush

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import PiecewiseLinear
from planner.approximation.problem import (
    EQUAL,
    SHORTEST,
    Candidate,
    CanonicalForm,
    Problem,
    at_resolution,
    candidate,
    even_knots,
    feasible_values,
    fixed_variables,
    nearest_samples,
    required_knots,
    round_knots,
    segment_capacity,
    to_resolution,
    with_required,
)
from planner.approximation.values import (
    WINDOW,
    best_values,
    descend,
    descend_by_windows,
    ideal_of,
    solve_values,
    within_slopes,
)
from planner.trajectory import Array

Indices = npt.NDArray[np.intp]

# The effects of half and twice were measured on 640 fits of 2 to 12 segments, and 80 of 14 to 40.

FEW = 4
"""Evaluations after which starts and moves are compared. 3: 0.02 % more error in the mean, 6 %
fewer evaluations; 8: no change for a fifth more."""

MANY = 8
"""Most evaluations of the descent of a curve that was chosen."""

CLOSE = 1.002
"""Squared error over the ideal's up to which a curve is not improved any more. 1.005: 0.3 % more of
the fits worse by 0.1 %, a tenth less time; 1.0005: nothing changes."""

LATTICES = (
    (29, (-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4)),
    (44, (-1.6, -0.8, 0.0, 0.8, 1.6)),
)
"""Few nodes with many angles and more with fewer, as they fail on different data; without both,
errors are 11 % higher at worst."""

MOVES = (-0.5, 0.5, -1.0, 1.0, -2.0, 2.0, -5.0, 5.0)
"""Moves of a knot [samples]. Without them: 2 % at worst. Without half a sample: 0.3 % more
of the fits worse by 0.1 %."""

TURNS = 3
"""Times that all knots are moved, as long as it helps. One: 0.05 % more error in the mean, 6 % of
the fits worse by 0.1 %; six: 0.003 % less error."""

PROPOSED = 32
"""Segments up to which knots are sought by chains; beyond, by merging. 16: 0.7 % more error in the
mean, 27 % at worst, in half the time; 64: 0.1 % more in the same time."""

NODES = 128
"""Most nodes of a grid without angles: costs take this number squared. 64: 2.5 % of the fits at
n = 88 worse by 0.1 %, by 2 % at worst; 256: no change there."""

ANCHORS = 6
"""Places of a cycle at which chains begin and end, its sharpest corner among them. 3: 0.03 % more
error in the mean, 6 % at worst."""

BEND = 1e-10
"""Second difference, relative to the size of the samples, that counts as zero."""


class KnotSearch:
    """Curves of any number of segments through the same samples, each computed once.

    The samples are searched in a canonical form and at a resolution of their own, so that shifted,
    mirrored, reversed and scaled ones give the same curve in spite of rounding.
    """

    def __init__(self, problem: Problem) -> None:
        """Find the ideal and the canonical form."""
        coarse = at_resolution(problem)
        ideal = ideal_of(coarse)
        self.form = CanonicalForm.of(coarse.desired, ideal, cyclic=problem.cyclic)
        self.problem = self.form.of_problem(coarse)
        self.ideal = to_resolution(self.form.apply(ideal))
        self.unrounded = self.form.of_problem(problem)
        most = segment_capacity(self.problem)[1]  # between required knots
        self.fewest = max(2 if problem.cyclic else 1, most.size)
        self.most = int(np.sum(most))
        self.ideal_error = float(np.sum((self.ideal - self.problem.desired) ** 2))
        self._curves: dict[int, Candidate] = {}
        self._rough: dict[int, list[Candidate]] = {}

    def curve(self, segments: int) -> Candidate:
        """The best curve found with this number of segments."""
        if segments not in self._curves:
            self._curves[segments] = self._best(segments)
        return self._curves[segments]

    def rough_error(self, segments: int) -> float:
        """Squared error of the best start of the search."""
        if segments in self._curves or segments > PROPOSED:
            return self.curve(segments).error
        return self._starts(segments)[0].error

    def valued(self, knots: Array) -> Candidate:
        """The curve of best values at these knots."""
        problem = self.problem
        values = within_slopes(
            solve_values(problem, knots),
            problem.step * np.diff(problem.ends(knots)),
            cyclic=problem.cyclic,
            towards=feasible_values(problem, knots) if problem.required.size else None,
        )
        return candidate(problem, knots, values)

    def final_curve(self, curve: Candidate) -> Candidate:
        """The curve through the input samples, by the last QP in the values."""
        knots = round_knots(curve.knots)
        values = solve_values(self.unrounded, knots, near=curve.values)
        return self.form.restore(Candidate(knots, values, curve.error))

    @cached_property
    def exact(self) -> Candidate | None:
        """The curve on which the samples lie, if there is one."""
        return exact_curve(self.unrounded)

    @cached_property
    def _merged_knots(self) -> MergedKnots:
        return MergedKnots(replace(self.problem, desired=self.ideal))

    def _best(self, segments: int) -> Candidate:
        problem = self.problem
        if self.exact is not None and segments == problem.segments(self.exact.knots):
            return self.exact
        if segments > PROPOSED:
            knots = self._merged_knots(segments)
            knots = even_knots(problem, segments) if knots is None else knots
            return descend_by_windows(problem, self.valued(knots), rounds=FEW)
        starts = self._starts(segments)
        best = starts[0]
        if best.knots.size > WINDOW or best.error <= 1e-22 * problem.samples:
            return best
        if best.error > CLOSE * self.ideal_error:
            best = improved(problem, self.ideal, starts)
        return descend(problem, best, rounds=MANY)

    def _starts(self, segments: int) -> list[Candidate]:
        """Curves a few evaluations from the proposals, the best first; computed once."""
        if segments not in self._rough:
            self._rough[segments] = self._begin(segments)
        return self._rough[segments]

    def _begin(self, segments: int) -> list[Candidate]:
        problem = self.problem
        proposals = chain_proposals(problem, self.ideal, segments)
        proposals = proposals or [even_knots(problem, segments)]
        if proposals[0].size <= WINDOW:
            starts = [best_values(problem, knots) for knots in proposals]
            rough = [descend(problem, start, rounds=FEW, progress=1e-2) for start in starts]
            return sorted(rough, key=by_error)
        starts = sorted(map(self.valued, proposals), key=by_error)[:2]
        rough = [descend_by_windows(problem, curve, rounds=FEW) for curve in starts]
        return [descend_by_windows(problem, min(rough, key=by_error), rounds=MANY)]


def by_error(curve: Candidate) -> float:
    """The squared error to nine digits, so that rounding decides nothing: the first one counts."""
    return float(f"{curve.error:.8e}")


def improved(problem: Problem, ideal: Array, rough: list[Candidate]) -> Candidate:
    """The best curve found from chains on lattices, and by moves of single knots.

    Args:
        problem: The approximation problem.
        ideal: Its slope-bounded ideal, shape (n,).
        rough: Curves of as many segments, the best first, at most :data:`WINDOW` knots.
    """
    best = rough[0]
    anchor = _sharpest_knot(problem, best) if problem.cyclic else 0
    chains = [
        lattice_chain(problem, ideal, best, nodes=nodes, offsets=offsets, anchor=anchor)
        for nodes, offsets in LATTICES
    ]
    starts = [best_values(problem, knots) for knots in chains if knots is not None]
    starts += rough[:2]
    begun = [descend(problem, start, rounds=MANY, progress=1e-2) for start in starts]
    begun.sort(key=by_error)
    return with_moved_knots(problem, _apart(begun)[:2])


def _apart(curves: list[Candidate]) -> list[Candidate]:
    """Curves whose knots differ from those of all earlier curves."""
    chosen: list[Candidate] = []
    for curve in curves:
        knots = np.sort(curve.knots)
        if all(np.max(np.abs(knots - np.sort(each.knots))) > 1.0 for each in chosen):
            chosen.append(curve)
    return chosen


def _sharpest_knot(problem: Problem, curve: Candidate) -> int:
    """Number of the knot of a cycle at which the slope changes most, a required one if any is.

    Where slopes are at their bounds several change by as much: the first of them is taken, and not
    the one that rounding makes the largest.
    """
    slopes = np.diff(np.append(curve.values, curve.values[0])) / np.diff(problem.ends(curve.knots))
    bend = np.abs(slopes - np.roll(slopes, 1))
    if problem.required.size:
        bend = np.where(required_knots(problem, curve.knots)[0], bend, -1.0)
    return int(np.argmax(bend >= (1.0 - EQUAL) * np.max(bend)))


def with_moved_knots(problem: Problem, curves: list[Candidate]) -> Candidate:
    """A curve reached by moving single knots, each move followed by a descent; never a worse one.

    Args:
        problem: The approximation problem.
        curves: Where to begin; from the first move on the best is followed alone.
    """
    best, bases = min(curves, key=by_error), curves
    for _ in range(TURNS):
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
    """The curves with one knot moved along the curve; their errors are not yet computed."""
    along = PiecewiseLinear(
        knots=curve.knots,
        values=curve.values,
        samples=problem.samples,
        tick=1.0,
        cyclic=problem.cyclic,
    )
    movable = np.flatnonzero(~fixed_variables(problem, curve.knots)[0])
    moves = np.tile(MOVES, movable.size)
    which = np.repeat(movable, len(MOVES))
    knots = np.tile(curve.knots, (which.size, 1))
    row = np.arange(which.size)
    knots[row, which] += moves
    values = np.tile(curve.values, (which.size, 1))
    values[row, which] = along(knots[row, which])
    ends = np.column_stack([knots, knots[:, 0] + problem.samples]) if problem.cyclic else knots
    allowed = np.min(np.diff(ends, axis=1), axis=1) >= SHORTEST
    return [
        Candidate(k, v, curve.error) for k, v in zip(knots[allowed], values[allowed], strict=True)
    ]


def exact_curve(problem: Problem) -> Candidate | None:
    """The curve that the samples lie on, if it keeps the slopes and has few segments.

    A corner on a sample shows in one second difference; a corner between two samples in two, and
    lies where the lines on its two sides meet.

    Args:
        problem: The approximation problem; samples of size one.

    Returns:
        The curve; None if it is too steep somewhere or has more than one segment in three samples.
    """
    d, n = problem.desired, problem.samples
    if problem.required.size:
        return None
    bent = np.abs(np.roll(d, 1) - 2.0 * d + np.roll(d, -1)) > BEND
    if not problem.cyclic:
        bent[[0, -1]] = True
    if 3 * np.count_nonzero(bent) > 2 * n:
        return None
    at = np.flatnonzero(bent)
    gap = np.diff(np.append(at, at[0] + n)) if problem.cyclic else np.append(np.diff(at), n)
    pairs = (gap == 1) & (np.roll(gap, 1) != 1) & (np.roll(gap, -1) != 1)
    knots: list[float] = []
    values: list[float] = []
    skip = False
    for first, paired in zip(at.tolist(), pairs.tolist(), strict=True):
        if skip:
            skip = False
            continue
        meeting = _meeting(d, first) if paired else None
        if meeting is not None and (problem.cyclic or 0 < first < n - 2):
            knots.append(first + meeting[0])
            values.append(meeting[1])
            skip = True
        else:
            knots.append(float(first))
            values.append(float(d[first]))
    if problem.cyclic and skip and knots and at[0] == 0 and at[-1] == n - 1 and len(knots) > 1:
        knots, values = knots[1:], values[1:]
    if len(knots) < 2 or 3 * len(knots) > n + 3:
        return None
    return _within_problem(problem, np.array(knots), np.array(values))


def _meeting(d: Array, k: int) -> tuple[float, float] | None:
    """Where between samples k and k + 1 the lines on their two sides meet, and the value there."""
    n = d.size
    before, here = d[(k - 1) % n], d[k % n]
    there, after = d[(k + 1) % n], d[(k + 2) % n]
    left, right = here - before, after - there
    if left == right:
        return None
    share = (there - right - here) / (left - right)
    return (float(share), float(here + share * left)) if 0.0 < share < 1.0 else None


def _within_problem(problem: Problem, knots: Array, values: Array) -> Candidate | None:
    """The curve, if it is one within the slopes that the samples lie on."""
    curve = candidate(problem, knots, values)
    rises = np.diff(np.append(values, values[0]) if problem.cyclic else values)
    lengths = np.diff(problem.ends(knots))
    steep = np.abs(rises) > problem.step * lengths * (1.0 + 1e-9)
    off = curve.error > problem.samples * (100.0 * BEND) ** 2
    return None if np.any(steep) or np.any(lengths < 1.0) or off else curve


def chain_proposals(problem: Problem, ideal: Array, segments: int) -> list[Array]:
    """Knots of the cheapest chains by chord and by line, without duplicates.

    Args:
        problem: The approximation problem; a cycle begins where a knot is likely.
        ideal: Its slope-bounded ideal, shape (n,).
        segments: Number of segments.
    """
    from planner.approximation import kernel

    n = problem.samples
    last = n if problem.cyclic else n - 1
    fixed = np.unique(nearest_samples(problem.required) % n)
    nodes = np.round(np.linspace(0, last, min(last, NODES) + 1)).astype(np.intp)
    nodes = np.union1d(nodes % n, fixed)
    starts = np.zeros(1, dtype=np.intp)
    if problem.cyclic:
        even = nodes[np.unique(np.arange(ANCHORS) * nodes.size // ANCHORS)]
        starts = fixed[:ANCHORS] if fixed.size else even
    proposals: dict[bytes, Array] = {}
    for by_chord in (True, False):
        for first in starts.tolist():
            grid, around, stays = _grid(problem, nodes, fixed, first)
            desired, sequence = problem.desired[around], ideal[around]
            if by_chord:
                states = sequence[grid][:, None]
                costs = kernel.chord_costs(desired, problem.step, grid, states, stays)
            else:
                costs = kernel.line_costs(sequence, problem.step, grid, stays)
            way = kernel.cheapest_chain(costs, np.zeros(1), segments)
            knots = _knots(problem, grid, way, first)
            if knots is not None:
                order = np.sort(knots % n if problem.cyclic else knots)
                proposals.setdefault(order.tobytes(), knots)
    return list(proposals.values())


def _grid(
    problem: Problem, nodes: Indices, fixed: Indices, first: int
) -> tuple[Indices, Indices, npt.NDArray[np.bool_]]:
    """Nodes after a sample, a cycle's end included, all samples from there, and fixed nodes."""
    n = problem.samples
    if not problem.cyclic:
        return nodes, np.arange(n), np.isin(nodes, fixed)
    grid = np.append(np.sort((nodes - first) % n), n)
    return grid, np.arange(first, first + n + 1) % n, np.isin(grid, (fixed - first) % n)


def _knots(problem: Problem, grid: Indices, way: Indices, first: int) -> Array | None:
    """Knots of a chain of nodes, a cycle's without its end; None if there is none."""
    if not way.size:
        return None
    way = way[:-1] if problem.cyclic else way
    return with_required(problem, grid[way].astype(np.float64) + first)


def lattice_chain(
    problem: Problem,
    ideal: Array,
    curve: Candidate,
    *,
    nodes: int,
    offsets: tuple[float, ...],
    anchor: int,
) -> Array | None:
    """Knots of the cheapest chain with as many segments on a grid.

    Args:
        problem: The approximation problem.
        ideal: Its slope-bounded ideal, shape (n,).
        curve: Sets the number of segments and the distance from the ideal.
        nodes: Places where knots may lie, if the samples are as many; four for every segment where
            that is more. The cost of a chain takes this number squared.
        offsets: Angles that a knot may have around the ideal, in units of the curve's rms error.
        anchor: Number of the knot that is kept, for a cycle.

    Returns:
        Knots; None if no chain is within the slopes.
    """
    from planner.approximation import kernel

    n, segments = problem.samples, problem.segments(curve.knots)
    first = round(float(curve.knots[anchor])) if problem.cyclic else 0
    last = n if problem.cyclic else n - 1
    fixed = nearest_samples(problem.required) % n
    places = np.linspace(0, last, min(last, max(nodes, 4 * segments)) + 1)
    even = (np.round(places).astype(np.intp) + first) % n
    grid, around, stays = _grid(problem, np.union1d(even, fixed), fixed, first)
    desired, unit = problem.desired[around], float(np.sqrt(curve.error / n))
    states = ideal[around][grid][:, None] + unit * np.array(offsets)
    if problem.cyclic:
        states[[0, -1], 0] = float(np.interp(first, curve.knots, curve.values, period=n))
        states[[0, -1], 1:] = np.inf
    for place, pin in zip((fixed - first) % n, problem.pins, strict=True):
        if np.isfinite(pin):
            states[grid % n == place] = np.inf
            states[grid % n == place, 0] = pin
    costs = kernel.chord_costs(desired, problem.step, grid, states, stays)
    way = kernel.cheapest_chain(costs, (states[0] - desired[0]) ** 2, segments)
    return _knots(problem, grid, way // len(offsets), first)


class MergedKnots:
    """Knots on samples for any number of segments: neighbours merged one pair at a time.

    From a segment between any two samples down. The order of the merges gives the knots for every
    number of segments, each set within the next, in O(n log n) once.
    """

    def __init__(self, problem: Problem) -> None:
        """Merge until no knot is left that may go, and note the order."""
        self._problem = problem
        n = problem.samples
        every: Array = np.arange(n, dtype=np.float64)
        if problem.required.size:
            nearest = nearest_samples(problem.required).astype(np.float64)
            every = even_knots(replace(problem, required=nearest))
        last = n if problem.cyclic else n - 1
        self._first = int(every[0])
        self._grid = problem.ends(every)
        self._grid = (self._grid - self._first).astype(np.intp)
        turned = np.resize(np.roll(problem.desired, -self._first), last + 1)
        self._cost = _line_cost(turned, problem.step)
        fixed = nearest_samples(problem.required) - self._first
        stays = np.isin(self._grid, np.mod(fixed, n) if problem.cyclic else fixed)
        stays[[0, -1]] = True
        self._removed = np.array(self._merge(stays.tolist()), dtype=np.intp)
        self._stay = self._grid[stays]

    def __call__(self, segments: int) -> Array | None:
        """Knots for so many segments, a cycle's first at its first sample; None if too many."""
        more = segments + 1 - self._stay.size
        if not 0 <= more <= self._removed.size:
            return None
        keep = np.append(self._stay, self._removed[self._removed.size - more :])
        knots = np.sort(keep).astype(np.float64) + self._first
        return with_required(self._problem, knots[:-1] if self._problem.cyclic else knots)

    def _merge(self, stays: list[bool]) -> list[int]:
        """Samples in the order in which they cease to be knots."""
        grid = [int(k) for k in self._grid]
        cost, last = self._cost, len(grid) - 1
        before = list(range(-1, last))
        after = list(range(1, last + 2))
        own = [cost(grid[k], grid[k + 1]) for k in range(last)]  # of the segment from k on

        def loss(knot: int) -> float:
            joined = cost(grid[before[knot]], grid[after[knot]])
            return joined - own[before[knot]] - own[knot]

        version = [0] * (last + 1)
        queue = [(loss(knot), knot, 0) for knot in range(1, last) if not stays[knot]]
        heapify(queue)
        removed = []
        while queue:
            _, knot, seen = heappop(queue)
            if seen != version[knot]:
                continue
            removed.append(grid[knot])
            version[knot] = -1
            left, right = before[knot], after[knot]
            own[left] = cost(grid[left], grid[right])
            after[left], before[right] = right, left
            for neighbour in (left, right):
                if not stays[neighbour]:
                    version[neighbour] += 1
                    heappush(queue, (loss(neighbour), neighbour, version[neighbour]))
        return removed


def _line_cost(desired: Array, step: float) -> Callable[[int, int], float]:
    """The squared error of the best line within the slopes through the samples from i to j."""
    k = np.arange(desired.size, dtype=np.float64)
    s0, s1, s2 = (
        np.concatenate([[0.0], np.cumsum(total)]).tolist()
        for total in (desired, k * desired, desired**2)
    )

    def cost(i: int, j: int) -> float:
        count = j + 1 - i
        middle, sxx = 0.5 * (i + j), count * (count * count - 1) / 12.0
        d0 = s0[j + 1] - s0[i]
        d1 = s1[j + 1] - s1[i] - middle * d0  # about the middle
        slope = min(max(d1 / sxx, -step), step)
        error: float = s2[j + 1] - s2[i] - d0 * d0 / count + slope * (slope * sxx - 2.0 * d1)
        return max(error, 0.0)

    return cost
