"""A convex relaxation of the saturated joint, and its distance from the desired angles.

Unknowns are the angles x, one a tick, and the contributions u, one for every request at every tick
at which it acts. The conditions are (8) of math.md, with chords in place of max(0, w) and
max(0, -w) between known ends of the speeds' ranges, and the hull cuts (9a). All responses whose
error is less than that of a known plan, the incumbent, lie in the set.

In units of v_max a tick, a request y (with the joint's offset) contributes u(t) = f(y - x(t)) to
the speed at tick t, where x(t) is the angle before it: with equal speeds in both directions
clip(gamma (y - x(t)), -1, 1) with gamma = v_max / theta_0. A hull cut
``nu @ u - xi @ x <= limit`` holds for every y, and for every x within ranges, if its limit is the
support function of that set, which is known in closed form. The cut to add is found as in
disjunctive programming (Balas 1979): the nearest point of the hull is sought by nonnegative least
squares (Lawson and Hanson 1974), and the direction from it to the point to be cut off is the cut's
normal.
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
from planner.planning.bounds.multipliers import dual_value, nearest_point
from planner.planning.bounds.reachable_set import BoundProblem, distance_from_rest
from planner.trajectory import Array, Indices

Intervals = dict[int, tuple[float, float]]
"""Least and greatest value of requests with a known range."""

UNBOUNDED = (-np.inf, np.inf)
"""The interval of an unrestricted request."""

RELAXATION_WORK, NONZERO_WORK = 1500, 3
"""Work of a relaxation with the search for cuts after it, and of each of its nonzeros."""

TRIALS = 25
"""Most support points for one cut [-]; half as many lower the bound by 0.2 % in the mean of 13
problems, 3.7 % at worst; twice as many gain nothing."""

VIOLATION = 1e-3
"""Least violation for which a cut is added [v_max a tick]."""

CUT_ROUNDING = 1e-9
"""Added to a cut's limit: rounding of sums of a few terms of about one."""


class ActingPairs(NamedTuple):
    """Which requests act at which ticks, one entry for every pair, ordered by tick."""

    tick: Indices  # the tick t, shape (m,)
    request: Indices  # the request r, shape (m,)
    weight: Array  # W(r, t), shape (m,)
    following: Indices  # index of the same request's entry one tick later; -1 where there is none


def acting_pairs(model: JointModel, ticks: int, *, cyclic: bool) -> ActingPairs:
    """Every pair of a tick and a request that acts there.

    From rest, requests before the first are the first one. In a short cycle a request may act twice
    at one tick, as sent in two cycles: one entry.
    """
    window, every = model.window, np.arange(ticks)[:, np.newaxis]
    requests = ticks // model.hold if cyclic else (ticks - 1) // model.hold + 1
    number = (every - window.first - np.arange(len(window.weights))) // model.hold
    number = number % requests if cyclic else np.maximum(number, 0)
    weights, acts = np.zeros((ticks, requests)), np.zeros((ticks, requests), dtype=np.bool_)
    np.add.at(weights, (every, number), window.weights)
    acts[every, number] = True
    tick, request = np.nonzero(acts)
    entry = np.full((ticks + 1, requests), -1)
    entry[tick, request] = np.arange(len(tick))
    if cyclic:
        entry[ticks] = entry[0]
    return ActingPairs(tick, request, weights[acts], entry[tick + 1, request])


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


