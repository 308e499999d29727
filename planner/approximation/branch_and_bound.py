"""Branch and bound: the proved optimum with knots on samples ((5b) of docs/math.md)."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from operator import attrgetter

import numpy as np

from planner.approximation.lagrangian_bound import (
    Levels,
    Multipliers,
    Relaxation,
    climb,
    first_multipliers,
)
from planner.approximation.problem import Candidate, Problem, required_knots
from planner.approximation.slope_projection import ideal_of
from planner.approximation.sqp import best_values
from planner.exceptions import SolverFailed
from planner.trajectory import Array


@dataclass(frozen=True)
class BranchOptions:
    """What is proved, and the effort.

    Effects are those on 32 fits of 3 and 5 segments at n = 88, whose answers none of them changes;
    bounds are passes through all places of a branch.

    Attributes:
        proved: Relative distance of the squared error from the least that is left unproved.
        samples: Samples up to which the optimum is proved: memory grows with their square, of a
            cycle their cube at the first bound.
        branches: Halves that are looked at before the search gives up.
        few: Sets of knots that are tried one by one rather than halved. 8 and 32: the same time.
        root_steps: Steps of the multipliers at first. 30: the same time.
        branch_steps: The same after each halving. 12: a third fewer bounds; 50: a sixth more.
        widest: Neighbours of a knot that take part of its first steps [samples]. 3 and 12: a tenth
            and 4 % fewer bounds.
        moves: What a knot of the curve to begin with is moved by [samples]. One sample only, and
            eight besides: as many bounds.
        helps: Relative decrease of the squared error that counts as one. 1e-6: as many bounds.
        progress: Rise of the bound, relative to what is missing, below which a step counts as
            stalled. 5e-5 and 2e-4: within 1 % of the bounds.
        stalls: Stalled steps after which the steps become shorter. 1: 2 % more bounds; 6: a seventh
            fewer.
        falls: Factor by which they do. 0.25: a fifth fewer bounds; 0.75: a tenth fewer.
        slowest: Length of a step, relative to the first, that ends them. 0.025: 1 % more bounds;
            0.1: a fifth fewer.
        narrows: Steps in which the neighbours that take part become half as many. 3 and 12: an
            eighth fewer bounds.
        rounding: Squared error of samples of size one that is left to rounding. None and 1e-10: as
            many bounds.
    """

    proved: float = 1e-6
    samples: int = 400
    branches: int = 4_000
    few: int = 16
    root_steps: int = 60
    branch_steps: int = 25
    widest: int = 6
    moves: tuple[float, ...] = (-1.0, 1.0, -2.0, 2.0, -4.0, 4.0)
    helps: float = 1e-12
    progress: float = 1e-4
    stalls: int = 3
    falls: float = 0.5
    slowest: float = 0.05
    narrows: float = 6.0
    rounding: float = 1e-12


BRANCHES = BranchOptions()


@dataclass(order=True)
class Branch:
    """Places where each knot may lie, with what is known of the curves among them."""

    bound: float
    number: int
    levels: Levels
    multipliers: Multipliers


def proved_best(problem: Problem, start: Candidate) -> Candidate:
    """The curve of least squared error with as many segments as ``start`` and knots on samples.

    Branch and bound: places of knots through which every chain of :class:`Relaxation` costs more
    than the best curve known are struck out; the rest is halved.

    Args:
        problem: What to approximate, required knots on samples.
        start: A curve from whose knots, put on samples, the search begins.

    Returns:
        The best curve; its squared error exceeds the least possible by no more than
        ``BRANCHES.proved`` of it.

    Raises:
        SolverFailed: No proof within ``BRANCHES.branches`` halvings.
    """
    return _BranchAndBound(problem, start).best


class _BranchAndBound:
    def __init__(self, problem: Problem, start: Candidate) -> None:
        self._problem = problem
        self._relaxation = Relaxation(problem)
        self._curves = KnotsOnSamples(problem)
        knots = np.floor(start.knots + 0.5)
        knots = np.sort(np.mod(knots, problem.samples)) if problem.cyclic else knots
        self.best = self._curves.moved(knots)
        if problem.cyclic:
            knots = np.sort(np.mod(self.best.knots, problem.samples))
            self.best = self._curves.curve(knots)
        ideal = ideal_of(problem)
        if float(np.sum((ideal - problem.desired) ** 2)) < self._enough:
            self._search()

    @property
    def _enough(self) -> float:
        """A bound that proves."""
        return self.best.error * (1.0 - BRANCHES.proved) - BRANCHES.rounding

    def _search(self) -> None:
        multipliers = first_multipliers(self._problem, self.best, self._relaxation.nodes)
        root = Branch(-math.inf, 0, self._all_levels(), multipliers)
        queue, number = [root], 0
        while queue:
            branch = heapq.heappop(queue)
            if branch.bound >= self._enough:
                return
            tightened = self._tightened(
                branch, BRANCHES.root_steps if number == 0 else BRANCHES.branch_steps
            )
            if tightened is None:
                continue
            if math.prod(len(level) for level in tightened.levels) <= BRANCHES.few:
                for chain in product(*tightened.levels):
                    if self._relaxation.possible(chain):
                        self._try(chain)
                continue
            for half in halves_of(tightened.levels):
                number += 1
                if number > BRANCHES.branches:
                    gap = 1.0 - branch.bound / self.best.error
                    raise SolverFailed(
                        "exact piecewise-linear fit", f"{number} halvings", violation=gap
                    )
                heapq.heappush(queue, replace(tightened, number=number, levels=half))

    def _all_levels(self) -> Levels:
        n, size = self._problem.samples, self.best.knots.size
        if self._problem.cyclic:
            return [np.arange(t, n - size + t + 1) for t in range(size)]
        inner = [np.arange(t, n - size + t + 1) for t in range(1, size - 1)]
        return [np.array([0]), *inner, np.array([n - 1])]

    def _tightened(self, branch: Branch, steps: int) -> Branch | None:
        """The branch with better multipliers and fewer places; None if it holds nothing better."""
        levels = branch.levels
        trial = best = Multipliers(branch.multipliers.into.copy(), branch.multipliers.out.copy())
        highest, pace, stalled = -math.inf, 1.0, 0
        for step in range(steps):
            cheapest = self._relaxation.bound(levels, trial)
            if not math.isfinite(cheapest.error):
                return None
            self._try(cheapest.chain)
            if cheapest.error >= self._enough:
                return None
            stalled += cheapest.error - highest < BRANCHES.progress * (self.best.error - highest)
            if cheapest.error > highest:
                highest = cheapest.error
                best = Multipliers(trial.into.copy(), trial.out.copy())
            if stalled > BRANCHES.stalls:
                pace, stalled = BRANCHES.falls * pace, 0
            levels = [
                level[cost < self._enough]
                for level, cost in zip(levels, cheapest.through, strict=True)
            ]
            reach = pace * (self.best.error - cheapest.error)
            width = 1 + int(BRANCHES.widest / (1.0 + step / BRANCHES.narrows))
            if pace < BRANCHES.slowest or not climb(
                self._relaxation, trial, cheapest, reach, width
            ):
                break
        return Branch(highest, 0, levels, best)

    def _try(self, chain: Sequence[int]) -> None:
        """Remember the curve with these knots if it is the best so far."""
        curve = self._curves.curve(np.array(chain, dtype=np.float64))
        if curve.error < self.best.error:
            self.best = curve


def halves_of(levels: Levels) -> list[Levels]:
    """The branch cut in two at its widest level, without places that became impossible."""
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


class KnotsOnSamples:
    """Curves of best values at sets of knots on samples, each solved once."""

    def __init__(self, problem: Problem) -> None:
        """An empty store of curves."""
        self._problem = problem
        self._solved: dict[tuple[float, ...], Candidate] = {}

    def curve(self, knots: Array) -> Candidate:
        """The curve of best values at these knots."""
        return self.curves([knots])[0]

    def curves(self, several: Sequence[Array]) -> list[Candidate]:
        """The curves of best values at as many knots each."""
        keys = [tuple(np.asarray(knots, dtype=np.float64).tolist()) for knots in several]
        new = [key for key in dict.fromkeys(keys) if key not in self._solved]
        solved = best_values(self._problem, [np.array(key) for key in new])
        self._solved.update(zip(new, solved, strict=True))
        return [self._solved[key] for key in keys]

    def moved(self, knots: Array) -> Candidate:
        """The best curve reached by moving single knots and pairs of neighbours."""
        best = self.curve(knots)
        size = best.knots.size
        movable = ~required_knots(self._problem, best.knots)[0]
        groups = [[k] for k in range(size)] + [[k, (k + 1) % size] for k in range(size)]
        groups = [group for group in groups if size > 1 and np.all(movable[group])]
        improved = True
        while improved:
            improved = False
            for group in groups:
                moves = np.zeros((len(BRANCHES.moves), size))
                moves[:, group] = np.array(BRANCHES.moves)[:, None]
                tried = [each for each in best.knots + moves if self._problem.long_enough(each)]
                other = min(self.curves(tried), key=attrgetter("error"), default=best)
                if other.error < (1.0 - BRANCHES.helps) * best.error:
                    best, improved = other, True
        return best
