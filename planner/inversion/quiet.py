"""Of two plans that track equally well the quieter one."""

from __future__ import annotations

import numpy as np

from planner.inversion.stencil import Indices
from planner.inversion.tracking import Tracking
from planner.trajectory import Array

SMOOTHINGS = 6
"""Times that the idle requests are drawn to their moving average."""

BEYOND = 1.0 + 1e-9
"""Error from which on a joint moves at top speed, beyond rounding [theta_0]."""


ROUNDING = 1e-13
"""Difference of two errors that is none [rad]."""


def quieten(problem: Tracking, requests: Array) -> Array:
    """Requests under which the joints do the same, but that jump less.

    Where a joint moves at top speed whatever the request, within bounds, the request is idle: it is
    drawn to the average of its neighbours, a few times, as far as those bounds go.

    Args:
        problem: What is to be reached, and within which limits.
        requests: A good plan [rad], shape (n, joints).

    Returns:
        The quieter requests, or the given ones.
    """
    angles = problem.exact_angles(requests)
    if angles is None:
        return requests
    lower, upper = idle_between(problem, requests, angles)
    quieter, around = requests, neighbours(problem)
    for _ in range(SMOOTHINGS):
        quieter = np.clip(quieter.take(around, axis=0).mean(axis=0), lower, upper)
    return quieter if problem.exact_error(quieter) <= problem.error(angles) + ROUNDING else requests


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
