"""Lower bounds on the tracking error (``docs/math.md``), and how the exact level is computed.

The exact level is a spatial branch and bound over the intervals of single requests. The distance of
a convex relaxation is a bound. It is raised by tightening ranges and by cutting planes and, where a
request's contributions are a mixture of those of two requests, by branching on whether the request
is above or below the one in between (Land and Doig 1960).

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
from time import perf_counter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.optimize import least_squares

from planner.exceptions import InvalidTrajectory, SolverFailed
from planner.model.joint import JointModel, checked_model
from planner.model.response import checked_load, checked_start
from planner.planning.bounds.multipliers import Cones, ConicSolver, linear_bound
from planner.planning.bounds.reachable_set import (
    LEVELS,
    BoundProblem,
    Level,
    proved_level,
)
from planner.planning.bounds.saturation_relaxation import (
    TRIED_REQUESTS,
    UNBOUNDED,
    VIOLATION,
    Cut,
    Intervals,
    Ranges,
    RelaxedSolution,
    ScaledProblem,
    breakpoints,
    nearest_request,
    solve_relaxation,
    violated_cuts,
    without_load,
)
from planner.planning.inversion import planned
from planner.planning.task import NORMS, Norm, Task
from planner.trajectory import Array, Indices, as_trajectory, error_norm, relative_gap
from planner.validation import as_positive, check_choice

TIME_LIMIT = 60.0
"""Approximate time after which the search stops with the bound so far [s]."""

WORK_PER_SECOND = 600_000
"""Work that counts as a second, so that the bound does not depend on the clock; five problems of 19
to 88 samples took 560,000 to 630,000 per second on an AMD EPYC."""

INACTIVE = 1e-9
"""A cut with a smaller multiplier is dropped: an interior-point method's rounding of zero."""

DIFFERENCE = 1e-6
"""Step of the difference quotients of a response [v_max ticks]."""

POLISHING_STEPS = 30
"""Most least-squares steps that improve an incumbent [-]."""

REFINEMENTS = 3
"""Grids, each within the one before, on which the request nearest to a mixture is sought [-]: to
1e-6 of the joint's motion in a tick."""


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


class Certificate(NamedTuple):
    """A lower bound, and how it was obtained.

    Attributes:
        bound: Lower bound on the error of any requests [rad].
        norm: Which error.
        level: The conditions on the joint: the requested level, or the strongest below it that
            holds for the joint.
        solver_gap: Relative distance between the bound and the best known value of the same level,
            for "exact" the error of a plan; 0 where one set of multipliers proves the bound, inf
            where there is none.
        seconds: Time it took [s].
    """

    bound: float
    norm: Norm
    level: Level
    solver_gap: float
    seconds: float


def lower_bound(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    level: Level = "envelope",
    start: float | None = None,
    time_limit: float = TIME_LIMIT,
    load: npt.ArrayLike | None = None,
) -> float:
    """A lower bound on the error of any requests [rad]: see :func:`planner.certify`.

    Example:
        >>> import numpy as np
        >>> desired = 1.2 * np.sin(2 * np.pi * np.arange(88) / 88) ** 3  # [rad], every 8 ms
        >>> f"{np.degrees(lower_bound(JointModel.ers210a(), desired)):.1f} deg rms"
        '10.2 deg rms'
    """
    return certify(
        model,
        desired,
        cyclic=cyclic,
        norm=norm,
        level=level,
        start=start,
        time_limit=time_limit,
        load=load,
    ).bound


