"""The proved optimum with knots on samples: bounds from a relaxation, halves until none is left."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from planner.approximation.objective import Candidate, Problem
from planner.approximation.relaxation import Bound, Levels, Potentials, Relaxation
from planner.approximation.requirements import held
from planner.approximation.whole import WholeKnots
from planner.exceptions import SolverFailed
from planner.trajectory import Array

PROVED = 1e-6
"""Relative distance of the squared error from the least that is left unproved."""

LARGEST_EXACT = 400
"""Samples up to which the optimum is proved: memory grows with their square, of a cycle their cube
at the first bound."""

MOST_BRANCHES = 20_000
"""Halves that are looked at before the search gives up."""

FEW = 16
"""Sets of knots that are tried one by one rather than halved."""

ROOT_STEPS, BRANCH_STEPS = 60, 25
"""Steps of the potentials, at first and after each halving."""

WIDEST = 6
"""Neighbours of a knot that learn from its mismatch in the first steps [samples]."""


@dataclass(order=True)
class Branch:
    """Places where each knot may lie, with what is known of the curves among them."""

    bound: float
    number: int
    levels: Levels
    potentials: Potentials


def proved_best(problem: Problem, start: Candidate) -> Candidate:
    """The curve of least squared error with as many segments as ``start`` and knots on samples.

    Branch and bound: places of knots through which every chain of :class:`Relaxation` costs more
    than the best curve known are struck out; the rest is halved.

    Args:
        problem: What to approximate; ``whole``, required knots on samples.
        start: A curve with whole knots.

    Returns:
        The best curve; its squared error exceeds the least possible by no more than
        :data:`PROVED` of it.

    Raises:
        SolverFailed: No proof within :data:`MOST_BRANCHES` halvings.
    """
    return _BranchAndBound(problem, start).best


class _BranchAndBound:
    def __init__(self, problem: Problem, start: Candidate) -> None:
        self._problem = problem
        self._relaxation = Relaxation(problem)
        self._curves = WholeKnots(problem)
        order = np.argsort(np.mod(start.knots, problem.samples) if problem.cyclic else start.knots)
        knots = start.knots[order]
        knots = np.mod(knots, problem.samples) if problem.cyclic else knots
        self.best = self._curves.nudged(knots)
        if problem.cyclic:
            knots = np.sort(np.mod(self.best.knots, problem.samples))
            self.best = self._curves.curve(knots)
        self._search()

    @property
    def _enough(self) -> float:
        """A bound that proves."""
        return self.best.error * (1.0 - PROVED) - 1e-12

    def _search(self) -> None:
        root = Branch(-math.inf, 0, self._all_levels(), first_potentials(self._problem, self.best))
        queue, number = [root], 0
        while queue:
            branch = heapq.heappop(queue)
            if branch.bound >= self._enough:
                return
            tightened = self._tightened(branch, ROOT_STEPS if number == 0 else BRANCH_STEPS)
            if tightened is None:
                continue
            if math.prod(len(level) for level in tightened.levels) <= FEW:
                for knots in product(*tightened.levels):
                    self._try(knots)
                continue
            for half in _halves(tightened.levels):
                number += 1
                if number > MOST_BRANCHES:
                    gap = 1.0 - branch.bound / self.best.error
                    raise SolverFailed("exact piecewise-linear fit", "too many", violation=gap)
                heapq.heappush(queue, replace(tightened, number=number, levels=half))

    def _all_levels(self) -> Levels:
        n, size = self._problem.samples, self.best.knots.size
        if self._problem.cyclic:
            return [np.arange(t, n - size + t + 1) for t in range(size)]
        inner = [np.arange(t, n - size + t + 1) for t in range(1, size - 1)]
        return [np.array([0]), *inner, np.array([n - 1])]

    def _tightened(self, branch: Branch, steps: int) -> Branch | None:
        """The branch with better potentials and fewer places; None if it holds nothing better."""
        levels = branch.levels
        trial = best = Potentials(branch.potentials.into.copy(), branch.potentials.out.copy())
        highest, pace, stalled = -math.inf, 1.0, 0
        for step in range(steps):
            found = self._relaxation.bound(levels, trial)
            if not math.isfinite(found.error):
                return None
            self._try(found.chain)
            if found.error >= self._enough:
                return None
            stalled += found.error - highest < 1e-4 * (self.best.error - highest)
            if found.error > highest:
                highest = found.error
                best = Potentials(trial.into.copy(), trial.out.copy())
            if stalled > 3:
                pace, stalled = 0.5 * pace, 0
            levels = [
                level[cost < self._enough]
                for level, cost in zip(levels, found.through, strict=True)
            ]
            if pace < 0.05 or not self._climb(trial, found, pace, 1 + int(WIDEST / (1 + step / 6))):
                break
        return Branch(highest, 0, levels, best)

    def _climb(self, potentials: Potentials, found: Bound, pace: float, width: int) -> bool:
        """Move the potentials up by a step of Polyak's; False if the chain's segments meet."""
        by_into, by_out = self._relaxation.mismatches(found.chain, potentials)
        square = float(by_into @ by_into + by_out @ by_out)
        if square < 1e-20:
            return False
        step = 2.0 * pace * (self.best.error - found.error) / square
        places = np.arange(self._problem.samples)
        for t, knot in enumerate(found.chain):
            away = np.abs(places - knot)
            if self._problem.cyclic:
                away = np.minimum(away, self._problem.samples - away)
            near = np.maximum(0.0, 1.0 - away / width)
            same = not np.isfinite(self._relaxation.pins[knot])
            near = near if same else (away == 0).astype(np.float64)
            potentials.into[t] += step * by_into[t] * near
            potentials.out[t] += step * by_out[t] * near
        return True

    def _try(self, knots: object) -> None:
        """Remember the curve with these knots if it is the best so far."""
        curve = self._curves.curve(np.array(knots, dtype=np.float64))
        if curve.error < self.best.error:
            self.best = curve


def _halves(levels: Levels) -> list[Levels]:
    """The widest level cut in two, and what of the others that leaves possible."""
    widest = int(np.argmax([level.size for level in levels]))
    middle = levels[widest].size // 2
    halves = []
    for part in (levels[widest][:middle], levels[widest][middle:]):
        half = [*levels[:widest], part, *levels[widest + 1 :]]
        for t in range(1, len(half)):
            half[t] = half[t][half[t] > half[t - 1][0]] if half[t - 1].size else half[t - 1]
        for t in range(len(half) - 2, -1, -1):
            half[t] = half[t][half[t] < half[t + 1][-1]] if half[t + 1].size else half[t + 1]
        if all(level.size for level in half):
            halves.append(half)
    return halves


def first_potentials(problem: Problem, curve: Candidate) -> Potentials:
    """The potentials that make ``curve`` the cheapest chain with its own knots.

    A segment is at rest if twice the sum of its residuals, w (P - d), equals the potential at its
    start less that at its end; the first one follows from a segment whose slope is free.
    """
    n = problem.samples
    index = np.arange(n, dtype=np.float64)
    fitted = np.interp(index, curve.knots, curve.values, period=n if problem.cyclic else None)
    residual = problem.weights * (fitted - problem.desired)
    along = -2.0 * (np.cumsum(residual) - 0.5 * residual)
    if not problem.cyclic:
        along = -2.0 * (np.cumsum(residual) - 0.5 * residual)
        along[-1] = 0.0
        along[0] = 0.0
    else:
        along += _first_of_cycle(problem, curve, residual, along)
    table = np.tile(along, (curve.knots.size, 1))
    _, pinned = held(problem, curve.knots)
    del pinned
    return Potentials(table, table.copy())


def _first_of_cycle(problem: Problem, curve: Candidate, residual: Array, along: Array) -> float:
    """What to add to the potentials of a cycle, from the segments whose slopes are free."""
    n = problem.samples
    ends = np.append(curve.knots, curve.knots[0] + n).astype(np.intp)
    values = np.append(curve.values, curve.values[0])
    found = []
    for i, j, rise in zip(ends[:-1], ends[1:], np.diff(values), strict=True):
        if abs(rise) >= problem.step * (j - i) * (1.0 - 1e-6):
            continue
        inside = np.arange(i, j + 1)
        share = np.full(inside.size, 2.0)
        share[[0, -1]] = 1.0
        turn = float(share * residual[inside % n] @ (inside - i))
        start = along[i % n]
        end = start - float(share @ residual[inside % n])
        # d/dm about the start: turn + end (j - i) = 0 at rest, with both raised by the answer.
        found.append(-(turn + end * (j - i)) / (j - i))
    return float(np.mean(found)) if found else 0.0
