"""The exact level: branch and bound over the intervals of single requests.

The distance of a convex relaxation is a bound. It is raised by tightening ranges and by cutting
planes and, where a request's contributions are a mixture of those of two requests, by branching on
whether the request is above or below the one in between (Land and Doig 1960).

Tightening narrows the ranges of angles and speeds tick by tick. Their least and greatest values
over all responses better than the incumbent are bounded by small cone programmes (Gleixner et al.
2017), each on the conditions around one tick and on (9b) of math.md: the conditions have little
slack in a response with a small error.
"""

from __future__ import annotations

import heapq
import logging
from collections.abc import Iterable
from itertools import count
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.optimize import least_squares

from planner.planning.bounds.multipliers import conic_solutions
from planner.planning.bounds.reachable_set import BoundProblem
from planner.planning.bounds.saturation_relaxation import (
    UNBOUNDED,
    VIOLATION,
    Cut,
    Intervals,
    RelaxedSolution,
    ScaledProblem,
    nearest_request,
    solve_relaxation,
    violated_cuts,
)
from planner.trajectory import Array, Indices, error_norm

WORK_PER_SECOND = 600_000
"""Work that counts as a second, so that the bound does not depend on the clock; five problems of 19
to 88 samples took 560,000 to 630,000 per second on an AMD EPYC."""

GAP = 5e-4
"""Relative gap to the incumbent at which the search stops [-]; smoothing costs a plan 2e-4 of its
error, and a smaller gap is below that."""

ABSOLUTE_GAP = 1.5e-5
"""Gap to the incumbent at which it stops as well [rad]: a hundredth of the step of a 12-bit
encoder, which no robot shows."""

GAIN = 1e-2
"""Relative gain of a round of tightening from which on another round follows [-]; at 1e-3 the
bounds of 13 problems are 0.1 % lower in the mean, at 5e-2 the median gap doubles."""

ROUNDS = 6
"""Most rounds of cuts after a round of tightening at the root [-]; the next round follows a gain of
at least ``GAP``. With one round, one bound of eight is 6e-5 lower; with six at every node, three
are 3e-4 to 9e-4 lower."""

MARGIN = 0.1
"""Least share of a request's interval on either side of the value at which it is branched [-];
without it a child may be all of its parent, and the gaps of five problems of eight are 2 to 6 %
larger."""

NEIGHBOURHOOD = 11
"""Ticks on either side whose conditions are included [-]. With twice as many a round takes longer
and, in the same time, the bound is 0.4 % lower in the mean of 13 problems."""


class Node(NamedTuple):
    """A part of all responses: intervals of requests, and ranges and bounds of the responses."""

    bound: float  # lower bound on their error [v_max ticks]
    intervals: Intervals  # intervals of the requests that were branched on
    ranges: Array  # ends of the ranges of angles and speeds, (4, ticks)
    cuts: list[Cut]  # the active cuts
    solution: RelaxedSolution  # the nearest point of the node's relaxation

    def weighted_cuts(self) -> list[tuple[Cut, float]]:
        """The cuts, the last rows of the relaxation, with their multipliers."""
        multipliers = self.solution.multipliers[len(self.solution.limits) - len(self.cuts) :]
        return list(zip(self.cuts, multipliers.tolist(), strict=True))


def exact_bound(problem: BoundProblem, incumbent: float, *, time_limit: float) -> float:
    """A lower bound on the error of any requests, at most the incumbent's error [rad].

    The incumbent is any error, best that of a good plan: all conclusions are about responses that
    are better. The time limit [s] is counted as work.
    """
    scaled = ScaledProblem(problem, incumbent, most_work=time_limit * WORK_PER_SECOND)
    root = _root(scaled)
    order = count()
    nodes = [(root.bound, next(order), root)]
    while not _closed(scaled, nodes[0][0]) and not scaled.exhausted:
        node = nodes[0][2]
        if scaled.start is None and not scaled.cyclic:
            scaled.incumbent = min(scaled.incumbent, response_error(scaled, node))
            known, ranges = scaled.initial_ranges(), node.ranges.copy()
            np.maximum(ranges[0], known[0], out=ranges[0])
            np.minimum(ranges[1], known[1], out=ranges[1])
            node = node._replace(ranges=ranges)
        children = branch(scaled, node)
        if not children:
            break
        heapq.heappop(nodes)
        for child in children:
            heapq.heappush(nodes, (child.bound, next(order), child))
    logging.getLogger(__name__).debug(
        "exact bound: %s at %.4g of the incumbent's error, %d nodes open",
        "closed" if _closed(scaled, nodes[0][0]) else "stopped",
        nodes[0][0] / scaled.incumbent if scaled.incumbent else 1.0,
        len(nodes),
    )
    return min(nodes[0][0] * scaled.unit, scaled.incumbent * scaled.unit, incumbent)


