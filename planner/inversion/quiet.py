"""Of two plans that track equally well the quieter one."""

from __future__ import annotations

import math

import numpy as np

from planner.inversion.calming import restlessness
from planner.inversion.descent import AS_WELL, JUDGED, SEARCH, descend, stages
from planner.inversion.goal import quadratic
from planner.inversion.iterate import Stage, State
from planner.inversion.stencil import Indices
from planner.inversion.tracking import Tracking
from planner.trajectory import Array

CALMING = tuple(
    Stage(smoothing, pull, steps=3, calming=True)
    for smoothing, pull in ((0.1, 16.0), (0.04, 16.0), (0.015, 8.0), (0.006, 2.0))
)
"""Stages under a pull on the squared changes of the requests, in units of the one under which all
of these cost as much as the error that may be added. Wide corners first: where they are sharp the
requests hardly leave the place where they are. The first plan that the error bears is taken."""

STRONGER = 4.0
"""How much stronger the pull becomes from one round of stages to the next."""

UNCHANGED = 1e-24
"""Sum of squared changes that is none [rad^2]."""

SMOOTHINGS = 6
"""Times that the idle requests are drawn to their moving average."""

BEYOND = 1.0 + 1e-9
"""Error from which on a joint moves at top speed, beyond rounding [theta_0]."""

ROUNDING = 1e-13
"""Difference of two errors that is none [rad]."""


def quieten(
    problem: Tracking,
    requests: Array,
    *,
    at_most: float = math.inf,
    seam: Array | None = None,
    rounds: int = 1,
) -> Array:
    """Requests that track as well as the given ones, to 2 parts in 10,000, but change less.

    They are put under a pull on their squared changes, as strong as the error allows. Then, where a
    joint moves at top speed whatever the request, within bounds, the request is idle: it is drawn
    to the average of its neighbours, a few times, as far as those bounds go.

    Args:
        problem: What is to be reached, and within which limits.
        requests: A good plan [rad], shape (n, joints).
        at_most: Error that is not to be passed in any case.
        seam: Angles near which a cycle's seam is sought [rad], shape (joints,).
        rounds: How often at most a pull is tried, each time a stronger one.

    Returns:
        The quieter requests, or the given ones.
    """
    angles = problem.exact_angles(requests, seam)
    if angles is None:
        return requests
    given = State(requests, angles)
    most = min(problem.error(angles) * (1.0 + AS_WELL), at_most)
    calmer = _calmed(problem, given, most, rounds)
    return with_idle_smoothed(problem, calmer.requests, calmer.angles)


def with_idle_smoothed(problem: Tracking, requests: Array, angles: Array) -> Array:
    """Requests under which the joints do the same, idle ones nearer to their neighbours.

    Args:
        problem: The joints, and the limits on their requests.
        requests: Requests [rad], shape (n, joints).
        angles: What the exact models make of them [rad], shape (n, joints).
    """
    lower, upper = idle_between(problem, requests, angles)
    quieter, around = requests, neighbours(problem)
    for _ in range(SMOOTHINGS):
        quieter = np.clip(quieter.take(around, axis=0).mean(axis=0), lower, upper)
    same = problem.exact_error(quieter, angles[-1]) <= problem.error(angles) + ROUNDING
    return quieter if same else requests


def _calmed(problem: Tracking, given: State, most: float, rounds: int) -> State:
    """The calmest requests of all rounds that the error bears, with their angles, or the given."""
    error, power = problem.error(given.angles), stages(problem, SEARCH)[-1].power
    errors, unit = problem.goal.errors(given.angles), max(error, np.finfo(np.float64).tiny)
    # What the cost rises by when every error rises by the share of it that may be added.
    allowed = power * AS_WELL * quadratic(errors, power=power, unit=unit, ridge=0.0).value
    calmest = state = given
    for number in range(rounds):
        strength = STRONGER**number * allowed
        calmer, state = _one_round(problem, calmest, state, most, strength, power)
        if calmer is None:
            break
        calmest = calmer
    return calmest


def _one_round(
    problem: Tracking, calmest: State, state: State, most: float, strength: float, power: float
) -> tuple[State | None, State]:
    """The first calmer requests that the error bears, None if there are none, and the last met."""
    restless = restlessness(state.requests, cyclic=problem.cyclic)
    least = restlessness(calmest.requests, cyclic=problem.cyclic)
    for stage in CALMING:
        if restless <= UNCHANGED:
            break
        pull = stage.pull * strength / restless
        state = descend(problem, state, stage._replace(pull=pull, power=power))
        restless = restlessness(state.requests, cyclic=problem.cyclic)
        if stage.smoothing >= JUDGED or restless >= least:
            continue
        angles = problem.exact_angles(state.requests, state.angles[-1])
        if angles is not None and problem.error(angles) <= most:
            return State(state.requests, angles), state
    return None, state


def idle_between(problem: Tracking, requests: Array, angles: Array) -> tuple[Array, Array]:
    """Smallest and largest value of each request that change nothing, others unchanged (n, joints).

    Args:
        problem: The joints, and the limits on their requests.
        requests: Requests [rad], shape (n, joints).
        angles: What the exact models make of them [rad], shape (n, joints).
    """
    stencil = problem.stencil
    before = angles[stencil.before]
    if problem.start is not None:
        before[0] = problem.start
    before = before - problem.offsets
    # Between two samples a held request is met by angles this much further on at most.
    beyond = np.array(
        [BEYOND * m.theta_0 + (m.hold - 1) * m.v_max_per_tick for m in problem.models]
    )
    windows = stencil.windows(requests)
    above, below = windows >= before + beyond, windows <= before - beyond
    idle = problem.movable & (stencil.gathered(np.where(above | below, 0.0, 1.0)) == 0.0)
    lower = stencil.gathered(np.where(above, before + beyond, -np.inf), np.maximum, -np.inf)
    upper = stencil.gathered(np.where(below, before - beyond, np.inf), np.minimum, np.inf)
    return (
        np.where(idle, np.maximum(lower, problem.lower), requests),
        np.where(idle, np.minimum(upper, problem.upper), requests),
    )


def neighbours(problem: Tracking) -> Indices:
    """For each request those around it, as many as act on a joint at once: (2 half + 1, n)."""
    half, count = max(problem.reach.width // 2, 1), len(problem.resting)
    around = np.arange(count) + np.arange(-half, half + 1)[:, np.newaxis]
    return around % count if problem.cyclic else around.clip(0, count - 1)
