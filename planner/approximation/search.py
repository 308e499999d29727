"""The best curve found for each number of segments."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from planner.approximation.around import ROUGH, around
from planner.approximation.corners import exact_curve
from planner.approximation.descent import LARGEST_WINDOW, best_values, descend
from planner.approximation.ideal import ideal_of
from planner.approximation.knots import KnotProposals
from planner.approximation.merging import MergedKnots
from planner.approximation.nudged import settled_in_hollows
from planner.approximation.objective import Candidate, Problem, candidate
from planner.approximation.pose import Pose
from planner.approximation.repair import within_slopes
from planner.approximation.requirements import at_rest, gaps, spread
from planner.approximation.thinned import in_full, thinned
from planner.approximation.together import all_best_values, descend_all
from planner.approximation.values import solve_values
from planner.approximation.whole import WholeKnots
from planner.trajectory import Array

RESOLUTION = 2.0**-36
"""Samples and slope are searched as multiples of this; the last QP takes them as they are."""

EXACT_KNOTS = 2.0**32
"""Knots are multiples of its inverse [samples]."""

FIRST_ROUNDS = 4
"""Evaluations after which the most promising of several descents goes on alone."""

ROUNDS = 15
"""Most further evaluations of that one."""

DESCENTS = 2
"""Starts of many segments, of all that are proposed, from which a descent is begun."""

WORTH_LOOKING = 1.002
"""Squared error over the ideal from which on more is tried around a curve."""

MANY_SAMPLES = 2000
"""Samples beyond which few knots are sought among means of them."""

MOST_PROPOSED = 32
"""Segments up to which knots are sought by shortest paths; beyond, by merging."""

BY_ERROR = attrgetter("error")  # how curves are ordered


class Search:
    """Curves of any number of segments through the same samples, each found once.

    The samples are searched in a pose and at a resolution of their own, so that shifted, mirrored,
    reversed and scaled ones give the same curve in spite of rounding.
    """

    def __init__(self, given: Problem) -> None:
        """Find the ideal and the pose.

        Args:
            given: What to approximate, samples of size one.
        """
        mantissa, exponent = math.frexp(given.step)
        coarse = replace(
            given,
            desired=np.round(given.desired / RESOLUTION) * RESOLUTION,
            step=math.ldexp(math.floor(mantissa / RESOLUTION) * RESOLUTION, exponent),
        )
        ideal = ideal_of(coarse)
        self.pose = Pose.of(coarse.desired, ideal, cyclic=given.cyclic)
        self.problem = self.pose.of_problem(coarse)
        self.ideal = np.round(self.pose.apply(ideal) / RESOLUTION) * RESOLUTION
        self.given = self.pose.of_problem(given)
        self._found: dict[int, Candidate] = {}

    @property
    def fewest(self) -> int:
        """Least number of segments of a curve that is not a constant."""
        return max(2 if self.problem.cyclic else 1, gaps(self.problem)[1].size)

    @property
    def most(self) -> int:
        """Most segments that the samples and the shortest segment allow."""
        return int(np.sum(gaps(self.problem)[1]))

    @cached_property
    def ideal_error(self) -> float:
        """Squared error of the ideal: no curve within the slopes has less."""
        return float(self.problem.weights @ (self.ideal - self.problem.desired) ** 2)

    def curve(self, segments: int) -> Candidate:
        """The best curve found with this number of segments."""
        if segments not in self._found:
            curve = self._improve(segments)
            if self.problem.whole and segments <= LARGEST_WINDOW:
                curve = min(curve, self._whole.nudged(curve.knots), key=BY_ERROR)
            self._found[segments] = curve
        return self._found[segments]

    def settled(self, curve: Candidate) -> tuple[Array, Array]:
        """Knots and values for the samples as given: the last QP in the values, solved by OSQP."""
        # Powers of two, so that sums and differences of knots are exact.
        knots = np.round(curve.knots * EXACT_KNOTS) / EXACT_KNOTS
        values = solve_values(self.given, knots, near=curve.values)
        return self.pose.restore(Candidate(knots, values, curve.error))

    @cached_property
    def exact(self) -> Candidate | None:
        """The curve on which the samples lie, if there is one."""
        return exact_curve(self.given)

    @cached_property
    def _thin(self) -> Search | None:
        """Curves through fewer samples, where there are very many and any knots will do."""
        problem = self.problem
        if problem.samples <= MANY_SAMPLES or not problem.anywhere:
            return None
        return Search(thinned(problem))

    @cached_property
    def _propose(self) -> KnotProposals:
        return KnotProposals(self.problem, self.ideal)

    @cached_property
    def _whole(self) -> WholeKnots:
        return WholeKnots(self.problem)

    @cached_property
    def _merged(self) -> MergedKnots:
        return MergedKnots(replace(self.problem, desired=self.ideal))

    def _improve(self, segments: int) -> Candidate:
        """Descend all the way from the best rough curve, and look around it where that may help."""
        if segments > MOST_PROPOSED:
            merged = self._merged(segments)
            merged = spread(self.problem, segments) if merged is None else merged
            return descend(self.problem, self.valued(merged), rounds=FIRST_ROUNDS)
        rough = self._begin(segments)
        best = rough[0]
        if segments > LARGEST_WINDOW or best.error <= self._nothing_to_gain:
            return best
        if self._thin is not None:
            return descend(self.problem, best, rounds=ROUNDS)
        if best.error > self._good_enough:
            best = around(self.problem, self.ideal, rough)
        return settled_in_hollows(self.problem, best, rounds=ROUNDS)

    def _begin(self, segments: int) -> list[Candidate]:
        """Curves a few rounds from what is proposed, the best first."""
        if self.exact is not None and segments == self._count(self.exact):
            return [self.exact]
        if self._thin is not None and segments < LARGEST_WINDOW:
            few = self._thin.pose.restore(self._thin.curve(segments))
            return [descend(self.problem, in_full(self.problem, *few), rounds=FIRST_ROUNDS)]
        proposed = self._propose(segments) or [spread(self.problem, segments)]
        if proposed[0].size > LARGEST_WINDOW:
            starts = sorted(map(self.valued, proposed), key=BY_ERROR)[:DESCENTS]
            begun = [descend(self.problem, curve, rounds=FIRST_ROUNDS) for curve in starts]
            return [descend(self.problem, min(begun, key=BY_ERROR), rounds=ROUNDS)]
        starts = all_best_values(self.problem, proposed)
        return sorted(
            descend_all(self.problem, starts, rounds=FIRST_ROUNDS, progress=ROUGH), key=BY_ERROR
        )

    @property
    def _good_enough(self) -> float:
        """Squared error from which on more effort could gain too little to be worth it."""
        return WORTH_LOOKING * self.ideal_error

    @property
    def _nothing_to_gain(self) -> float:
        return max(1e-22 * self.problem.samples, (1.0 + 1e-6) * self.ideal_error)

    def _count(self, curve: Candidate) -> int:
        return curve.knots.size if self.problem.cyclic else curve.knots.size - 1

    def valued(self, knots: Array) -> Candidate:
        """The curve of best values at these knots."""
        if knots.size > LARGEST_WINDOW:
            end = [knots[0] + self.problem.samples] if self.problem.cyclic else []
            values = within_slopes(
                solve_values(self.problem, knots),
                self.problem.step * np.diff(np.append(knots, end)),
                cyclic=self.problem.cyclic,
                towards=at_rest(self.problem, knots) if self.problem.required.size else None,
            )
            return candidate(self.problem, knots, values)
        return best_values(self.problem, knots)