def _root(problem: ScaledProblem) -> Node:
    """The root node: all responses, after bound tightening and hull cuts."""
    ranges = problem.initial_ranges()
    solution = solve_relaxation(problem, ranges, [])
    bound = min(solution.bound, problem.incumbent)
    node = Node(bound, dict(problem.fixed), ranges, [], solution)
    while not _closed(problem, node.bound):
        before = node.bound
        node = _tightened(problem, node, range(problem.ticks), rounds=ROUNDS)
        if node.bound <= before * (1.0 + GAIN) or problem.exhausted:
            break
    return node


def _closed(problem: ScaledProblem, bound: float) -> bool:
    allowed = max(GAP * problem.incumbent, ABSOLUTE_GAP / problem.unit)
    return problem.incumbent - bound <= allowed


def _tightened(
    problem: ScaledProblem, node: Node, ticks: Iterable[int], *, rounds: int = 1
) -> Node:
    """The node after a round of tightening at some ticks and some of cuts."""
    if tighten(problem, node.ranges, node.solution, ticks):
        return cut_off(problem, node, rounds=rounds)
    return node._replace(bound=problem.incumbent)


def cut_off(problem: ScaledProblem, node: Node, *, rounds: int = 1) -> Node:
    """The node with the cuts that its nearest points violate, and the bound by these."""
    for turn in range(rounds + 1):
        before = node.bound
        solution = solve_relaxation(problem, node.ranges, node.cuts)
        node = node._replace(bound=max(before, solution.bound), solution=solution)
        gained = turn == 0 or node.bound > before * (1.0 + GAP)
        if turn == rounds or not gained or node.bound >= problem.incumbent:
            break
        new_cuts = violated_cuts(problem, node.ranges, solution, node.intervals)
        if not new_cuts:
            break
        # Smaller multipliers are an interior-point method's rounding of zero.
        active = [cut for cut, weight in node.weighted_cuts() if weight > 1e-9]
        node = node._replace(cuts=active + new_cuts)
    return node._replace(bound=min(node.bound, problem.incumbent))


def branch(problem: ScaledProblem, node: Node) -> list[Node]:
    """The node split in two: a request below a value, and the same request above it.

    Empty where every mixture is nearer to a request than cuts can tell: the child with these
    requests would have the same nearest point, and the same bound, however often it is split.
    """
    branching = branching_request(problem, node)
    if branching is None:
        return []
    request, value = branching
    lower, upper = node.intervals.get(request, UNBOUNDED)
    children = []
    for side in ((lower, value), (value, upper)):
        intervals = {**node.intervals, request: side}
        child = cut_off(problem, node._replace(intervals=intervals, ranges=node.ranges.copy()))
        if node.bound * (1.0 + GAIN) < child.bound < problem.incumbent:
            child = _tightened(problem, child, problem.windows[request][1])
        children.append(child)
    return children


