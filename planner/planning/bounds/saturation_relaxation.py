"""A convex relaxation of the saturated joint, and its distance from the desired angles.

Unknowns are the angles x, one a tick, and the contributions u, one for every request at every tick
at which it acts. The conditions are (8) of math.md, with chords in place of max(0, w) and
max(0, -w) between known ends of the speeds' ranges, and the hull cuts (9a). All responses whose
error is less than that of a known plan, the incumbent, lie in the set.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from planner.exceptions import InvalidInput
from planner.model.joint import JointModel
from planner.planning.bounds.hull_cuts import UNBOUNDED, HullCut, RequestSet, separate
from planner.planning.bounds.multipliers import dual_value, nearest_point
from planner.planning.bounds.reachable_set import BoundProblem, distance_from_rest, ticks_of
from planner.trajectory import Array, Indices

Intervals = dict[int, tuple[float, float]]
"""Least and greatest value of requests with a known range."""


RELAXATION_WORK, NONZERO_WORK = 1500, 3
"""Work of a relaxation with the search for cuts after it, and of each of its nonzeros."""


class ActingPairs(NamedTuple):
    """Which requests act at which ticks, one entry for every pair.

    Attributes:
        tick: The tick t, shape (m,).
        request: The request r, shape (m,).
        weight: W(r, t), shape (m,).
        following: Index of the same request's entry one tick later; -1 where there is none.
    """

    tick: Indices
    request: Indices
    weight: Array
    following: Indices


class RequestWindow(NamedTuple):
    """Ticks of one request: indices of its contributions, and of the angles they depend on."""

    contributions: Indices
    angles: Indices


class Ranges(NamedTuple):
    """Ends of every angle's and every speed's range, for responses better than the incumbent."""

    lower: Array
    upper: Array
    slowest: Array
    fastest: Array

    def copy(self) -> Ranges:
        """The same ranges, to be narrowed on their own."""
        return Ranges(*(each.copy() for each in self))

    def within(self, other: Ranges) -> Ranges:
        """Intersection of two sets of ranges."""
        return Ranges(
            np.maximum(self.lower, other.lower),
            np.minimum(self.upper, other.upper),
            np.maximum(self.slowest, other.slowest),
            np.minimum(self.fastest, other.fastest),
        )


class ScaledProblem:
    """A bound's problem in units of v_max a tick, with the common data of its relaxations.

    The joint has neither a dead band nor inertia.

    Attributes:
        gain: gamma = v_max / theta_0 [1/tick].
        excess: Excess of the top speed upwards, which is missing downwards [v_max].
        desired: D [v_max ticks], shape (n,).
        incumbent: Error of a known plan, above that of any better response [v_max ticks].
        norm: Which error.
        ticks: Number of ticks.
        sampled: Ticks at which the desired angles are compared, shape (n,).
        fixed: Known requests, such as the first one from rest with a given start.
        windows: Where each request acts.
        work: Work so far, in nonzeros of the cone programmes of tightening.
        most_work: Work at which the search stops.
    """

    def __init__(
        self, problem: BoundProblem, incumbent: float, *, most_work: float = math.inf
    ) -> None:
        """Scale the problem: the unit is the joint's largest move in a tick."""
        problem = without_load(problem)
        model, desired, cyclic, norm, start, _ = problem
        unit, middle = model.v_max_per_tick, float(np.mean(desired))
        self.unit, self.model, self.cyclic, self.norm = unit, model, cyclic, norm
        self.gain = unit / model.theta_0
        self.excess = model.v_offset / model.v_max
        self.desired = (desired - middle) / unit
        self.incumbent = incumbent / unit
        self.work, self.most_work = 0, most_work
        self.ticks = ticks_of(problem)
        self.sampled = np.arange(0, self.ticks, model.hold)
        self.start = None if start is None else (start - middle) / unit
        self.fixed: Intervals = {}
        if self.start is not None:  # the first request holds the joint there
            self.fixed = {0: (self.start, self.start)}
        self.pairs = acting_pairs(model, self.ticks, cyclic=cyclic)
        self.before = (np.arange(self.ticks) - 1) % self.ticks
        self.first = 0 if cyclic else 1  # from rest the speed at tick 0 is unknown
        counted = np.flatnonzero(self.pairs.tick >= self.first)
        order = counted[np.argsort(self.pairs.request[counted], kind="stable")]
        owner = self.pairs.request[order]
        self.windows = {
            int(self.pairs.request[group[0]]): RequestWindow(
                group, self.before[self.pairs.tick[group]]
            )
            for group in np.split(order, np.flatnonzero(np.diff(owner)) + 1)
        }

    @property
    def size(self) -> int:
        """Number of unknowns: angles and contributions."""
        return self.ticks + len(self.pairs.tick)

    @property
    def exhausted(self) -> bool:
        """Whether the allowed work is used up."""
        return self.work >= self.most_work

    @property
    def equations(self) -> int:
        """Number of equations of motion, which are the relaxation's first rows."""
        return self.ticks - self.first

    def initial_ranges(self) -> Ranges:
        """Ranges that follow from the incumbent, the top speed and the start alone."""
        farthest = self.incumbent * (np.sqrt(len(self.desired)) if self.norm == "rms" else 1.0)
        after = np.arange(self.ticks) % self.model.hold * (1.0 + abs(self.excess))
        nearest = np.repeat(self.desired, self.model.hold)[: self.ticks]
        lower, upper = nearest - farthest - after, nearest + farthest + after
        if self.start is not None:
            near = distance_from_rest(self.model, np.zeros(self.ticks), "envelope") / self.unit
            lower[: len(near)] = np.maximum(lower[: len(near)], self.start - near)
            upper[: len(near)] = np.minimum(upper[: len(near)], self.start + near)
        slowest = np.full(self.ticks, self.excess - 1.0)
        return Ranges(lower, upper, slowest, np.full(self.ticks, self.excess + 1.0))

    def requests_at(self, lower: Array, upper: Array, interval: tuple[float, float]) -> RequestSet:
        """The contributions of a request in an interval, at angles within these ends."""
        return RequestSet(self.gain, lower, upper, interval, self.excess)

    @cached_property
    def speeds(self) -> sparse.csr_array:
        """Rows w(t) = x(t) - x(t-1), from the first known speed on."""
        eye = sparse.eye_array(self.ticks, self.size, format="csr")
        moved = np.arange(self.first, self.ticks)
        return sparse.csr_array(eye[moved] - eye[self.before[moved]])

    @cached_property
    def motion(self) -> sparse.csr_array:
        """Rows w(t) - sum_r W(r, t) u(r, t), which vanish."""
        pairs, count = self.pairs, len(self.pairs.tick)
        weighted = sparse.csr_array(
            (pairs.weight, (pairs.tick, self.ticks + np.arange(count))),
            shape=(self.ticks, self.size),
        )
        return sparse.csr_array(self.speeds - weighted[self.first :])

    @cached_property
    def changes(self) -> tuple[sparse.csr_array, Indices]:
        """Rows u(r, t+1) - u(r, t), and the place of tick t among the speeds."""
        pairs = self.pairs
        pair = np.flatnonzero((pairs.following >= 0) & (pairs.tick >= self.first))
        row, ones = np.arange(len(pair)), np.ones(len(pair))
        column = self.ticks + np.concatenate([pairs.following[pair], pair])
        matrix = sparse.csr_array(
            (np.concatenate([ones, -ones]), (np.concatenate([row, row]), column)),
            shape=(len(pair), self.size),
        )
        return matrix, pairs.tick[pair] - self.first