class ScaledProblem:
    """A bound's problem in units of v_max a tick, with the common data of its relaxations.

    The joint has neither a dead band nor inertia.
    """

    def __init__(
        self, problem: BoundProblem, incumbent: float, *, most_work: float = math.inf
    ) -> None:
        """Scale the problem: the unit is the joint's largest move in a tick."""
        model, desired, cyclic, norm, start, _ = without_load(problem)
        unit, middle = model.v_max_per_tick, float(np.mean(desired))
        self.unit, self.model, self.cyclic, self.norm = unit, model, cyclic, norm
        self.gain = unit / model.theta_0  # gamma [1/tick]
        self.excess = model.v_offset / model.v_max  # of the top speed upwards, missing downwards
        self.desired = (desired - middle) / unit  # D, (n,)
        self.incumbent = incumbent / unit  # error of a plan, above that of any better response
        self.work, self.most_work = 0, most_work  # in nonzeros; the search stops at the most
        self.ticks = problem.ticks  # their number
        self.sampled = np.arange(0, self.ticks, model.hold)  # where D is compared, (n,)
        self.start = None if start is None else (start - middle) / unit
        # From a start the first request holds the joint there.
        self.fixed: Intervals = {} if self.start is None else {0: (self.start, self.start)}
        self.pairs = acting_pairs(model, self.ticks, cyclic=cyclic)
        self.size = self.ticks + len(self.pairs.tick)  # unknowns: angles and contributions
        self.before = (np.arange(self.ticks) - 1) % self.ticks
        self.first = 0 if cyclic else 1  # first tick whose speed is known
        self.equations = self.ticks - self.first  # of motion, which are the relaxation's first rows
        # of each request the indices of its contributions, and of the angles they depend on
        self.windows: dict[int, tuple[Indices, Indices]] = {}
        for request in range(len(desired)):
            acts = (self.pairs.request == request) & (self.pairs.tick >= self.first)
            group = np.flatnonzero(acts)
            if len(group):
                self.windows[request] = (group, self.before[self.pairs.tick[group]])

    @property
    def exhausted(self) -> bool:
        """Whether the allowed work is used up."""
        return self.work >= self.most_work

    def initial_ranges(self) -> Array:
        """Ranges that follow from the incumbent, the top speed and the start alone.

        Least and greatest angle and least and greatest speed at each tick, (4, ticks), of responses
        that are better than the incumbent.
        """
        farthest = self.incumbent * (np.sqrt(len(self.desired)) if self.norm == "rms" else 1.0)
        after = np.arange(self.ticks) % self.model.hold * (1.0 + abs(self.excess))
        nearest = np.repeat(self.desired, self.model.hold)[: self.ticks]
        lower, upper = nearest - farthest - after, nearest + farthest + after
        if self.start is not None:
            near = distance_from_rest(self.model, np.zeros(self.ticks), "envelope") / self.unit
            lower[: len(near)] = np.maximum(lower[: len(near)], self.start - near)
            upper[: len(near)] = np.minimum(upper[: len(near)], self.start + near)
        slowest = np.full(self.ticks, self.excess - 1.0)
        return np.array([lower, upper, slowest, slowest + 2.0])

    def box(self, ranges: Array) -> tuple[Array, Array]:
        """Centre and half the widths of a box that contains all unknowns."""
        middle, room = np.full(self.size, self.excess), np.ones(self.size)
        middle[: self.ticks] = (ranges[0] + ranges[1]) / 2.0
        room[: self.ticks] = (ranges[1] - ranges[0]) / 2.0
        return middle, room

    def requests_at(
        self, request: int, intervals: Intervals, lower: Array, upper: Array
    ) -> RequestSet:
        """Range of a request, and these ranges of the angles where it acts."""
        interval = intervals.get(request, UNBOUNDED)
        return RequestSet(self.gain, lower, upper, interval, self.excess)

    @cached_property
    def speeds(self) -> sparse.csr_array:
        """Rows w(t), the speed in each tick but from rest the first."""
        eye = sparse.eye_array(self.ticks, self.size, format="csr")
        moved = np.arange(self.first, self.ticks)
        return sparse.csr_array(eye[moved] - eye[self.before[moved]])

    @cached_property
    def motion(self) -> sparse.csr_array:
        """Rows w(t) - sum_r W(r, t) u(r, t), which vanish."""
        tick, _, weight, _ = self.pairs
        at = (tick, np.arange(self.ticks, self.size))
        weighted = sparse.csr_array((weight, at), shape=(self.ticks, self.size))
        return sparse.csr_array(self.speeds - weighted[self.first :])

    @cached_property
    def changes(self) -> tuple[sparse.csr_array, Indices]:
        """Rows u(r, t+1) - u(r, t), and the place of tick t among the speeds."""
        pairs = self.pairs
        pair = np.flatnonzero((pairs.following >= 0) & (pairs.tick >= self.first))
        each = sparse.eye_array(self.size, format="csr")[self.ticks :]
        rows = sparse.csr_array(each[pairs.following[pair]] - each[pair])
        return rows, pairs.tick[pair] - self.first


class Cut(NamedTuple):
    """A hull cut of one request: ``nu @ u - xi @ x <= limit`` at all angles where it acts."""

    request: int
    nu: Array
    xi: Array
    limit: float


class RelaxedSolution(NamedTuple):
    """The nearest point of a relaxation, and the bound of its multipliers for the whole set."""

    angles: Array  # x, shape (ticks,)
    contributions: Array  # u, shape (pairs,)
    bound: float  # lower bound on the error of the relaxation, by (9) [v_max ticks]
    matrix: sparse.csr_array  # G, shape (rows, unknowns), the equations of motion first
    limits: Array  # b, shape (rows,)
    multipliers: Array  # lambda, shape (rows,), the multipliers of the cuts last
    gradient: Array  # G' lambda at the samples, shape (n,)
    dual_value: float  # the numerator of (9)