def branching_request(problem: ScaledProblem, node: Node) -> tuple[int, float] | None:
    """The request whose mixture of contributions weighs most, and a value near to the mixture.

    Of mixtures without a weight, which all have while the bound is 0, the widest. Mixtures that are
    nearer to a request than the least violation of a cut do not count.
    """
    weights = dict.fromkeys(problem.windows, 0.0 if node.bound > 0.0 else 1.0)
    for cut, weight in node.weighted_cuts():
        weights[cut.request] += float(weight * np.linalg.norm(cut.nu))
    wide: list[tuple[float, float, int, float]] = []
    for request in problem.windows:
        value, distance, ends = _nearest(problem, node, request)
        if distance >= VIOLATION:
            grid = np.linspace(*ends, 300)  # on it, so that rounding does not decide the search
            value = float(grid[np.argmin(np.abs(grid - value))])
            kept = MARGIN * (ends[1] - ends[0])
            value = min(max(value, ends[0] + kept), ends[1] - kept)
            wide.append((weights[request] * distance, distance, request, value))
    return max(wide)[2:] if wide else None


def _nearest(
    problem: ScaledProblem, node: Node, request: int
) -> tuple[float, float, tuple[float, float]]:
    """The value nearest to a request's mixture, its distance, and the ends of sensible values."""
    own, at = problem.windows[request]
    angles = node.solution.angles[at]
    requests = problem.requests_at(request, node.intervals, angles, angles)
    ends = requests.breakpoints(angles)
    nearest = nearest_request(node.solution.contributions[own], angles, requests)
    return *nearest, (float(ends.min()), float(ends.max()))


def response_error(problem: ScaledProblem, node: Node) -> float:
    """The error of a response near to the node's mixtures [v_max ticks]: an incumbent.

    It may begin at any angle, in motion, unlike a plan from rest. Without it the search for a bound
    that holds for every start would continue although the bound is attained: bounds of 14 problems
    would be 4 % lower in the mean. The requests are the nearest to the mixtures, from the node's
    first angle; a response better than the incumbent is improved by least squares, without which
    they would be 0.8 % lower.
    """
    unknowns = np.zeros(max(problem.windows) + 2)  # the first angle, and the requests
    unknowns[0] = node.solution.angles[0]
    for request in problem.windows:
        unknowns[1 + request] = _nearest(problem, node, request)[0]

    def errors(chosen: Array) -> Array:
        return np.asarray(_response_errors(problem, chosen[:, np.newaxis])[:, 0])

    def slopes(chosen: Array) -> Array:
        ways = 1e-6 * np.eye(len(chosen))
        sides = (_response_errors(problem, chosen[:, np.newaxis] + way) for way in (ways, -ways))
        return np.asarray(np.subtract(*sides) / 2e-6)

    error = error_norm(errors(unknowns), problem.norm)
    if error >= problem.incumbent:
        return error
    better = least_squares(errors, unknowns, jac=slopes, max_nfev=30).x
    return min(error, error_norm(errors(better), problem.norm))


def _response_errors(problem: ScaledProblem, unknowns: Array) -> Array:
    """Errors of responses at the samples, (n, m), by first angles and requests, (1 + r, m)."""
    ends = np.searchsorted(problem.pairs.tick, np.arange(problem.ticks + 1))
    angles = np.empty((problem.ticks, unknowns.shape[1]))
    angles[0] = unknowns[0]
    top, excess = 1.0, problem.excess
    for tick in range(1, problem.ticks):
        acting = slice(ends[tick], ends[tick + 1])
        behind = unknowns[1 + problem.pairs.request[acting]] - angles[tick - 1]
        contributions = np.clip(problem.gain * behind, excess - top, excess + top)
        angles[tick] = angles[tick - 1] + problem.pairs.weight[acting] @ contributions
    return np.asarray(angles[problem.sampled] - problem.desired[:, np.newaxis])