def without_load(problem: BoundProblem) -> BoundProblem:
    """The same problem with a constant load as part of the joint's offsets.

    Raises:
        InvalidInput: The load is not constant.
    """
    if problem.load is None:
        return problem
    torque = float(problem.load[0])
    if np.any(problem.load != torque):
        raise InvalidInput(
            "level 'exact': not derived for a load that changes; use 'envelope', which holds under "
            "every load"
        )
    model = replace(
        problem.model,
        offset=float(problem.model.sag(torque)),
        v_offset=problem.model.v_offset + problem.model.speed_per_torque * torque,
    )
    return problem._replace(model=model, load=None)


def acting_pairs(model: JointModel, ticks: int, *, cyclic: bool) -> ActingPairs:
    """Every pair of a tick and a request that acts there.

    From rest, requests before the first are the first one.
    """
    window = model.window
    requests = ticks // model.hold if cyclic else (ticks - 1) // model.hold + 1
    ages = window.first + np.arange(len(window.weights))
    tick = np.repeat(np.arange(ticks), len(ages))
    number = np.floor_divide((np.arange(ticks)[:, np.newaxis] - ages).ravel(), model.hold)
    if not cyclic:
        number = np.maximum(number, 0)
    # In a short cycle a request may act twice at one tick, as sent in two cycles: one entry.
    number = number % requests
    key = tick * requests + number
    unique, inverse = np.unique(key, return_inverse=True)
    weight: Array = np.zeros(len(unique))
    np.add.at(weight, inverse, np.tile(window.weights, ticks))
    tick, number = np.divmod(unique, requests)
    later = tick + 1
    sought = (later % ticks) * requests + number
    place = np.minimum(np.searchsorted(unique, sought), len(unique) - 1)
    exists = unique[place] == sought
    if not cyclic:
        exists &= later < ticks
    return ActingPairs(tick, number, weight, np.where(exists, place, -1))