def conditions(
    problem: ScaledProblem, ranges: Array, cuts: list[Cut]
) -> tuple[sparse.csr_array, Array]:
    """The relaxation's rows ``matrix @ z <= limits``, of which the first are equations.

    max(0, -w) is convex in w, so between its values at the ends of w's range it is at most the
    chord; the chord is exact where the direction is known.
    """
    (changes, at), speeds, gain = problem.changes, problem.speeds, problem.gain
    lower, upper, slow, fast = ranges
    slow, fast = slow[problem.first :], fast[problem.first :]
    width = np.maximum(fast - slow, np.finfo(np.float64).tiny)
    back, forth = np.maximum(-slow, 0.0), np.maximum(fast, 0.0)
    # Slope and constant of the chord of max(0, -w), and of max(0, w).
    falling = (np.maximum(-fast, 0.0) - back) / width
    rising = (forth - np.maximum(slow, 0.0)) / width
    fallen, risen = back - falling * slow, forth - rising * fast
    unknowns = sparse.eye_array(problem.size, format="csr")
    angles, contributions = unknowns[: problem.ticks], unknowns[problem.ticks :]
    ones = np.ones(contributions.shape[0])
    rows: list[tuple[Any, Array]] = [
        (problem.motion, np.zeros(problem.equations)),
        (changes - sparse.diags_array(gain * falling[at]) @ speeds[at], gain * fallen[at]),
        (-changes - sparse.diags_array(gain * rising[at]) @ speeds[at], gain * risen[at]),
        (speeds, fast),
        (-speeds, -slow),
        (angles, upper),
        (-angles, -lower),
        (contributions, ones + problem.excess),
        (-contributions, ones - problem.excess),
    ]
    if cuts:
        windows = [problem.windows[cut.request] for cut in cuts]
        row = np.repeat(np.arange(len(cuts)), [2 * len(angles) for _, angles in windows])
        column = [np.append(problem.ticks + u, x) for u, x in windows]
        value = [np.append(cut.nu, -cut.xi) for cut in cuts]
        entries = np.concatenate(value), (row, np.concatenate(column))
        hull = sparse.csr_array(entries, shape=(len(cuts), problem.size))
        rows.append((hull, np.array([cut.limit for cut in cuts])))
    blocks, limits = zip(*rows, strict=True)
    return sparse.csr_array(sparse.vstack(blocks)), np.concatenate(limits)


def solve_relaxation(problem: ScaledProblem, ranges: Array, cuts: list[Cut]) -> RelaxedSolution:
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
    # Unknowns without a desired value are anywhere in their range.
    reference, room = problem.box(ranges)
    reference[problem.sampled], room[problem.sampled] = problem.desired, 0.0
    value, slopes = dual_value(matrix, limits, answer.multipliers, reference, room)
    gradient = slopes[problem.sampled]
    bound = 0.0
    if value > 0.0:  # the right-hand side of (9); without a gradient the relaxation is empty
        rms = problem.norm == "rms"
        size = float(np.linalg.norm(gradient, 2 if rms else 1))
        size *= math.sqrt(len(problem.desired)) if rms else 1.0
        bound = value / size if size > 0.0 else math.inf
    angles, contributions = np.split(answer.unknowns, [problem.ticks])
    return RelaxedSolution(
        angles, contributions, bound, matrix, limits, answer.multipliers, gradient, value
    )


def violated_cuts(
    problem: ScaledProblem, ranges: Array, solution: RelaxedSolution, intervals: Intervals
) -> list[Cut]:
    """A cut for every request whose contributions lie outside of its hull."""
    new_cuts = []
    for request, (own, at) in problem.windows.items():
        requests = problem.requests_at(request, intervals, *ranges[:2, at])
        cut = separate(solution.contributions[own], solution.angles[at], requests)
        if cut is not None:
            new_cuts.append(Cut(request, *cut))
    return new_cuts


