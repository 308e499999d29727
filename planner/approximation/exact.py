"""The proved optimum with knots on samples: branch and bound on a Lagrangian relaxation.

Level s holds the places where knot s may lie. The condition that two segments meet is replaced by a
Lagrange multiplier pi on their difference: a segment from i to j costs the squared error of its
samples, plus pi_j times its end, less pi_i times its start ((5b) of docs/math.md). Where the
segments meet, these terms cancel; so for any multipliers the cheapest chain is a lower bound, and
the better the multipliers the higher it is. The line of least cost between two knots has a closed
form, as centre and slope are independent of each other. Places of knots through which every chain
costs more than the best curve known are struck out; the rest is halved.

Of the numbers of the method none changes an answer; half and twice each change the bounds that are
computed by a quarter at most.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.problem import (
    Candidate,
    Problem,
    nearest_samples,
    residuals,
    segment_allowed,
)
from planner.approximation.values import best_values, ideal_of
from planner.exceptions import SolverFailed
from planner.trajectory import Array

Levels = list[npt.NDArray[np.intp]]

PROVED = 1e-6
"""Relative gap between the squared error and its lower bound that ends the search."""

MOST_SAMPLES = 400
"""Samples up to which the optimum is proved: memory grows with their square, of a cycle their cube
at the first bound."""

MOST_BRANCHES = 4_000
"""Halves that are looked at before the search gives up."""


def proved_best(problem: Problem, start: Candidate) -> Candidate:
    """The curve of least squared error with as many segments as ``start`` and knots on samples.

    Branch and bound: places of knots through which every chain of :class:`Relaxation` costs more
    than the best curve known are struck out; the rest is halved.

    Args:
        problem: The approximation problem, required knots on samples.
        start: A curve from whose knots, put on samples, the search begins.

    Returns:
        The best curve; its squared error exceeds the least possible by no more than
        :data:`PROVED` of it.

    Raises:
        SolverFailed: No proof within :data:`MOST_BRANCHES` halvings.
    """
    return _BranchAndBound(problem, start).best


class Multipliers(NamedTuple):
    """Of the ends and of the starts of segments; the same except at pins."""

    into: Array  # (levels, n)
    out: Array  # (levels, n)


@dataclass(order=True)
class Branch:
    """Places where each knot may lie, with bounds on the curves among them."""

    bound: float
    number: int
    levels: Levels
    multipliers: Multipliers


class _BranchAndBound:
    def __init__(self, problem: Problem, start: Candidate) -> None:
        self._problem = problem
        self._relaxation = Relaxation(problem)
        self._tried: set[tuple[int, ...]] = set()
        knots = np.floor(start.knots + 0.5)
        knots = np.sort(np.mod(knots, problem.samples)) if problem.cyclic else knots
        self.best = best_values(problem, knots)
        ideal = ideal_of(problem)
        if float(np.sum((ideal - problem.desired) ** 2)) < self._enough:
            self._search()

    @property
    def _enough(self) -> float:
        """A bound that proves."""
        return self.best.error * (1.0 - PROVED) - 1e-12

    def _search(self) -> None:
        multipliers = first_multipliers(self._problem, self.best)
        root = Branch(-math.inf, 0, self._all_levels(), multipliers)
        queue, number = [root], 0
        while queue:
            branch = heapq.heappop(queue)
            if branch.bound >= self._enough:
                return
            tightened = self._tightened(branch, 60 if number == 0 else 25)
            if tightened is None:
                continue
            if math.prod(len(level) for level in tightened.levels) <= 16:
                for chain in product(*tightened.levels):
                    if self._relaxation.possible(chain):
                        self._try(chain)
                continue
            for half in halves_of(tightened.levels):
                number += 1
                if number > MOST_BRANCHES:
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
            stalled += cheapest.error - highest < 1e-4 * (self.best.error - highest)
            if cheapest.error > highest:
                highest = cheapest.error
                best = Multipliers(trial.into.copy(), trial.out.copy())
            if stalled > 3:
                pace, stalled = 0.5 * pace, 0
            levels = [
                level[cost < self._enough]
                for level, cost in zip(levels, cheapest.through, strict=True)
            ]
            reach = pace * (self.best.error - cheapest.error)
            width = 1 + int(6 / (1.0 + step / 6.0))
            if pace < 0.05 or not climb(self._relaxation, trial, cheapest, reach, width):
                break
        return Branch(highest, 0, levels, best)

    def _try(self, chain: Sequence[int]) -> None:
        """Remember the curve with these knots if it is the best so far."""
        if tuple(chain) not in self._tried:
            self._tried.add(tuple(chain))
            curve = best_values(self._problem, np.array(chain, dtype=np.float64))
            self.best = min(self.best, curve, key=attrgetter("error"))


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


class Bound(NamedTuple):
    """The cheapest chain."""

    error: float
    chain: list[int]  # knots, one of every level
    through: list[Array]  # cost of the cheapest chain through each place of each level


class Relaxation:
    """All segments between samples, with the sums from which their costs follow."""

    def __init__(self, problem: Problem) -> None:
        """Sum the samples of all segments, those at their ends by half."""
        n = self.samples = problem.samples
        self.cyclic, self.step = problem.cyclic, problem.step
        count = 2 * n if problem.cyclic else n
        desired = np.resize(problem.desired, count)
        start, end = np.arange(count)[:, None], np.arange(count)[None, :]
        # Over the samples after the start up to the end, with k = 0 at the start.
        k = np.arange(count, dtype=np.float64)
        w1, w2, d0, d1, d2 = (
            total[end] - total[start]
            for total in map(np.cumsum, (k, k * k, desired, k * desired, desired * desired))
        )
        span = (end - start).astype(np.float64)
        w2 = w2 - start * (2.0 * w1 - start * span)
        w1, d1 = w1 - start * span, d1 - start * d0
        first, last = np.full(count, 0.5), np.full(count, 0.5)
        if not problem.cyclic:
            first[0], last[-1] = 1.0, 0.0
        first, last = first[:, None], last[None, :]
        possible = segment_allowed(problem, start, end)
        d_i, d_j = desired[start], desired[end]
        w0 = np.where(possible, span + first - last, 1.0)
        self.centre = (w1 - last * span) / w0
        self.mean = (d0 + first * d_i - last * d_j) / w0
        sxx = w2 - last * span**2 - w0 * self.centre**2
        self.sxx = np.where(possible, np.maximum(sxx, 1e-12), 1.0)
        sxd = d1 - last * span * d_j - w0 * self.centre * self.mean
        self.slope = sxd / self.sxx
        square = d2 + first * d_i**2 - last * d_j**2
        error = square - w0 * self.mean**2 - self.slope * sxd
        self.error = np.where(possible, np.maximum(error, 0.0), np.inf)
        self.w0, self.length = w0, span
        self.pins = np.full(n, np.nan)
        self.pins[nearest_samples(problem.required) % n] = problem.pins

    def costs(
        self, i: npt.NDArray[np.intp], j: npt.NDArray[np.intp], pi_i: Array, pi_j: Array
    ) -> Array:
        """Least costs of segments from ``i`` to ``j``, whose ends have these multipliers: (5b)."""
        rise, tilt, slope = self._lines(i, j, pi_i, pi_j)
        error = self.error[i, j] + rise * self.mean[i, j] - rise * rise / (4.0 * self.w0[i, j])
        error += self.sxx[i, j] * (slope - self.slope[i, j]) ** 2 + tilt * slope
        return np.asarray(error)

    def possible(self, chain: Sequence[int]) -> bool:
        """Whether these knots are in order, none too close, and no required one between them."""
        ends = [*chain, chain[0] + self.samples] if self.cyclic else list(chain)
        return bool(np.all(np.isfinite(self.error[ends[:-1], ends[1:]])))

    def ends(self, i: int, j: int, pi_i: float, pi_j: float) -> tuple[float, float]:
        """Values of the cheapest line at ``i`` and ``j``."""
        rise, _, slope = self._lines(i, j, pi_i, pi_j)
        middle = self.mean[i, j] - rise / (2.0 * self.w0[i, j])
        start = middle - slope * self.centre[i, j]
        return float(start), float(start + slope * self.length[i, j])

    def _lines(
        self, i: object, j: object, pi_i: object, pi_j: object
    ) -> tuple[Array, Array, Array]:
        """Terms of the multipliers in centre and slope, and the best slope."""
        at: tuple[object, object] = (i, j)
        centre = self.centre[at]  # type: ignore[index]
        rise = pi_j - pi_i  # type: ignore[operator]
        tilt = pi_j * self.length[at] - rise * centre  # type: ignore[operator, index]
        slope = self.slope[at] - tilt / (2.0 * self.sxx[at])  # type: ignore[index]
        return rise, tilt, np.minimum(np.maximum(slope, -self.step), self.step)

    def bound(self, levels: Levels, multipliers: Multipliers) -> Bound:
        """The cheapest chain with one knot of every level; O(levels · places²), of a cycle ³."""
        into, out = multipliers
        tables = []
        last = len(levels) - 1
        pin = np.nan_to_num(self.pins)
        steps = [(t, t + 1, 0) for t in range(last)]
        if self.cyclic:
            steps.append((last, 0, self.samples))
        for t, u, turn in steps:
            i, j = levels[t][:, None], levels[u][None, :]
            table = self.costs(i, j + turn, out[t, i], into[u, j])
            tables.append(table + pin[j] * (out[u, j] - into[u, j]))
        if not self.cyclic:
            tables[0] = tables[0] + pin[0] * (out[0, 0] - into[0, 0])
            tables.append(np.zeros((1, 1)))
        # costs[t][a, b]: cheapest way from place a of level 0 to place b of level t + 1.
        costs, came_from = [tables[0]], []
        for table in tables[1:-1]:
            through = costs[-1][:, :, None] + table[None, :, :]
            best = np.argmin(through, axis=1)
            came_from.append(best)
            costs.append(np.take_along_axis(through, best[:, None, :], axis=1)[:, 0, :])
        total = costs[-1] + tables[-1].T
        first, end = np.unravel_index(int(np.argmin(total)), total.shape)
        places = [int(end)]
        for best in reversed(came_from):
            places.append(int(best[first, places[-1]]))
        places.append(int(first))
        chain = [int(level[a]) for level, a in zip(levels, reversed(places), strict=True)]
        back, by_level = tables[-1].T, [total.min(axis=0)]
        for t in range(last - 1, 0, -1):
            back = (tables[t][None, :, :] + back[:, None, :]).min(axis=2)
            by_level.append((costs[t - 1] + back).min(axis=0))
        by_level.append(total.min(axis=1))
        return Bound(float(total[first, end]), chain, by_level[::-1])

    def differences(self, chain: list[int], multipliers: Multipliers) -> tuple[Array, Array]:
        """Slopes of the bound by the multipliers at the knots of its chain: into, out."""
        into, out = multipliers
        size, n = len(chain), self.samples
        arriving, leaving = np.zeros(size), np.zeros(size)
        own = [node % n for node in chain]
        for t in range(size if self.cyclic else size - 1):
            u = (t + 1) % size
            i, j = own[t], own[u] + n * (own[u] <= own[t])
            leaving[t], arriving[u] = self.ends(i, j, out[t, i], into[u, own[u]])
        pins = self.pins[own]
        pinned = np.isfinite(pins)
        by_into = np.where(pinned, arriving - pins, arriving - leaving)
        by_out = np.where(pinned, pins - leaving, arriving - leaving)
        if not self.cyclic:
            by_into[0] = by_out[-1] = 0.0
            if not pinned[0]:
                by_out[0] = 0.0
            if not pinned[-1]:
                by_into[-1] = 0.0
        return by_into, by_out


def first_multipliers(problem: Problem, curve: Candidate) -> Multipliers:
    """The multipliers that make ``curve`` the cheapest chain with its own knots.

    A segment is optimal if twice the sum of its residuals, P - d, equals the multiplier at its
    start less that at its end. This leaves the mean of a cycle's open, which is put to zero.
    """
    residual = residuals(problem, curve.knots, curve.values)
    along = -2.0 * (np.cumsum(residual) - 0.5 * residual)
    if problem.cyclic:
        along -= np.mean(along)
    else:
        along[[0, -1]] = 0.0
    table = np.tile(along, (curve.knots.size, 1))
    return Multipliers(table, table.copy())


def climb(
    relaxation: Relaxation, multipliers: Multipliers, cheapest: Bound, reach: float, width: int
) -> bool:
    """Move the multipliers up by a step of Polyak's, in place.

    Args:
        relaxation: The relaxation.
        multipliers: Multipliers to improve.
        cheapest: The cheapest chain under them.
        reach: How much higher the bound should become.
        width: Neighbours of a knot that take part of its step [samples].

    Returns:
        False if the chain's segments meet: the bound is as high as can be.
    """
    by_into, by_out = relaxation.differences(cheapest.chain, multipliers)
    square = float(by_into @ by_into + by_out @ by_out)
    if square < 1e-20:
        return False
    step = 2.0 * reach / square
    n = relaxation.samples
    for t, knot in enumerate(cheapest.chain):
        away = np.abs(np.arange(n) - knot % n)
        if relaxation.cyclic:
            away = np.minimum(away, n - away)
        pinned = np.isfinite(relaxation.pins[knot % n])
        near = np.maximum(0.0, 1.0 - away / (1 if pinned else width))
        multipliers.into[t] += step * by_into[t] * near
        multipliers.out[t] += step * by_out[t] * near
    return True
