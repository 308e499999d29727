"""The search for knots and for their number: grids, descents, and moves of single knots.

Nothing is proved here. Chains of :mod:`planner.approximation.proposals` are starts of descents
(:mod:`planner.approximation.values`); a lattice around the best of them gives more. The squared
error has a kink wherever a knot meets a sample, so a local minimum between any two samples is
possible; so the knots of the best two curves are moved across samples, one at a time, each move
with a descent of its own. Beyond 32 segments, knots come from bottom-up merging and one descent.
Samples that are piecewise linear already have their corners read off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.approximation.problem import (
    BARELY,
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
    required_knots,
    round_knots,
    segment_capacity,
    to_resolution,
)
from planner.approximation.proposals import MergedKnots, chain_proposals, lattice_chain
from planner.approximation.values import (
    WINDOW,
    best_values,
    descend,
    descend_by_windows,
    ideal_of,
    solve_values,
    within_slopes,
)
from planner.exceptions import Infeasible, angle_text
from planner.trajectory import Array

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

BEND = 1e-10
"""Second difference, relative to the size of the samples, that counts as zero."""

CLOSE_TO_IDEAL = 1.02
"""Rms over the ideal's from which on more segments are not worth their corners."""

FLOOR = 0.01
"""Rms, relative to the range of the samples, below which more segments are not worth their
corners."""

ABOVE_NOISE = 1.1
"""Rms over the noise of the samples that is not worth corners either."""

ONE_BY_ONE = 16
"""Segments up to which every number is tried; beyond, a bracket grows and is halved. 8: more
segments in 5 of 99 answers; 32: no change."""

LIKELY = 1.02
"""Squared error of a rough curve over the sufficient one, up to which that number of segments is
searched in full at once. 1: more segments in 1 of 99 answers; 1.04: no change."""

HOPELESS = 1.75
"""The same from which on a number is not searched. Of 364 curves the full search lowered it by 1.04
in one of ten, by 1.4 in one of a hundred, by 2.4 at most."""


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


def automatic(search: KnotSearch) -> Candidate:
    """The fewest segments that come close to the ideal, or the exact curve if there is one."""
    if search.exact is not None:
        return search.exact
    desired = search.problem.desired
    negligible = max(2.0 * FLOOR, ABOVE_NOISE * noise(desired))  # the samples span 2 units
    enough = max(CLOSE_TO_IDEAL**2 * search.ideal_error, desired.size * negligible**2)

    def close_enough(segments: int) -> Candidate | None:
        curve = search.curve(segments)
        return curve if curve.error <= enough else None

    fewest = _fewest(search, enough, close_enough, search.most)
    return search.curve(search.most) if fewest is None else fewest


def noise(desired: Array) -> float:
    """Standard deviation of white noise on smooth samples, from their median second difference."""
    bend = np.abs(np.diff(desired, n=2))
    return float(np.median(bend)) / (0.6745 * math.sqrt(6.0))  # of a normal variable: median, Δ²


def within_rms(search: KnotSearch, bound: float, most: int | None, unit: float) -> Candidate:
    """The fewest segments whose rms error is within ``bound``.

    Args:
        search: Curves through the samples.
        bound: Largest rms error [unit of the search].
        most: Most segments; None for any number.
        unit: Unit of the search [rad], for the message.

    Raises:
        Infeasible: No curve within the slopes, or none of at most so many segments, is as close.
    """
    n = search.problem.samples
    ideal = math.sqrt(search.ideal_error / n)
    if bound < ideal * (1.0 - BARELY):
        raise Infeasible(
            f"max_rms and v_max: got {angle_text(bound * unit)}, but with slopes within ±v_max no "
            f"curve comes closer than {angle_text(ideal * unit)} rms; allow that much or a larger "
            "v_max"
        )
    enough = n * (bound * (1.0 + BARELY)) ** 2 + 1e-24 * n
    if most is None and search.exact is not None and search.exact.error <= enough:
        return search.exact
    last = search.most if most is None else min(most, search.most)

    def close_enough(segments: int) -> Candidate | None:
        curve = search.curve(segments)
        if enough < curve.error <= 1.001 * enough:  # with values a little short of the best
            curve = search.valued(curve.knots)
        return curve if curve.error <= enough else None

    fewest = _fewest(search, enough, close_enough, last)
    if fewest is None:
        least = math.sqrt(search.curve(last).error / n)
        raise Infeasible(
            f"max_rms and the number of segments: got {angle_text(bound * unit)}, but with at most "
            f"{last} segments the smallest found is {angle_text(least * unit)}; allow more error "
            "or more segments"
        )
    return fewest


def _fewest(
    search: KnotSearch,
    enough: float,
    close_enough: Callable[[int], Candidate | None],
    most: int,
) -> Candidate | None:
    """The curve of fewest segments whose error is small enough; few numbers are searched in full.

    Rough curves give a number that is surely enough. From there the numbers decrease by one, each
    searched in full, until one is not enough: fewer segments are assumed to be no better. Beyond
    :data:`ONE_BY_ONE` segments the number is found by bisection.
    """
    fewest = None
    count = search.fewest
    failed = without = count - 1  # the number before; the last searched in full and without any
    while True:
        if count == most or search.rough_error(count) <= LIKELY * enough:
            fewest = close_enough(count)
            without = without if fewest else count
        if fewest is not None or count == most:
            break
        failed = count
        count = min(most, count + 1 if count < ONE_BY_ONE else math.ceil(1.3 * count))
    if fewest is not None and count <= ONE_BY_ONE:
        while count - 1 > without and search.rough_error(count - 1) <= HOPELESS * enough:
            fewer = close_enough(count - 1)
            if fewer is None:
                break
            fewest, count = fewer, count - 1
        return fewest
    while fewest is not None and count - failed > 1 + math.floor(0.004 * count):
        middle = (failed + count) // 2
        better = close_enough(middle)
        if better is None:
            failed = middle
        else:
            fewest, count = better, middle
    return fewest