class Cut(NamedTuple):
    """A hull cut, and where its request acts."""

    window: RequestWindow
    hull: HullCut


class RelaxedSolution(NamedTuple):
    """The nearest point of a relaxation, and the bound of its multipliers for the whole set.

    Attributes:
        angles: x, shape (ticks,).
        contributions: u, shape (pairs,).
        bound: Lower bound on the error of the relaxation, by (9) [v_max ticks].
        matrix: G, shape (rows, unknowns), the equations of motion first.
        limits: b, shape (rows,).
        multipliers: lambda, shape (rows,), the multipliers of the cuts last.
        gradient: G' lambda at the samples, shape (n,).
        dual_value: The numerator of (9).
    """

    angles: Array
    contributions: Array
    bound: float
    matrix: sparse.csr_array
    limits: Array
    multipliers: Array
    gradient: Array
    dual_value: float


def conditions(
    problem: ScaledProblem, ranges: Ranges, cuts: list[Cut]
) -> tuple[sparse.csr_array, Array]:
    """The relaxation's rows ``matrix @ z <= limits``, of which the first are equations.

    max(0, -w) is convex in w, so between its values at the ends of w's range it is at most the
    chord; the chord is exact where the direction is known.
    """
    changes, at = problem.changes
    speeds = problem.speeds
    slow, fast = ranges.slowest[problem.first :], ranges.fastest[problem.first :]
    width = np.maximum(fast - slow, np.finfo(np.float64).tiny)
    back, forth = np.maximum(-slow, 0.0), np.maximum(fast, 0.0)
    # Slope and constant of the chord of max(0, -w), and of max(0, w).
    falling = (np.maximum(-fast, 0.0) - back) / width
    rising = (forth - np.maximum(slow, 0.0)) / width
    fallen, risen = back - falling * slow, forth - rising * fast
    unknowns = sparse.eye_array(problem.size, format="csr")
    angles, contributions = unknowns[: problem.ticks], unknowns[problem.ticks :]
    ones = np.ones(contributions.shape[0])
    gain = problem.gain
    rows: list[tuple[Any, Array]] = [
        (problem.motion, np.zeros(problem.equations)),
        (changes - sparse.diags_array(gain * falling[at]) @ speeds[at], gain * fallen[at]),
        (-changes - sparse.diags_array(gain * rising[at]) @ speeds[at], gain * risen[at]),
        (speeds, fast),
        (-speeds, -slow),
        (angles, ranges.upper),
        (-angles, -ranges.lower),
        (contributions, ones + problem.excess),
        (-contributions, ones - problem.excess),
    ]
    if cuts:
        rows.append((_cut_rows(problem, cuts), np.array([cut.hull.limit for cut in cuts])))
    blocks, limits = zip(*rows, strict=True)
    return sparse.csr_array(sparse.vstack(blocks)), np.concatenate(limits)


