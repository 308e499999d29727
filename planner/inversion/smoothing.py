"""Of two plans that track equally well the smoother one: a smaller sum of squared changes, Σ(ΔR)².

More Gauss-Newton steps are taken with that sum as the regularisation, as strong as the error
allows. Then, where a joint moves at top speed whatever the request, within bounds, the request is
saturated: it is drawn to the average of its neighbours, as far as those bounds go.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.inversion.gauss_newton import (
    OPTIONS as SEARCH_OPTIONS,
)
from planner.inversion.gauss_newton import (
    Stage,
    State,
    changes,
    descend,
    power_cost,
    stages_for,
)
from planner.inversion.tracking_problem import Indices, TrackingProblem
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class SmoothingOptions:
    """What steers the smoothing.

    In brackets what half and twice the value do to Σ(ΔR)² over 109 plans; the error follows
    ``error_share``.

    Attributes:
        error_share: Relative rise of the error that smoother requests may cost (+2.8 %, -1.7 %).
        stages: The stages of a round. Their weights are in units of the one under which all the
            squared changes cost as much as the rise (of the weights: +1.6 %, +1.7 %, and more
            time). Wide corners first: where they are sharp the requests hardly leave the place
            where they are. The first plan that the error bears is taken.
        growth: How much larger the weights become from one round to the next.
        averages: How often the saturated requests are drawn to their moving average (+1.3 %,
            -1.0 %; never: +14 %).
    """

    error_share: float = 2e-4
    stages: tuple[Stage, ...] = tuple(
        Stage(radius, weight, steps=3, smoothing=True)
        for radius, weight in ((0.1, 16.0), (0.04, 16.0), (0.015, 8.0), (0.006, 2.0))
    )
    growth: float = 4.0
    averages: int = 6


OPTIONS = SmoothingOptions()

UNCHANGED = 1e-24
"""Sum of squared changes from which on requests count as constant [rad^2]."""

SATURATED = 1.0 + 1e-9
"""Error from which on a joint moves at top speed, beyond rounding [theta_0]."""

SAME_ERROR = 1e-13
"""Errors that differ by no more than this are equal: rounding [rad]."""


def smoothed(
    problem: TrackingProblem,
    requests: Array,
    *,
    at_most: float = math.inf,
    boundary: Array | None = None,
    rounds: int = 1,
) -> Array:
    """Requests that track as well as the given ones, to 2 parts in 10,000, but change less.

    Args:
        problem: What is to be reached, and within which limits.
        requests: A good plan [rad], shape (n, joints).
        at_most: Error that is not to be passed in any case.
        boundary: Angles near which a cycle's boundary is sought [rad], shape (joints,).
        rounds: How often at most the stages are gone through, each time with larger weights.

    Returns:
        The smoother requests, or the given ones.
    """
    angles = problem.exact_angles(requests, boundary)
    if angles is None:
        return requests
    most = min(problem.error(angles) * (1.0 + OPTIONS.error_share), at_most)
    smoother = _with_fewer_changes(problem, State(requests, angles), most, rounds)
    return saturated_averaged(problem, smoother.requests, smoother.angles)


def saturated_averaged(problem: TrackingProblem, requests: Array, angles: Array) -> Array:
    """Requests under which the joints do the same, saturated ones nearer to their neighbours.

    Args:
        problem: The joints, and the limits on their requests.
        requests: Requests [rad], shape (n, joints).
        angles: What the exact models make of them [rad], shape (n, joints).
    """
    lower, upper = room_of_saturated(problem, requests, angles)
    smoother, around = requests, neighbours(problem)
    for _ in range(OPTIONS.averages):
        smoother = np.clip(smoother.take(around, axis=0).mean(axis=0), lower, upper)
    same = problem.exact_error(smoother, angles[-1]) <= problem.error(angles) + SAME_ERROR
    return smoother if same else requests


def squared_changes(requests: Array, *, cyclic: bool) -> float:
    """The sum of the squared changes, Σ(ΔR)² [rad^2]."""
    steps = changes(requests, cyclic=cyclic)
    return float(np.vdot(steps, steps))


def _with_fewer_changes(problem: TrackingProblem, given: State, most: float, rounds: int) -> State:
    """The smoothest requests of all rounds that the error bears, with their angles."""
    power = stages_for(problem, SEARCH_OPTIONS.narrow)[-1].power
    unit = max(problem.error(given.angles), np.finfo(np.float64).tiny)
    cost = power_cost(problem.goal.errors(given.angles), power=power, unit=unit, ridge=0.0)
    # What the cost rises by when every error rises by the share of it that may be added.
    allowed = power * OPTIONS.error_share * cost.value
    smoothest = state = given
    for number in range(rounds):
        weight = OPTIONS.growth**number * allowed
        smoother, state = _one_round(problem, smoothest, state, most, weight, power)
        if smoother is None:
            break
        smoothest = smoother
    return smoothest


def _one_round(
    problem: TrackingProblem,
    smoothest: State,
    state: State,
    most: float,
    weight: float,
    power: float,
) -> tuple[State | None, State]:
    """The first smoother requests that the error bears, None if there are none; the last met."""
    sum_now = squared_changes(state.requests, cyclic=problem.cyclic)
    least = squared_changes(smoothest.requests, cyclic=problem.cyclic)
    for stage in OPTIONS.stages:
        if sum_now <= UNCHANGED:
            break
        weighted = stage._replace(weight=stage.weight * weight / sum_now, power=power)
        state = descend(problem, state, weighted)
        sum_now = squared_changes(state.requests, cyclic=problem.cyclic)
        if stage.radius >= SEARCH_OPTIONS.simulated or sum_now >= least:
            continue
        angles = problem.exact_angles(state.requests, state.angles[-1])
        if angles is not None and problem.error(angles) <= most:
            return State(state.requests, angles), state
    return None, state


def room_of_saturated(
    problem: TrackingProblem, requests: Array, angles: Array
) -> tuple[Array, Array]:
    """Smallest and largest value of each request that change nothing, others unchanged (n, joints).

    Args:
        problem: The joints, and the limits on their requests.
        requests: Requests [rad], shape (n, joints).
        angles: What the exact models make of them [rad], shape (n, joints).
    """
    windows = problem.windows
    before = angles[windows.before]
    if problem.start is not None:
        before[0] = problem.start
    before = before - problem.offsets
    # Between two samples a held request is met by angles this much further on at most.
    beyond = np.array(
        [SATURATED * m.theta_0 + (m.hold - 1) * m.v_max_per_tick for m in problem.models]
    )
    sent = windows.of(requests)
    above, below = sent >= before + beyond, sent <= before - beyond
    unsaturated = windows.gathered(np.where(above | below, 0.0, 1.0))
    saturated = problem.movable & (unsaturated == 0.0)
    lower = windows.gathered(np.where(above, before + beyond, -np.inf), np.maximum, -np.inf)
    upper = windows.gathered(np.where(below, before - beyond, np.inf), np.minimum, np.inf)
    return (
        np.where(saturated, np.maximum(lower, problem.lower), requests),
        np.where(saturated, np.minimum(upper, problem.upper), requests),
    )


def neighbours(problem: TrackingProblem) -> Indices:
    """For each request those around it, as many as act on a joint at once: (2 half + 1, n)."""
    half, count = max(problem.ages.width // 2, 1), len(problem.resting)
    around = np.arange(count) + np.arange(-half, half + 1)[:, np.newaxis]
    return around % count if problem.cyclic else around.clip(0, count - 1)
