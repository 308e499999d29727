"""The exact level: spatial branch and bound over the intervals of single requests.

The distance of a convex relaxation is a bound. It is raised by tightening ranges and by cutting
planes and, where a request's contributions are a mixture of those of two requests, by branching on
whether the request is above or below the one in between (Land and Doig 1960).
"""

from __future__ import annotations

import heapq
import logging
from dataclasses import dataclass
from itertools import count
from time import perf_counter
from typing import NamedTuple

import numpy as np

from planner.inversion.bounds.hull_cuts import UNBOUNDED, RequestSet, nearest_request
from planner.inversion.bounds.reachable_set import BoundProblem
from planner.inversion.bounds.saturation_relaxation import (
    Cut,
    Intervals,
    Ranges,
    RelaxedSolution,
    ScaledProblem,
    solve_relaxation,
    violated_cuts,
)
from planner.inversion.bounds.tightening import tighten

TIME_LIMIT = 60.0
"""Seconds after which the search stops with what it has proved."""

INACTIVE = 1e-9
"""A cut whose multiplier is smaller is dropped: what an interior-point method leaves of zero."""


@dataclass(frozen=True)
class BranchAndBoundOptions:
    """When the search is done with a node, and with all.

    Attributes:
        gap: Relative gap to the incumbent at which the search stops [-]; smoothing costs a plan
            2e-4 of its error, and less cannot be told from that.
        absolute_gap: Gap to the incumbent at which it stops as well [v_max ticks].
        gain: Relative gain of a round of tightening from which on another follows [-]; at 1e-3
            the bounds of 13 problems are 0.1 % lower in the mean, at 5e-2 the median gap doubles.
    """

    gap: float = 5e-4
    absolute_gap: float = 1e-4
    gain: float = 1e-2


OPTIONS = BranchAndBoundOptions()


class Node(NamedTuple):
    """A part of all responses: the intervals of requests, and what is known about the responses.

    Attributes:
        bound: None has a smaller error [v_max ticks].
        intervals: Where requests are, for those that were branched on.
        ranges: Where angles and speeds are.
        cuts: The active cuts.
        solution: The nearest point of the node's relaxation.
    """

    bound: float
    intervals: Intervals
    ranges: Ranges
    cuts: list[Cut]
    solution: RelaxedSolution


def exact_bound(problem: BoundProblem, incumbent: float, *, time_limit: float) -> float:
    """An error that no requests go below, at most the incumbent's [rad].

    Args:
        problem: The joint, and what is desired of it.
        incumbent: Any error, best that of a good plan [rad]; the answer is valid whatever it is, as
            all conclusions are about responses that are better.
        time_limit: When to stop [s].
    """
    until = perf_counter() + time_limit
    scaled = ScaledProblem(problem, incumbent)
    root = _root(scaled, until)
    order = count()
    nodes = [(root.bound, next(order), root)]
    while not _closed(scaled, nodes[0][0]) and perf_counter() < until:
        _, _, node = heapq.heappop(nodes)
        for child in branch(scaled, node, until):
            heapq.heappush(nodes, (child.bound, next(order), child))
    logging.getLogger(__name__).debug(
        "exact bound: %s at %.4g of the incumbent's error, %d nodes open",
        "closed" if _closed(scaled, nodes[0][0]) else "out of time",
        nodes[0][0] / scaled.incumbent if scaled.incumbent else 1.0,
        len(nodes),
    )
    return min(nodes[0][0] * scaled.unit, incumbent)


def _root(problem: ScaledProblem, until: float) -> Node:
    """All responses, their ranges tightened and their hulls cut until little is gained."""
    ranges = problem.initial_ranges()
    solution = solve_relaxation(problem, ranges, [])
    bound = min(solution.bound, problem.incumbent)
    node = Node(bound, dict(problem.fixed), ranges, [], solution)
    while not _closed(problem, node.bound):
        before = node.bound
        if tighten(problem, ranges, node.solution, range(problem.ticks), until=until):
            node = cut_off(problem, node)
        else:
            node = node._replace(bound=problem.incumbent)
        if node.bound < before * (1.0 + OPTIONS.gain) or perf_counter() >= until:
            break
    return node


def _closed(problem: ScaledProblem, bound: float) -> bool:
    allowed = max(OPTIONS.gap * problem.incumbent, OPTIONS.absolute_gap)
    return problem.incumbent - bound <= allowed


def cut_off(problem: ScaledProblem, node: Node) -> Node:
    """The node with the cuts that its nearest point violates, and the bound that they prove."""
    ranges, cuts = node.ranges, node.cuts
    solution = solve_relaxation(problem, ranges, cuts)
    bound = max(node.bound, solution.bound)
    found = violated_cuts(problem, ranges, solution, node.intervals)
    if found and bound < problem.incumbent:
        cuts = [cut for cut, weight in _weighted(cuts, solution) if weight > INACTIVE] + found
        solution = solve_relaxation(problem, ranges, cuts)
        bound = max(bound, solution.bound)
    return Node(min(bound, problem.incumbent), node.intervals, ranges, cuts, solution)


def branch(problem: ScaledProblem, node: Node, until: float) -> list[Node]:
    """Two nodes that are the node together: one request is on either side of a value."""
    request, value = branching_request(problem, node)
    lower, upper = node.intervals.get(request, UNBOUNDED)
    acting = problem.windows[request].angles
    children = []
    for side in ((lower, value), (value, upper)):
        intervals = {**node.intervals, request: side}
        child = cut_off(problem, node._replace(intervals=intervals, ranges=node.ranges.copy()))
        if node.bound * (1.0 + OPTIONS.gain) < child.bound < problem.incumbent:
            if tighten(problem, child.ranges, child.solution, acting, until=until):
                child = cut_off(problem, child)
            else:
                child = child._replace(bound=problem.incumbent)
        children.append(child)
    return children


def branching_request(problem: ScaledProblem, node: Node) -> tuple[int, float]:
    """The request whose mixture of contributions weighs most, and the request nearest to it."""
    weights = dict.fromkeys(problem.windows, 0.0)
    owner = {id(window): request for request, window in problem.windows.items()}
    for cut, weight in _weighted(node.cuts, node.solution):
        weights[owner[id(cut.window)]] += float(weight * np.linalg.norm(cut.hull.nu))
    best = (-1.0, 0, 0.0)
    for request, window in problem.windows.items():
        angles = node.solution.angles[window.angles]
        requests = RequestSet(problem.gain, angles, angles, node.intervals.get(request, UNBOUNDED))
        value, distance = nearest_request(
            node.solution.contributions[window.contributions], angles, requests
        )
        best = max(best, (weights[request] * distance, request, value))
    return best[1], best[2]


def _weighted(cuts: list[Cut], solution: RelaxedSolution) -> list[tuple[Cut, float]]:
    """The cuts, the last rows of their relaxation, with their multipliers."""
    multipliers = solution.multipliers[len(solution.multipliers) - len(cuts) :]
    return list(zip(cuts, multipliers.tolist(), strict=True))