def certify(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    level: Level = "envelope",
    start: float | None = None,
    time_limit: float = TIME_LIMIT,
    load: npt.ArrayLike | None = None,
) -> Certificate:
    """A lower bound on the error of any requests, and how it was obtained.

    ``slope`` uses the joint's top speeds, gravity included; ``envelope`` also that its speed cannot
    change at once; ``exact`` follows every request through the window, and searches all
    requests for any that are better than a plan (``docs/math.md``, section 5). Each bound is at
    least the one before, and costs more: one and a few milliseconds, and seconds to the time limit
    for a hundred samples. All hold under a load, "exact" under a constant one. For a joint with a
    dead band, inertia or a sag by the pose "envelope" is the strongest; the answer has the level
    used. With the integral of a speed loop the bound is 0: it may exceed the top speed.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        norm: "rms" for the root mean square of the errors, "max" for the largest.
        level: "slope", "envelope" or "exact".
        start: From rest: angle at which the joint rests until the plan begins [rad]. Without it the
            bound holds for every start.
        time_limit: For "exact": when to stop with the bound so far [s]. It is counted as work that
            takes about this time, so that the bound is the same on a slow or busy machine.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape (n,);
            the bound is about plans under this load.

    Returns:
        The bound, at least 0.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 2.
        InvalidInput: The norm or level is unknown, a cycle has a start, the load does not fit
            the samples or the joint, or it changes and the level is "exact".
        SolverFailed: The solver proposed no multipliers.

    Example:
        >>> import numpy as np
        >>> desired = 1.2 * np.sin(2 * np.pi * np.arange(88) / 88) ** 3  # [rad], every 8 ms
        >>> certificate = certify(JointModel.ers210a(), desired, level="slope")
        >>> certificate.level, f"{np.degrees(certificate.bound):.1f} deg rms"
        ('slope', '10.1 deg rms')
    """
    model = checked_model(model)
    time_limit = as_positive("time_limit", time_limit, "a number of seconds above 0")
    desired = as_trajectory(desired, name="desired")
    check_choice("norm", norm, NORMS)
    check_choice("level", level, LEVELS)
    start = checked_start(start, cyclic=cyclic)
    torques = checked_load(load, model, len(desired))
    problem = BoundProblem(model, desired, cyclic, norm, start, torques)
    return certified(problem, level, time_limit=time_limit)


def certified(
    problem: BoundProblem, level: Level, *, time_limit: float = TIME_LIMIT
) -> Certificate:
    """:func:`certify` of arguments that have been checked."""
    began = perf_counter()
    level = proved_level(problem.model, level)
    if level == "exact":
        without_load(problem)  # refused before anything is computed
    bound, gap = linear_bound(problem, level), 0.0
    if level == "exact":
        plan_error = planned_error(problem)
        bound = max(bound, exact_bound(problem, plan_error, time_limit=time_limit))
        gap = max(relative_gap(plan_error, bound), 0.0)
    return Certificate(bound, problem.norm, level, gap, perf_counter() - began)


def planned_error(problem: BoundProblem) -> float:
    """The error of a plan [rad]; of a joint at rest, where no plan is found."""
    model, desired, cyclic, norm, start, load = problem
    try:
        task = Task.of(
            [model], desired, names=("",), cyclic=cyclic, norm=norm, start=start, load=load
        )
        return float(planned(task.unsmoothed).error[0])
    except (InvalidTrajectory, SolverFailed):  # too short, or no steady cycle
        angles = np.full(len(desired), float(np.mean(desired)) if start is None else start)
        return error_norm(angles - desired, norm)


class Node(NamedTuple):
    """A part of all responses: intervals of requests, and ranges and bounds of the responses.

    Attributes:
        bound: Lower bound on their error [v_max ticks].
        intervals: Intervals of the requests that were branched on.
        ranges: Ranges of angles and speeds.
        cuts: The active cuts.
        solution: The nearest point of the node's relaxation.
    """

    bound: float
    intervals: Intervals
    ranges: Ranges
    cuts: list[Cut]
    solution: RelaxedSolution


