"""The exact bound: branch and bound over where single requests are.

The relaxation's distance is a bound. It is raised by narrowing ranges and adding cuts, and, where a
request's calls are a mixture of those of two requests, by treating the two sides apart.
"""

from __future__ import annotations

import heapq
import logging
from itertools import count
from time import perf_counter
from typing import NamedTuple

import numpy as np

from planner.inversion.bounds.hull_cuts import ANYWHERE, Place, nearest_request
from planner.inversion.bounds.reachable_set import BoundProblem
from planner.inversion.bounds.saturation_relaxation import (
    Cut,
    Proof,
    Ranges,
    Task,
    nearest,
    violated,
)
from planner.inversion.bounds.tightening import tighten

TIME_LIMIT = 60.0
"""Seconds after which the search stops with what it has proved."""

CLOSED = 5e-4
"""Relative gap to the known error at which the search stops; quiet plans give away 2e-4 of it."""

NEGLIGIBLE = 1e-4
"""Gap to the known error at which it stops as well [v_max ticks]."""

WORTH_A_SWEEP = 1e-2
"""Relative gain of one round of narrowing from which on another follows at once."""

WORTH_A_ROUND = 5e-4
"""Relative gain of one round of cuts from which on another follows."""

MOST_ROUNDS = 6
"""Rounds of cuts in a row."""

NEEDED = 1e-9
"""A cut whose multiplier is smaller is dropped."""

SHARE = 0.6
"""Share of the time that may be spent before the first branch."""


class Node(NamedTuple):
    """Part of all responses: where requests are, and what is known about the responses.

    Attributes:
        bound: None has a smaller error [v_max ticks].
        between: Where requests are, for those that are known to be somewhere.
        ranges: Where angles and speeds are.
        cuts: The cuts that matter.
        proof: The nearest point of its relaxation.
    """

    bound: float
    between: dict[int, tuple[float, float]]
    ranges: Ranges
    cuts: list[Cut]
    proof: Proof


def exact_bound(problem: BoundProblem, known: float, *, time_limit: float) -> float:
    """An error that no requests go below, at most ``known`` [rad].

    Args:
        problem: The joint, and what is wanted of it.
        known: Any error, best that of a good plan [rad]; the answer is valid whatever it is, as
            all conclusions are about responses that are better.
        time_limit: When to stop [s].
    """
    until = perf_counter() + time_limit
    task = Task(problem, known)
    root = _root(task, perf_counter() + SHARE * time_limit)
    order = count()
    nodes = [(root.bound, next(order), root)]
    while not _closed(task, nodes[0][0]) and perf_counter() < until:
        _, _, node = heapq.heappop(nodes)
        for child in branches(task, node, until):
            heapq.heappush(nodes, (child.bound, next(order), child))
    logging.getLogger(__name__).debug(
        "exact bound: %s at %.4g of the known error, %d parts open",
        "closed" if _closed(task, nodes[0][0]) else "out of time",
        nodes[0][0] / task.known if task.known else 1.0,
        len(nodes),
    )
    return min(nodes[0][0] * task.unit, known)


def _root(task: Task, until: float) -> Node:
    ranges = task.initial_ranges()
    proof = nearest(task, ranges, [])
    node = Node(min(proof.error, task.known), dict(task.pinned), ranges, [], proof)
    while not _closed(task, node.bound):
        before = node.bound
        possible = tighten(task, ranges, node.proof, range(task.ticks), until=until)
        node = strengthen(task, node, until) if possible else node._replace(bound=task.known)
        settled = node.bound < before * (1.0 + WORTH_A_SWEEP)
        if settled or _closed(task, node.bound) or perf_counter() >= until:
            break
    return node


def _closed(task: Task, bound: float) -> bool:
    return task.known - bound <= max(CLOSED * task.known, NEGLIGIBLE)


def strengthen(task: Task, node: Node, until: float) -> Node:
    """The node with the cuts that its nearest points call for, and the bound that they prove."""
    ranges, cuts = node.ranges, node.cuts
    proof = nearest(task, ranges, cuts)
    bound = max(node.bound, proof.error)
    for _ in range(MOST_ROUNDS):
        if bound >= task.known or perf_counter() >= until:
            break
        found = violated(task, ranges, proof, node.between)
        if not found:
            break
        kept = [cut for cut, weight in zip(cuts, proof.weights, strict=True) if weight > NEEDED]
        cuts = kept + found
        proof = nearest(task, ranges, cuts)
        gained = proof.error > bound * (1.0 + WORTH_A_ROUND)
        bound = max(bound, proof.error)
        if not gained:
            break
    return Node(min(bound, task.known), node.between, ranges, cuts, proof)


def branches(task: Task, node: Node, until: float) -> list[Node]:
    """Two parts that are the node together: one request is on either side of where it should be."""
    request, split = most_mixed(task, node)
    lower, upper = node.between.get(request, ANYWHERE)
    acting = task.acting[request].ticks
    children = []
    for side in ((lower, split), (split, upper)):
        between = {**node.between, request: side}
        child = strengthen(task, node._replace(between=between, ranges=node.ranges.copy()), until)
        if node.bound * (1.0 + WORTH_A_SWEEP) < child.bound < task.known:
            if tighten(task, child.ranges, child.proof, acting, until=until):
                child = strengthen(task, child, until)
            else:
                child = child._replace(bound=task.known)
        children.append(child)
    return children


def most_mixed(task: Task, node: Node) -> tuple[int, float]:
    """The request whose mixture of calls matters most, and the request nearest to the mixture."""
    matters = dict.fromkeys(task.acting, 0.0)
    owner = {id(acting): request for request, acting in task.acting.items()}
    for cut, weight in zip(node.cuts, node.proof.weights, strict=True):
        matters[owner[id(cut.acting)]] += float(weight * np.linalg.norm(cut.hull.by_call))
    best = (-1.0, 0, 0.0)
    for request, acting in task.acting.items():
        angles = node.proof.angles[acting.ticks]
        place = Place(task.gain, angles, angles, node.between.get(request, ANYWHERE))
        where, distance = nearest_request(node.proof.calls[acting.calls], angles, place)
        best = max(best, (matters[request] * distance, request, where))
    return best[1], best[2]
