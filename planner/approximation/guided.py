"""Knots from the relaxation of a curve: cheapest once each segment pays for its mismatch.

The prices of :mod:`planner.approximation.knots` do not know how segments meet; here potentials
taken from a good curve do, so the cheapest chain improves on it where whole sets of knots must move
at once.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from planner.approximation.descent import best_values
from planner.approximation.objective import Candidate, Problem
from planner.approximation.potentials import first_potentials
from planner.approximation.relaxation import Potentials, Relaxation
from planner.approximation.requirements import gaps, grid_of, in_place, nodes_of
from planner.trajectory import Array

GRID_OF_PATH, GRID_OF_CYCLE = 96, 64
"""Most nodes: a chain takes their number squared, for every start of a cycle."""

SHARPEST = 12
"""Samples with the largest second differences that are nodes in any case."""

STARTS = 12
"""Nodes of a cycle at which chains may begin: around its sharpest corner."""

STEPS = 5
"""Chains that are looked at."""

WIDTH = 4
"""Neighbours of a knot that learn from its mismatch [nodes]."""


class GuidedKnots:
    """Knots near those of any curve through the same samples, or far from them but better."""

    def __init__(self, problem: Problem) -> None:
        """Sum the samples between the nodes."""
        self._problem = problem
        last = problem.samples if problem.cyclic else problem.samples - 1
        most = GRID_OF_CYCLE if problem.cyclic else GRID_OF_PATH
        nodes = grid_of(problem, last, min(last, most))
        if nodes.size <= last:
            d = problem.desired
            bend = np.abs(np.roll(d, 1) - 2.0 * d + np.roll(d, -1))
            if not problem.cyclic:
                bend[[0, -1]] = 0.0
            nodes = np.union1d(nodes, np.argsort(-bend, kind="stable")[:SHARPEST])
        self._relaxation = Relaxation(problem, nodes[:-1] if problem.cyclic else nodes)

    def __call__(self, curve: Candidate, sharpest: float) -> Candidate | None:
        """The best curve among those with the knots of the cheapest chains; None if there is none.

        Args:
            curve: Whose potentials to begin with; its values are best for its knots.
            sharpest: The knot around which a cycle's chains begin [samples].
        """
        relaxation, problem = self._relaxation, self._problem
        size, count = curve.knots.size, relaxation.nodes.size
        if size > count or gaps(problem)[1].size > size:
            return None
        into, out = (table[0] for table in first_potentials(problem, curve, relaxation.nodes))
        starts = self._starts(sharpest)
        tried: dict[tuple[int, ...], Candidate] = {}
        for _ in range(STEPS):
            error, chain = self._cheapest(into, out, starts, size)
            if not math.isfinite(error):
                break
            key = tuple(chain)
            knots = in_place(problem, relaxation.places(chain))
            if key not in tried and knots is not None:
                tried[key] = best_values(problem, knots)
            tables = np.broadcast_to(into, (size, count)), np.broadcast_to(out, (size, count))
            by_into, by_out = relaxation.mismatches(chain, Potentials(*tables))
            square = float(by_into @ by_into + by_out @ by_out)
            if error >= curve.error or square < 1e-20:
                break
            step = 2.0 * (curve.error - error) / square
            for t, knot in enumerate(chain):
                near = relaxation.around(knot, WIDTH)
                into = into + step * by_into[t] * near
                out = out + step * by_out[t] * near
        return min(tried.values(), key=lambda other: other.error, default=None)

    def _starts(self, sharpest: float) -> npt.NDArray[np.intp]:
        """Nodes at which chains may begin."""
        nodes, n = self._relaxation.nodes, self._problem.samples
        if not self._problem.cyclic:
            return np.array([0])
        if self._problem.required.size:
            return np.searchsorted(nodes, nodes_of(self._problem.required) % n)[:1]
        away = np.abs(nodes - sharpest % n)
        return np.sort(np.argsort(np.minimum(away, n - away), kind="stable")[:STARTS])

    def _cheapest(
        self, into: Array, out: Array, starts: npt.NDArray[np.intp], size: int
    ) -> tuple[float, list[int]]:
        """Cost and nodes of the cheapest chain from one of the starts, O(size · starts · m²)."""
        relaxation = self._relaxation
        count = relaxation.nodes.size
        pins = np.nan_to_num(relaxation.pins) * (out - into)
        turns = 2 if relaxation.cyclic else 1
        i, j = np.arange(turns * count)[:, None], np.arange(turns * count)[None, :]
        table = relaxation.prices(i, j, np.tile(out, turns)[i], np.tile(into, turns)[j])
        table += np.tile(pins, turns)
        ways = np.stack([table[a : a + count, a : a + count] for a in starts])
        ends = np.stack([table[a : a + count, a + count] for a in starts]) if turns == 2 else None
        segments = size if turns == 2 else size - 1
        cost = np.full((starts.size, count), np.inf)
        cost[:, 0] = 0.0 if turns == 2 else pins[0]
        came_from = []
        for _ in range(segments - (turns == 2)):
            through = cost[:, :, None] + ways
            best = np.argmin(through, axis=1)
            came_from.append(best)
            cost = np.take_along_axis(through, best[:, None, :], axis=1)[:, 0, :]
        total = cost[:, -1:] if ends is None else cost + ends
        first, end = np.unravel_index(int(np.argmin(total)), total.shape)
        places = [int(end) if turns == 2 else count - 1]
        for best in reversed(came_from):
            places.append(int(best[first, places[-1]]))
        chain = [int(starts[first]) + place for place in reversed(places)]
        return float(total[first, end]), chain