def exact_bound(problem: BoundProblem, incumbent: float, *, time_limit: float) -> float:
    """A lower bound on the error of any requests, at most the incumbent's error [rad].

    Args:
        problem: The joint, and its desired angles.
        incumbent: Any error, best the error of a good plan [rad]; the answer is valid for any
            value, as all conclusions are about responses that are better.
        time_limit: When to stop [s], counted as work.
    """
    scaled = ScaledProblem(problem, incumbent, most_work=time_limit * WORK_PER_SECOND)
    root = _root(scaled)
    order = count()
    nodes = [(root.bound, next(order), root)]
    while not _closed(scaled, nodes[0][0]) and not scaled.exhausted:
        node = nodes[0][2]
        if scaled.start is None and not scaled.cyclic:
            scaled.incumbent = min(scaled.incumbent, response_error(scaled, node))
            node = node._replace(ranges=node.ranges.within(scaled.initial_ranges()))
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
        if tighten(problem, ranges, node.solution, range(problem.ticks)):
            node = cut_off(problem, node, rounds=ROUNDS)
        else:
            node = node._replace(bound=problem.incumbent)
        if node.bound <= before * (1.0 + GAIN) or problem.exhausted:
            break
    return node


def _closed(problem: ScaledProblem, bound: float) -> bool:
    allowed = max(GAP * problem.incumbent, ABSOLUTE_GAP / problem.unit)
    return problem.incumbent - bound <= allowed


def cut_off(problem: ScaledProblem, node: Node, *, rounds: int = 1) -> Node:
    """The node with the cuts that its nearest points violate, and the bound by these."""
    ranges, cuts = node.ranges, node.cuts
    solution = solve_relaxation(problem, ranges, cuts)
    bound = max(node.bound, solution.bound)
    for _ in range(rounds):
        before = bound
        new_cuts = violated_cuts(problem, ranges, solution, node.intervals)
        if not new_cuts or bound >= problem.incumbent:
            break
        cuts = [cut for cut, weight in _weighted(cuts, solution) if weight > INACTIVE] + new_cuts
        solution = solve_relaxation(problem, ranges, cuts)
        bound = max(bound, solution.bound)
        if bound <= before * (1.0 + GAP):
            break
    return Node(min(bound, problem.incumbent), node.intervals, ranges, cuts, solution)


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
    acting = problem.windows[request].angles
    children = []
    for side in ((lower, value), (value, upper)):
        intervals = {**node.intervals, request: side}
        child = cut_off(problem, node._replace(intervals=intervals, ranges=node.ranges.copy()))
        if node.bound * (1.0 + GAIN) < child.bound < problem.incumbent:
            if tighten(problem, child.ranges, child.solution, acting):
                child = cut_off(problem, child)
            else:
                child = child._replace(bound=problem.incumbent)
        children.append(child)
    return children


def branching_request(problem: ScaledProblem, node: Node) -> tuple[int, float] | None:
    """The request whose mixture of contributions weighs most, and a value near to the mixture.

    Of mixtures without a weight, which all have while the bound is 0, the widest. Mixtures that are
    nearer to a request than the least violation of a cut do not count.
    """
    weights = dict.fromkeys(problem.windows, 0.0 if node.bound > 0.0 else 1.0)
    owner = {id(window): request for request, window in problem.windows.items()}
    for cut, weight in _weighted(node.cuts, node.solution):
        weights[owner[id(cut.window)]] += float(weight * np.linalg.norm(cut.hull.nu))
    wide: list[tuple[float, float, int, float]] = []
    for request, window in problem.windows.items():
        angles = node.solution.angles[window.angles]
        requests = problem.requests_at(angles, angles, node.intervals.get(request, UNBOUNDED))
        value, distance = nearest_request(
            node.solution.contributions[window.contributions],
            angles,
            requests,
            margin=MARGIN,
        )
        if distance >= VIOLATION:
            wide.append((weights[request] * distance, distance, request, value))
    return max(wide)[2:] if wide else None