def _cut_rows(problem: ScaledProblem, cuts: list[Cut]) -> sparse.csr_array:
    """Rows nu @ u - xi @ x."""
    row = np.repeat(np.arange(len(cuts)), [2 * len(cut.window.angles) for cut in cuts])
    column = [
        np.concatenate([problem.ticks + cut.window.contributions, cut.window.angles])
        for cut in cuts
    ]
    value = [np.concatenate([cut.hull.nu, -cut.hull.xi]) for cut in cuts]
    return sparse.csr_array(
        (np.concatenate(value), (row, np.concatenate(column))), shape=(len(cuts), problem.size)
    )


def solve_relaxation(problem: ScaledProblem, ranges: Ranges, cuts: list[Cut]) -> RelaxedSolution:
    """The relaxation's nearest point, and the bound on its distance by (9)."""
    matrix, limits = conditions(problem, ranges, cuts)
    problem.work += RELAXATION_WORK + NONZERO_WORK * matrix.nnz
    answer = nearest_point(
        matrix,
        limits,
        problem.sampled,
        problem.desired,
        norm=problem.norm,
        equations=problem.equations,
    )
    angles = answer.unknowns[: problem.ticks]
    reference = np.zeros(problem.size)
    reference[: problem.ticks] = np.clip(angles, ranges.lower, ranges.upper)
    reference[problem.ticks :] = problem.excess
    # Unknowns without a desired value are anywhere in their range; contributions in excess ± 1.
    room = np.ones(problem.size)
    room[: problem.ticks] = np.maximum(
        ranges.upper - reference[: problem.ticks], reference[: problem.ticks] - ranges.lower
    )
    room[problem.sampled] = 0.0
    reference[problem.sampled] = problem.desired
    proved = dual_value(matrix, limits, answer.multipliers, reference, room)
    gradient = proved.gradient[problem.sampled]
    return RelaxedSolution(
        angles=angles,
        contributions=answer.unknowns[problem.ticks :],
        bound=_distance(problem, proved.value, gradient),
        matrix=matrix,
        limits=limits,
        multipliers=answer.multipliers,
        gradient=gradient,
        dual_value=proved.value,
    )


def _distance(problem: ScaledProblem, value: float, gradient: Array) -> float:
    """The right-hand side of (9) as an error in the problem's norm."""
    if value <= 0.0:
        return 0.0
    size = float(np.linalg.norm(gradient, 2 if problem.norm == "rms" else 1))
    if size == 0.0:  # a certificate of infeasibility: the relaxation is empty
        return math.inf
    return value / size / (math.sqrt(len(problem.desired)) if problem.norm == "rms" else 1.0)


def violated_cuts(
    problem: ScaledProblem, ranges: Ranges, solution: RelaxedSolution, intervals: Intervals
) -> list[Cut]:
    """A cut for every request whose contributions lie outside of its hull."""
    new_cuts = []
    for request, window in problem.windows.items():
        requests = problem.requests_at(
            ranges.lower[window.angles],
            ranges.upper[window.angles],
            intervals.get(request, UNBOUNDED),
        )
        hull = separate(
            solution.contributions[window.contributions], solution.angles[window.angles], requests
        )
        if hull is not None:
            new_cuts.append(Cut(window, hull))
    return new_cuts
