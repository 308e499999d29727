"""The search for knots: starts from grids, descents, and moves of single knots.

Nothing is proved here. Chains of :mod:`planner.approximation.dynamic_programming` are starts of
descents (:mod:`planner.approximation.sqp`); a lattice around the best of them gives more. The
squared error has a kink wherever a knot meets a sample, so a local minimum between any two samples
is possible; so the knots of the best two curves are moved across samples, one at a time, each move
with a descent of its own. Beyond 32 segments, knots come from bottom-up merging and one descent.
Samples that are piecewise linear already have their corners read off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.approximation.bottom_up_merging import MergedKnots
from planner.approximation.canonical_form import (
    EQUAL,
    CanonicalForm,
    at_resolution,
    from_means,
    to_means,
    to_resolution,
)
from planner.approximation.curve import PiecewiseLinear
from planner.approximation.dynamic_programming import CHAINS, ChainProposals, lattice_chain
from planner.approximation.problem import (
    SHORTEST,
    Candidate,
    Problem,
    candidate,
    even_knots,
    feasible_values,
    fixed_variables,
    least_count,
    most_segments,
    required_knots,
    round_knots,
)
from planner.approximation.qp import solve_values, within_slopes
from planner.approximation.slope_projection import ideal_of
from planner.approximation.sqp import SQP, best_values, descend, descend_by_windows
from planner.trajectory import Array

STRAIGHT = 1e-10
"""Second difference, relative to the size of the samples, that counts as none."""


@dataclass(frozen=True)
class SearchOptions:
    """Tuning of the search. Effects are those on 640 fits of 2 to 12 segments.

    Those of few, many, rough, apart, kept and helps were measured on a quarter of them.

    Attributes:
        few: Evaluations after which starts and moves are compared. 3: 0.02 % more error in the
            mean, 6 % fewer evaluations; 8: no change for a fifth more.
        many: Most evaluations of the descent of a curve that was chosen. 4: 0.001 % more error in
            the mean, a tenth fewer evaluations; 15: no change for 5 % more.
        rough: Relative decrease of the squared error below which a start's descent ends. 1e-3: no
            change for 4 % more evaluations.
        finalists: Curves of the proposals that are kept, and of all whose knots are moved. One:
            0.05 % more error in the mean, 19 % at worst; three: 0.003 % less, a tenth more time.
        apart: Distance between knots from which on two curves differ [samples]. 0.5 and 2: no
            change; 1 % more and fewer curves.
        close: Squared error over the ideal's up to which a curve is not improved any more. 1.005:
            0.3 % more of the fits worse by 0.1 %, a tenth less time; 1.0005: nothing changes.
        moves: What a knot is moved by [samples]. Without them: 2 % at worst. Without half a sample:
            0.3 % more of the fits worse by 0.1 %; with ten besides: nothing for a tenth more time.
        turns: Times that all knots are moved, as long as it helps. One: 0.05 % more error in the
            mean, 6 % of the fits worse by 0.1 %; six: 0.003 % less error.
        kept: Moved curves that go on after the first evaluations. 6: 0.001 % more error;
            24: no change.
        helps: Relative decrease of the squared error that is worth another turn. 1e-2: 0.01 % more
            error in the mean, 2.5 % more of the fits worse by 0.1 %, a tenth fewer curves.
        proposed: Segments up to which knots are sought by chains; beyond, by merging. 80 fits of 14
            to 40 segments: 16: 0.7 % more error in the mean, 27 % at worst, in half the time; 64:
            0.1 % more in the same time.
        many_samples: Samples beyond which few knots are sought among means of them. 24 fits at
            n = 3,000: 4,000: no change for a fifth more time.
        none: Mean squared error, of samples of size one, that counts as none: such a curve is not
            improved. 160 fits: 1e-24 and 1e-20: no change.
    """

    few: int = 4
    many: int = 8
    rough: float = 1e-2
    finalists: int = 2
    apart: float = 1.0
    close: float = 1.002
    moves: tuple[float, ...] = (-0.5, 0.5, -1.0, 1.0, -2.0, 2.0, -5.0, 5.0)
    turns: int = 3
    kept: int = 12
    helps: float = 1e-3
    proposed: int = 32
    many_samples: int = 2000
    none: float = 1e-22


SEARCH = SearchOptions()


class KnotSearch:
    """Curves of any number of segments through the same samples, each found once.

    The samples are searched in a canonical form and at a resolution of their own, so that shifted,
    mirrored, reversed and scaled ones give the same curve in spite of rounding.
    """

    def __init__(self, problem: Problem) -> None:
        """Find the ideal and the canonical form.

        Args:
            problem: What to approximate, samples of size one.
        """
        coarse = at_resolution(problem)
        ideal = ideal_of(coarse)
        self.form = CanonicalForm.of(coarse.desired, ideal, cyclic=problem.cyclic)
        self.problem = self.form.of_problem(coarse)
        self.ideal = to_resolution(self.form.apply(ideal))
        self.unrounded = self.form.of_problem(problem)
        self.fewest = least_count(self.problem)
        self.most = most_segments(self.problem)
        self.ideal_error = float(np.sum((self.ideal - self.problem.desired) ** 2))
        self._found: dict[int, Candidate] = {}
        self._begun: dict[int, list[Candidate]] = {}

    def curve(self, segments: int) -> Candidate:
        """The best curve found with this number of segments."""
        if segments not in self._found:
            self._found[segments] = self._best(segments)
        return self._found[segments]

    def rough_error(self, segments: int, limit: float) -> float:
        """Squared error of a rough curve, or infinite where even chains of chords are above it.

        Args:
            segments: Number of segments.
            limit: Squared error of the cheapest chain of chords from which on none is begun.
        """
        if segments in self._found or segments > SEARCH.proposed or self._of_means is not None:
            return self.curve(segments).error
        chords = self._proposals.least_error(segments)
        if chords is not None and chords > limit:
            return math.inf
        return self._starts(segments)[0].error

    def valued(self, knots: Array) -> Candidate:
        """The curve of best values at these knots."""
        problem = self.problem
        if knots.size <= SQP.window:
            return best_values(problem, [knots])[0]
        values = within_slopes(
            solve_values(problem, knots),
            problem.step * np.diff(problem.ends(knots)),
            cyclic=problem.cyclic,
            towards=feasible_values(problem, knots) if problem.required.size else None,
        )
        return candidate(problem, knots, values)

    def final_curve(self, curve: Candidate) -> tuple[Array, Array]:
        """Knots and values for the samples as given, by the last QP in the values."""
        knots = round_knots(curve.knots)
        values = solve_values(self.unrounded, knots, near=curve.values)
        return self.form.restore(Candidate(knots, values, curve.error))

    @cached_property
    def exact(self) -> Candidate | None:
        """The curve on which the samples lie, if there is one."""
        return exact_curve(self.unrounded)

    @cached_property
    def _of_means(self) -> KnotSearch | None:
        """Curves through fewer samples, where there are very many and any knots will do."""
        problem = self.problem
        if problem.samples <= SEARCH.many_samples or problem.required.size:
            return None
        return KnotSearch(to_means(problem))

    @cached_property
    def _proposals(self) -> ChainProposals:
        return ChainProposals(self.problem, self.ideal)

    @cached_property
    def _merged(self) -> MergedKnots:
        return MergedKnots(replace(self.problem, desired=self.ideal))

    def _best(self, segments: int) -> Candidate:
        problem = self.problem
        if self.exact is not None and segments == problem.segments(self.exact.knots):
            return self.exact
        if segments > SEARCH.proposed:
            merged = self._merged(segments)
            merged = even_knots(problem, segments) if merged is None else merged
            return descend_by_windows(problem, self.valued(merged), rounds=SEARCH.few)
        starts = self._starts(segments)
        best = starts[0]
        if best.knots.size > SQP.window or best.error <= SEARCH.none * problem.samples:
            return best
        if self._of_means is None and best.error > SEARCH.close * self.ideal_error:
            best = improved(problem, self.ideal, starts)
        return descend(problem, [best], rounds=SEARCH.many)[0]

    def _starts(self, segments: int) -> list[Candidate]:
        """Curves a few evaluations from what is proposed, the best first; found once."""
        if segments not in self._begun:
            self._begun[segments] = self._begin(segments)
        return self._begun[segments]

    def _begin(self, segments: int) -> list[Candidate]:
        problem = self.problem
        if self._of_means is not None and segments < SQP.window:
            few = self._of_means.form.restore(self._of_means.curve(segments))
            return descend(problem, [from_means(problem, *few)], rounds=SEARCH.few)
        proposed = self._proposals(segments) or [even_knots(problem, segments)]
        if proposed[0].size <= SQP.window:
            starts = best_values(problem, proposed)
            begun = descend(problem, starts, rounds=SEARCH.few, progress=SEARCH.rough)
            return sorted(begun, key=by_error)
        starts = sorted(map(self.valued, proposed), key=by_error)[: SEARCH.finalists]
        begun = [descend_by_windows(problem, curve, rounds=SEARCH.few) for curve in starts]
        return [descend_by_windows(problem, min(begun, key=by_error), rounds=SEARCH.many)]


def by_error(curve: Candidate) -> float:
    """The squared error to nine digits, so that rounding decides nothing: the first one counts."""
    return float(f"{curve.error:.8e}")


def improved(problem: Problem, ideal: Array, rough: list[Candidate]) -> Candidate:
    """The best curve found from chains on lattices, and by moves of single knots.

    Args:
        problem: What to approximate.
        ideal: Its slope-bounded ideal, shape (n,).
        rough: Curves of as many segments, the best first, at most ``SQP.window`` knots.
    """
    best = rough[0]
    anchor = _sharpest_knot(problem, best) if problem.cyclic else 0
    chains = (
        lattice_chain(problem, ideal, best, lattice, anchor=anchor) for lattice in CHAINS.lattices
    )
    starts = best_values(problem, [knots for knots in chains if knots is not None])
    starts += rough[: SEARCH.finalists]
    begun = sorted(
        descend(problem, starts, rounds=SEARCH.many, progress=SEARCH.rough), key=by_error
    )
    if problem.required.size:
        return begun[0]
    return with_moved_knots(problem, _apart(begun)[: SEARCH.finalists])


def _apart(curves: list[Candidate]) -> list[Candidate]:
    """Those of the curves that have other knots than all before them."""
    chosen: list[Candidate] = []
    for curve in curves:
        knots = np.sort(curve.knots)
        if all(np.max(np.abs(knots - np.sort(each.knots))) > SEARCH.apart for each in chosen):
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
        problem: What to approximate.
        curves: Where to begin; from the first move on the best is followed alone.
    """
    best, begun = min(curves, key=by_error), curves
    for _ in range(SEARCH.turns):
        starts = [each for curve in begun for each in (curve, *moved(problem, curve))]
        other = min(descend(problem, starts, rounds=SEARCH.few, keep=SEARCH.kept), key=by_error)
        gained = best.error - other.error
        if gained <= 0.0:
            break
        best, begun = other, [other]
        if gained <= SEARCH.helps * best.error:
            break
    return best