def response_error(problem: ScaledProblem, node: Node) -> float:
    """The error of a response near to the node's mixtures [v_max ticks]: an incumbent.

    It may begin at any angle, in motion, unlike a plan from rest. Without it the search for a bound
    that holds for every start would continue although the bound is attained. The requests are the
    nearest to the mixtures, from the node's first angle; a response better than the incumbent is
    improved by least squares.
    """
    unknowns = np.zeros(max(problem.windows) + 2)  # the first angle, and the requests
    unknowns[0] = node.solution.angles[0]
    for request, window in problem.windows.items():
        angles = node.solution.angles[window.angles]
        contributions = node.solution.contributions[window.contributions]
        within = problem.requests_at(angles, angles, node.intervals.get(request, UNBOUNDED))
        for _ in range(REFINEMENTS):
            value, _ = nearest_request(contributions, angles, within, margin=0.0)
            width = np.ptp(breakpoints(angles, within)) / TRIED_REQUESTS
            low, high = within.interval
            within = within._replace(interval=(max(low, value - width), min(high, value + width)))
        unknowns[1 + request] = value

    def errors(chosen: Array) -> Array:
        return np.asarray(_response_errors(problem, chosen[:, np.newaxis])[:, 0])

    def slopes(chosen: Array) -> Array:
        ways = DIFFERENCE * np.eye(len(chosen))
        sides = (_response_errors(problem, chosen[:, np.newaxis] + way) for way in (ways, -ways))
        return np.asarray(np.subtract(*sides) / (2.0 * DIFFERENCE))

    error = error_norm(errors(unknowns), problem.norm)
    if error >= problem.incumbent:
        return error
    better = least_squares(errors, unknowns, jac=slopes, max_nfev=POLISHING_STEPS).x
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


def _weighted(cuts: list[Cut], solution: RelaxedSolution) -> list[tuple[Cut, float]]:
    """The cuts, the last rows of their relaxation, with their multipliers."""
    multipliers = solution.multipliers[len(solution.multipliers) - len(cuts) :]
    return list(zip(cuts, multipliers.tolist(), strict=True))


NEIGHBOURHOOD = 11
"""Ticks on either side whose conditions are included [-]. With twice as many a round takes longer
and, in the same time, the bound is 0.4 % lower in the mean of 13 problems."""

TIGHTENING_TOLERANCE = 1e-5
"""Clarabel's gap and residuals, in units of v_max a tick [-]; the ranges are valid at any."""


class LocalProblem(NamedTuple):
    """The conditions around one tick that every response better than the incumbent meets.

    Attributes:
        place: Local index of each of the problem's unknowns; -1 where it has none.
        matrix: G, shape (rows, unknowns).
        limits: b, shape (rows,).
        cones: Cones of b - G z.
        middle: The centre of a box that contains z, shape (unknowns,).
        room: Half the box's widths, shape (unknowns,).
    """

    place: Indices
    matrix: sparse.csr_array
    limits: Array
    cones: Cones
    middle: Array
    room: Array


def tighten(
    problem: ScaledProblem, ranges: Ranges, solution: RelaxedSolution, ticks: Iterable[int]
) -> bool:
    """Narrow the ranges in place, tick by tick; False where no such response remains."""
    columns = sparse.csc_array(solution.matrix)
    lengths = np.diff(solution.matrix.indptr)
    for tick in ticks:
        if problem.exhausted:
            break
        local = local_problem(problem, ranges, solution, columns, lengths, tick)
        angle = np.zeros(len(local.middle))
        angle[local.place[tick]] = 1.0
        objectives = [angle, -angle]
        undecided = tick >= problem.first and ranges.slowest[tick] < 0.0 < ranges.fastest[tick]
        if undecided:
            speed = angle.copy()
            speed[local.place[problem.before[tick]]] -= 1.0
            objectives += [speed, -speed]
        problem.work += local.matrix.nnz * len(objectives)
        proved = proved_minima(local, objectives)
        ranges.lower[tick] = max(ranges.lower[tick], proved[0])
        ranges.upper[tick] = min(ranges.upper[tick], -proved[1])
        if undecided:
            ranges.slowest[tick] = max(ranges.slowest[tick], proved[2])
            ranges.fastest[tick] = min(ranges.fastest[tick], -proved[3])
        if ranges.lower[tick] > ranges.upper[tick] or ranges.slowest[tick] > ranges.fastest[tick]:
            return False
    return True


