"""The proved optimum with knots on samples: branch and bound on a Lagrangian relaxation.

Level s holds the places where knot s may lie. The condition that two segments meet is replaced by a
Lagrange multiplier on their difference ((5b) of docs/math.md): for any multipliers the cheapest
chain is a lower bound. Places through which every chain costs more than the best curve known are
struck out; the rest is halved.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from planner.approximation.fit_problem import Candidate, Problem, nearest_samples, residuals
from planner.approximation.values import best_values, ideal_of
from planner.arrays import Array, Indices
from planner.exceptions import SolverFailed

Levels = list[Indices]

PROVED = 1e-6  # relative gap between the squared error and its lower bound that ends the search

MOST_SAMPLES = 400
"""Samples up to which the optimum is proved: memory and time grow with their square, of a cycle
their cube at the first bound."""

MOST_BRANCHES = 4_000  # halves that are looked at before the search gives up


def proved_best(problem: Problem, start: Candidate) -> Candidate:
    """The curve of least squared error with as many segments as ``start`` and knots on samples.

    Required knots lie on samples. The squared error exceeds the least possible by no more than
    :data:`PROVED` of it. Raises SolverFailed without a proof within :data:`MOST_BRANCHES` halvings.
    """
    n, knots = problem.samples, np.floor(start.knots + 0.5)
    knots = np.sort(np.mod(knots, n)) if problem.cyclic else knots
    search = Relaxation(problem, best_values(problem, knots))
    if float(np.sum((ideal_of(problem) - problem.desired) ** 2)) >= search.enough:
        return search.best
    levels = [np.arange(t, n - knots.size + t + 1) for t in range(knots.size)]
    if not problem.cyclic:
        levels[0], levels[-1] = np.array([0]), np.array([n - 1])
    number = 0
    # Multipliers that make the curve the cheapest chain with its own knots: of an optimal segment,
    # twice the sum of its residuals is the multiplier at its start less that at its end.
    residual = residuals(problem, search.best.knots, search.best.values)
    along = np.cumsum(residual) - 0.5 * residual
    along -= np.mean(along) if problem.cyclic else along * np.isin(np.arange(n), [0, n - 1])
    first = np.tile(-2.0 * along, (2, knots.size, 1))
    queue = [(-math.inf, number, levels, first)]
    while queue and queue[0][0] < search.enough:
        _, order, levels, multipliers = heapq.heappop(queue)
        tightened = search.tightened(levels, multipliers, 18 if order else 60)
        if tightened is None:
            continue
        bound, levels, multipliers = tightened
        if all(level.size == 1 for level in levels):
            continue
        for half in halves_of(levels):
            number += 1
            if number > MOST_BRANCHES:
                gap = 1.0 - bound / search.best.error
                raise SolverFailed(
                    "exact piecewise-linear fit", f"{number} halvings", violation=gap
                )
            heapq.heappush(queue, (bound, number, half, multipliers))
    return search.best


def halves_of(levels: Levels) -> list[Levels]:
    """The branch cut in two at its widest level, without places that became impossible."""
    widest = int(np.argmax([level.size for level in levels]))
    middle = levels[widest].size // 2
    halves = []
    for part in np.split(levels[widest], [middle]):
        half = [*levels[:widest], part, *levels[widest + 1 :]]
        for t in range(1, len(half)):
            half[t] = half[t][half[t] > half[t - 1][0]] if half[t - 1].size else half[t - 1]
        for t in range(len(half) - 2, -1, -1):
            half[t] = half[t][half[t] < half[t + 1][-1]] if half[t + 1].size else half[t + 1]
        if all(level.size for level in half):
            halves.append(half)
    return halves


class Relaxation:
    """All segments between samples, with the sums from which their costs follow; the best curve.

    Multipliers have the shape (2, levels, n): of the ends of segments and of the starts, the same
    except at pins.
    """

    def __init__(self, problem: Problem, best: Candidate) -> None:
        """Sum the samples of all segments, those at their ends by half."""
        self.problem, self.best, self._tried = problem, best, set[tuple[int, ...]]()
        n = problem.samples
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
        first, last = np.full((count, 1), 0.5), np.full((1, count), 0.5)
        if not problem.cyclic:
            first[0], last[0, -1] = 1.0, 0.0
        nodes = nearest_samples(problem.required) % n
        possible = span >= 1.0
        for place in np.append(nodes, nodes + n):  # no required knot inside
            possible &= (place <= start) | (place >= end)
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
        self.pins[nodes] = problem.pins

    @property
    def enough(self) -> float:
        """A bound that proves."""
        return self.best.error * (1.0 - PROVED) - 1e-12

    def tightened(
        self, levels: Levels, multipliers: Array, steps: int
    ) -> tuple[float, Levels, Array] | None:
        """A bound, fewer places and better multipliers; None if they hold nothing better."""
        trial = best = multipliers
        highest, pace, stalled = -math.inf, 1.0, 0
        for _ in range(steps):
            bound, chain, through = self.bound(levels, trial)
            if not math.isfinite(bound):
                return None
            if tuple(chain) not in self._tried:
                self._tried.add(tuple(chain))
                curve = best_values(self.problem, np.array(chain, dtype=np.float64))
                self.best = curve if curve.error < self.best.error else self.best
            if bound >= self.enough:
                return None
            stalled += bound - highest < 1e-4 * (self.best.error - highest)
            if bound > highest:
                highest, best = bound, trial
            if stalled > 3:
                pace, stalled = 0.5 * pace, 0
            pairs = zip(levels, through, strict=True)
            levels = [level[cost < self.enough] for level, cost in pairs]
            slopes = self.differences(chain, trial)
            square = float(np.sum(slopes**2))
            if pace < 0.05 or square < 1e-20:  # the segments meet: as high as can be
                break
            # Polyak's step upwards, which the neighbours of each knot share.
            near = np.where(np.isfinite(self.pins[chain]), 1, 3)[:, np.newaxis]
            away = np.abs(np.arange(self.pins.size) - np.array(chain)[:, np.newaxis])
            if self.problem.cyclic:
                away = np.minimum(away, self.pins.size - away)
            reach = 2.0 * pace * (self.best.error - bound) / square
            trial = trial + reach * slopes[:, :, np.newaxis] * np.maximum(0.0, 1.0 - away / near)
        return highest, levels, best

    def lines(self, i: Indices, j: Indices, pi_i: Array, pi_j: Array) -> tuple[Array, Array, Array]:
        """Least costs of segments from ``i`` to ``j`` with multipliers at their ends: (5b).

        And the values of these lines at ``i`` and ``j``.
        """
        rise, step = pi_j - pi_i, self.problem.step
        tilt = pi_j * self.length[i, j] - rise * self.centre[i, j]
        slope = self.slope[i, j] - tilt / (2.0 * self.sxx[i, j])
        slope = np.minimum(np.maximum(slope, -step), step)
        error = self.error[i, j] + rise * self.mean[i, j] - rise * rise / (4.0 * self.w0[i, j])
        error += self.sxx[i, j] * (slope - self.slope[i, j]) ** 2 + tilt * slope
        start = self.mean[i, j] - rise / (2.0 * self.w0[i, j]) - slope * self.centre[i, j]
        return error, start, start + slope * self.length[i, j]

    def bound(self, levels: Levels, multipliers: Array) -> tuple[float, list[int], list[Array]]:
        """Cost and knots of the cheapest chain, and costs of the cheapest through each place."""
        into, out = multipliers
        last, pin = len(levels) - 1, np.nan_to_num(self.pins)
        tables = []
        for t in range(last + self.problem.cyclic):
            u = (t + 1) % (last + 1)
            i, j = levels[t][:, None], levels[u][None, :]
            table, _, _ = self.lines(
                i, j + (self.problem.samples if u == 0 else 0), out[t, i], into[u, j]
            )
            tables.append(table + pin[j] * (out[u, j] - into[u, j]))
        if not self.problem.cyclic:
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
        return float(total[first, end]), chain, by_level[::-1]

    def differences(self, chain: list[int], multipliers: Array) -> Array:
        """Slopes of the bound by the multipliers at the knots of its chain, (2, levels)."""
        into, out = multipliers
        size, n = len(chain), self.problem.samples
        own, arriving, leaving = np.array(chain), np.zeros(size), np.zeros(size)
        t = np.arange(size if self.problem.cyclic else size - 1)
        u = (t + 1) % size
        i, j = own[t], own[u] + n * (own[u] <= own[t])
        _, leaving[t], arriving[u] = self.lines(i, j, out[t, i], into[u, own[u]])
        pins = self.pins[own]
        pinned = np.isfinite(pins)
        by_into = np.where(pinned, arriving - pins, arriving - leaving)
        by_out = np.where(pinned, pins - leaving, arriving - leaving)
        if not self.problem.cyclic:
            by_into[0] = by_out[-1] = 0.0
            by_out[0] *= pinned[0]
            by_into[-1] *= pinned[-1]
        return np.stack([by_into, by_out])