def moved(problem: Problem, curve: Candidate) -> list[Candidate]:
    """The curves with one knot moved along the curve; their errors are not yet computed."""
    along = _along(problem, curve)
    movable = np.flatnonzero(~fixed_variables(problem, curve.knots)[0])
    moves = np.tile(SEARCH.moves, movable.size)
    which = np.repeat(movable, len(SEARCH.moves))
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


def _along(problem: Problem, curve: Candidate) -> PiecewiseLinear:
    return PiecewiseLinear(
        knots=curve.knots,
        values=curve.values,
        samples=problem.samples,
        tick=1.0,
        cyclic=problem.cyclic,
    )


def exact_curve(problem: Problem) -> Candidate | None:
    """The curve that the samples lie on, if it keeps the slopes and has few segments.

    A corner on a sample shows in one second difference; a corner between two samples in two, and
    lies where the lines on its two sides meet.

    Args:
        problem: What to approximate; samples of size one.

    Returns:
        The curve; None if it is too steep somewhere or has more than one segment in three samples.
    """
    d, n = problem.desired, problem.samples
    if problem.required.size:
        return None
    bent = np.abs(np.roll(d, 1) - 2.0 * d + np.roll(d, -1)) > STRAIGHT
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
    off = curve.error > problem.samples * (100.0 * STRAIGHT) ** 2
    return None if np.any(steep) or np.any(lengths < 1.0) or off else curve