def tighten(
    problem: ScaledProblem, ranges: Array, solution: RelaxedSolution, ticks: Iterable[int]
) -> bool:
    """Narrow the ranges in place, tick by tick; False where no such response remains.

    The least value of ``zeta @ z`` over a box with centre c and half widths h is at least
    ``(zeta + G' mu) c - |zeta + G' mu| h - mu b`` for any dual multipliers mu.
    """
    columns = sparse.csc_array(solution.matrix)
    lengths = np.diff(solution.matrix.indptr)
    lower, upper, slowest, fastest = ranges
    for tick in ticks:
        if problem.exhausted:
            break
        chosen, matrix, limits, equations, balls = local_conditions(
            problem, solution, columns, lengths, tick
        )
        angle = (chosen == tick).astype(np.float64)
        speed = angle - (chosen == problem.before[tick])
        undecided = tick >= problem.first and slowest[tick] < 0.0 < fastest[tick]
        objectives = [angle, -angle, speed, -speed][: 4 if undecided else 2]
        problem.work += matrix.nnz * len(objectives)
        answers = conic_solutions(
            matrix,
            limits,
            objectives,
            equations=equations,
            balls=balls,
            tolerance=1e-5,  # ranges are valid at any
        )
        middle, room = (each[chosen] for each in problem.box(ranges))
        for end, (objective, answer) in enumerate(zip(objectives, answers, strict=True)):
            gradient = objective + matrix.T @ answer.multipliers
            loose = float(np.abs(gradient) @ room + answer.multipliers @ limits)
            least, known = float(gradient @ middle) - loose, ranges[end, tick]
            ranges[end, tick] = min(known, -least) if end % 2 else max(known, least)
        if lower[tick] > upper[tick] or slowest[tick] > fastest[tick]:
            return False
    return True


def local_conditions(
    problem: ScaledProblem,  # the problem of the bound
    solution: RelaxedSolution,  # the nearest point of the present relaxation
    columns: sparse.csc_array,  # its matrix, by columns
    lengths: Indices,  # entries in each of its rows
    tick: int,  # the tick in the middle
) -> tuple[Indices, sparse.csr_array, Array, int, tuple[int, ...]]:
    """The conditions around one tick that every response better than the incumbent meets.

    They are the relaxation's rows that concern the ticks around it alone, and (9b) restricted to
    them.

    Returns:
        The problem's unknowns that occur, (m,), and matrix and limits of conditions on them, the
        number of equations among these and the sizes of second-order cones.
    """
    around = np.arange(tick - NEIGHBOURHOOD, tick + NEIGHBOURHOOD + 1)
    around = around % problem.ticks if problem.cyclic else np.clip(around, 0, problem.ticks - 1)
    near = np.zeros(problem.ticks, dtype=np.bool_)
    near[around] = True
    chosen = np.flatnonzero(np.concatenate([near, near[problem.pairs.tick]]))
    inside = sparse.csr_array(columns[:, chosen])
    entries = np.diff(inside.indptr)
    kept = np.flatnonzero((entries == lengths) & (entries > 0))
    matrix, limits = sparse.csr_array(inside[kept]), solution.limits[kept]
    equations = int(np.searchsorted(kept, problem.equations))
    multipliers = solution.multipliers[kept].copy()
    multipliers[:equations] = 0.0  # equations leave no slack
    # lambda (b - G z) of the kept rows is at most the spare; weighted @ z + spare remains.
    weighted, spare = matrix.T @ multipliers, -float(multipliers @ limits)
    less = sparse.csr_array(-weighted[np.newaxis])
    gradient, balls = solution.gradient, tuple[int, ...]()
    if problem.norm == "max":
        spare += problem.incumbent * float(np.abs(gradient).sum()) - solution.dual_value
        rows, right = [less], np.array([spare])
    else:
        # |x - c|^2 <= weighted @ z + spare as a second-order cone: |2 (x - c), s - 1| <= s + 1.
        spare += len(problem.desired) * problem.incumbent**2 - solution.dual_value
        spare += float(gradient @ gradient) / 4.0
        sampled = np.flatnonzero(near[problem.sampled])
        centre = (problem.desired - gradient / 2.0)[sampled]
        at = np.searchsorted(chosen, problem.sampled[sampled])
        distances = -2.0 * sparse.eye_array(len(chosen), format="csr")[at]
        rows = [less, less, distances]
        right = np.concatenate([[spare + 1.0, spare - 1.0], -2.0 * centre])
        balls = (len(sampled) + 2,)
    matrix = sparse.csr_array(sparse.vstack([matrix, *rows]))
    return chosen, matrix, np.concatenate([limits, right]), equations, balls