class RequestSet(NamedTuple):
    """Range of one request, and ranges of the angles at the ticks at which it acts."""

    gain: float  # gamma = v_max / theta_0 [1/tick]
    lower: Array  # least angles before these ticks, shape (m,)
    upper: Array  # greatest angles, shape (m,)
    interval: tuple[float, float] = UNBOUNDED  # least and greatest request
    excess: float = 0.0  # excess of the top speed upwards, which is missing downwards

    @property
    def corners(self) -> tuple[float, float]:
        """Errors at which the slope of f changes, the least first."""
        return (self.excess - 1.0) / self.gain, (self.excess + 1.0) / self.gain

    def contributions(self, errors: Array) -> Array:
        """The contribution f / v of every error [-], like the errors."""
        return np.asarray(np.clip(self.gain * errors, self.excess - 1.0, self.excess + 1.0))

    def breakpoints(self, angles: Array) -> Array:
        """Requests of the set at which some contribution starts or ceases to saturate; its ends."""
        every = np.concatenate([angles + corner for corner in self.corners])
        within: Array = np.minimum(np.maximum(every, self.interval[0]), self.interval[1])
        return within


def support(nu: Array, xi: Array, requests: RequestSet) -> tuple[float, Array, Array]:
    """The maximum of ``nu @ u - xi @ x`` over a set, and contributions u and angles x that have it.

    It is the support function of the set in the direction (nu, -xi): the right-hand side of (9a).
    For a given request every angle is on its own, and best at an end of its range or where the
    slope of its contribution changes. Between neighbouring breakpoints all these candidates are
    linear in the request, so that the best of them is convex in it, and the maximum is at a
    breakpoint.
    """
    lower, upper = requests.lower, requests.upper
    candidates = requests.breakpoints(np.concatenate([lower, upper]))[:, np.newaxis]
    angles = np.empty((4, len(candidates), len(lower)))
    angles[0], angles[1] = lower, upper
    for place, corner in zip(angles[2:], requests.corners, strict=True):
        place[:] = np.minimum(np.maximum(candidates - corner, lower), upper)
    contributions = requests.contributions(candidates - angles)
    values = nu * contributions - xi * angles
    best = int(np.argmax(values.max(axis=0).sum(axis=1)))
    which = values[:, best].argmax(axis=0), best, np.arange(len(lower))
    return float(values[which].sum()), contributions[which], angles[which]


def separate(
    contributions: Array, angles: Array, requests: RequestSet
) -> tuple[Array, Array, float] | None:
    """A cut (nu, xi, limit) that the contributions violate, or None if none is violated enough.

    The nearest mixture of points of the set is sought, one support point after the other in the
    direction of the residual; that direction is the cut's normal, and its limit the support there.
    """
    from scipy.optimize import nnls  # slow to import

    gain, middle = requests.gain, (requests.lower + requests.upper) / 2.0
    angles = np.clip(angles, requests.lower, requests.upper)
    count, ones = len(contributions), 100.0  # weight of the equation that the shares sum to one
    target = np.concatenate([contributions, gain * (angles - middle)])
    candidates = np.unique(requests.breakpoints(angles))[:, np.newaxis]
    curve = requests.contributions(candidates - angles)
    points = np.hstack([curve, np.broadcast_to(target[count:], curve.shape)])
    best, deepest = None, VIOLATION
    for _ in range(TRIALS):
        shares, _ = nnls(np.vstack([points.T, np.full(len(points), ones)]), np.append(target, ones))
        residual = target - shares @ points / shares.sum()
        size = float(np.linalg.norm(residual))
        if size < VIOLATION:
            break
        nu, xi = residual[:count] / size, -gain * residual[count:] / size
        most, its_contributions, its_angles = support(nu, xi, requests)
        depth = float(nu @ contributions - xi @ angles) - most
        if depth > deepest:
            best, deepest = (nu, xi, most + CUT_ROUNDING), depth
        point = np.concatenate([its_contributions, gain * (its_angles - middle)])
        points = np.vstack([points[shares > CUT_ROUNDING], point])
    return best


def nearest_request(
    contributions: Array, angles: Array, requests: RequestSet
) -> tuple[float, float]:
    """The request whose contributions at these angles are nearest, and their distance.

    Between neighbouring breakpoints the squared distance is a parabola in the request, whose lowest
    point is the mean of the requests of those contributions that do not saturate.
    """
    ends = np.unique(requests.breakpoints(angles))
    lower, upper = ends[:-1, np.newaxis], ends[1:, np.newaxis]
    errors = (lower + upper) / 2.0 - angles
    free = (errors > requests.corners[0]) & (errors < requests.corners[1])
    own = angles + contributions / requests.gain
    lowest = np.sum(free * own, axis=1) / np.maximum(np.sum(free, axis=1), 1)
    candidates = np.append(ends, np.clip(lowest, ends[:-1], ends[1:]))[:, np.newaxis]
    away = requests.contributions(candidates - angles) - contributions
    distances = np.linalg.norm(away, axis=1)
    nearest = int(np.argmin(distances))
    return float(candidates[nearest, 0]), float(distances[nearest])