def proved_minima(local: LocalProblem, objectives: list[Array]) -> list[float]:
    """A lower bound on ``zeta @ z`` for each objective zeta, from the dual multipliers mu.

    It is ``(zeta + G' mu) middle - |zeta + G' mu| room - mu b``.
    """
    solver = ConicSolver(local.matrix, local.limits, local.cones, tolerance=TIGHTENING_TOLERANCE)
    proved = []
    for objective in objectives:
        answer = solver.solve(objective)
        gradient = objective + local.matrix.T @ answer.multipliers
        loose = float(np.abs(gradient) @ local.room + answer.multipliers @ local.limits)
        proved.append(float(gradient @ local.middle) - loose)
    return proved


def local_problem(
    problem: ScaledProblem,
    ranges: Ranges,
    solution: RelaxedSolution,
    columns: sparse.csc_array,
    lengths: Indices,
    tick: int,
) -> LocalProblem:
    """The relaxation's rows that concern the ticks around one alone, and (9b) restricted to them.

    Args:
        problem: The problem of the bound.
        ranges: The ranges so far.
        solution: The nearest point of the present relaxation.
        columns: Its matrix, by columns.
        lengths: Entries in each of its rows.
        tick: The tick in the middle.
    """
    around = np.arange(tick - NEIGHBOURHOOD, tick + NEIGHBOURHOOD + 1)
    if problem.cyclic:
        around = around % problem.ticks
    else:
        around = around[(around >= 0) & (around < problem.ticks)]
    near = np.zeros(problem.ticks, dtype=np.bool_)
    near[around] = True
    chosen = np.flatnonzero(np.concatenate([near, near[problem.pairs.tick]]))
    place = np.full(problem.size, -1)
    place[chosen] = np.arange(len(chosen))
    inside = sparse.csr_array(columns[:, chosen])
    count = np.diff(inside.indptr)
    kept = np.flatnonzero((count == lengths) & (count > 0))
    matrix, limits = sparse.csr_array(inside[kept]), solution.limits[kept]
    equations = int(np.searchsorted(kept, problem.equations))
    multipliers = solution.multipliers[kept].copy()
    multipliers[:equations] = 0.0  # equations leave no slack
    # lambda (b - G z) of the kept rows is at most the spare; weighted @ z + spare remains.
    weighted, spare = matrix.T @ multipliers, -float(multipliers @ limits)
    sampled = np.flatnonzero(near[problem.sampled])
    cones = Cones(equations, len(kept) - equations)
    middle, room = np.full(len(chosen), problem.excess), np.ones(len(chosen))
    angles = np.flatnonzero(near)
    middle[: len(angles)] = (ranges.lower + ranges.upper)[angles] / 2.0
    room[: len(angles)] = (ranges.upper - ranges.lower)[angles] / 2.0
    less = sparse.csr_array(-weighted[np.newaxis])
    gradient = solution.gradient
    if problem.norm == "max":
        spare += problem.incumbent * float(np.abs(gradient).sum()) - solution.dual_value
        rows, right = [less], np.array([spare])
        cones = cones._replace(at_most=cones.at_most + 1)
    else:
        # |x - c|^2 <= weighted @ z + spare as a second-order cone: |2 (x - c), s - 1| <= s + 1.
        centre = (problem.desired - gradient / 2.0)[sampled]
        spare += len(problem.desired) * problem.incumbent**2 - solution.dual_value
        spare += float(gradient @ gradient) / 4.0
        distances = sparse.csr_array(
            (
                np.full(len(sampled), -2.0),
                (np.arange(len(sampled)), place[problem.sampled[sampled]]),
            ),
            shape=(len(sampled), len(chosen)),
        )
        rows = [less, less, distances]
        right = np.concatenate([[spare + 1.0, spare - 1.0], -2.0 * centre])
        cones = cones._replace(balls=(len(sampled) + 2,))
    return LocalProblem(
        place,
        sparse.csr_array(sparse.vstack([matrix, *rows])),
        np.concatenate([limits, right]),
        cones,
        middle,
        room,
    )
