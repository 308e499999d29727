"""The search of the optimised inversion: Gauss-Newton on a saturation sharpened in stages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planner.inversion.goal import quadratic
from planner.inversion.step import Pull, Quadratic, Response, Step, gauss_newton_step
from planner.inversion.tracking import Tracking
from planner.trajectory import Array

POWERS = (4.0, 8.0, 16.0, 32.0, 64.0)
"""The largest error is approached through sums of these powers of the errors, one by one."""

QUIETING = (1e-3, 1e-4)
"""Pulls that the plan's requests are put under at the end, the first that they bear."""

AS_WELL = 1e-4
"""Relative error that quieter requests may cost."""

ENOUGH = 1e-4
"""A stage ends when a step lowers its cost by less than this fraction."""

MOST_STEPS = 12
"""Steps in one stage: the next stage carries on where this one stops."""

DAMPING = (1e-9, 1e-4, 1e2)
"""Least, first and largest weight on the size of a step, relative to that on the errors."""

ACTIVE_SET_ROUNDS = 3
"""How often requests that would leave their limits are held there and the step is taken anew."""


class Stage(NamedTuple):
    """One problem of a search.

    Attributes:
        smoothing: Radius of the saturation's corners [theta_0].
        pull: Weight on the squared distance of the requests from those that would hold the desired
            angles, relative to that on the squared errors.
        power: The errors' exponent in the cost.
        unit: Error that counts as one: where the largest error counts, the largest one so far.
    """

    smoothing: float
    pull: float
    power: float = 2.0
    unit: float = 1.0


SEARCH = (
    Stage(0.4, 1e-2),
    Stage(0.2, 1e-3),
    Stage(0.1, 1e-4),
    Stage(0.03, 1e-4),
    Stage(0.008, 1e-4),
    Stage(0.008, 1e-8),
)
"""The stages of a search. A pull keeps the first ones out of the plains where saturated requests no
longer count; on random saturating trajectories this order of corners and pulls came within 0.1 % of
the best known plan on average, and within 0.4 % on all of 48, of twelve that were tried."""


class Iterate(NamedTuple):
    """Requests, the smoothed models' answer to them, and what they cost."""

    requests: Array
    response: Response
    cost: Quadratic
    pull: Pull

    @property
    def value(self) -> float:
        """The stage's cost."""
        return self.cost.value + self.pull.value


def stages(problem: Tracking, search: Sequence[Stage]) -> list[Stage]:
    """The search's stages, and where the largest error counts those that turn to it."""
    if problem.norm == "rms":
        return list(search)
    return [*search, *(search[-1]._replace(power=power) for power in POWERS)]


def improve(
    problem: Tracking, requests: Array, search: Sequence[Stage] = SEARCH
) -> tuple[Array, float]:
    """Requests that track at least as well as the given ones, and their exact error.

    Args:
        problem: What to reach, and within which limits.
        requests: Where to start [rad], shape (n, joints), within the limits.
        search: The stages to go through.

    Returns:
        The best requests met, judged by the exact models, and that error.
    """
    best, least = requests, problem.exact_error(requests)
    damping = DAMPING[1]
    for stage in stages(problem, search):
        requests, damping = descend(problem, requests, stage, damping)
        error = problem.exact_error(requests)
        if error < least:
            best, least = requests, error
    return best, least


def quieten(problem: Tracking, requests: Array, *, at_most: float) -> Array:
    """Requests that track as well as the given ones, to a part in 10,000, and stray less.

    They are put under the strongest pull towards the desired angles that the error allows.

    Args:
        problem: What to reach, and within which limits.
        requests: A good plan [rad], shape (n, joints).
        at_most: Error that is not to be passed in any case.

    Returns:
        The quieter requests, or the given ones.
    """
    least = problem.exact_error(requests)
    last = stages(problem, SEARCH)[-1]
    for pull in QUIETING:
        quieter, _ = descend(problem, requests, last._replace(pull=pull), DAMPING[1])
        reached = problem.exact_error(quieter)
        if reached <= min(least * (1.0 + AS_WELL), at_most):
            return quieter
    return requests


def descend(
    problem: Tracking, requests: Array, stage: Stage, damping: float
) -> tuple[Array, float]:
    """Lower one stage's cost by damped Gauss-Newton steps.

    Returns:
        The requests reached, and the damping that served last.
    """
    least_damping, _, most_damping = DAMPING
    damping = max(damping, 1e3 * least_damping)
    response = problem.respond(
        requests, smoothing=stage.smoothing, seam=problem.resting[-1] + problem.offsets
    )
    if response is None:
        return requests, damping
    if stage.power > 2.0:
        largest = float(np.max(problem.goal.distances(response.angles)))
        stage = stage._replace(unit=max(largest, np.finfo(np.float64).tiny))
    current = _iterate(problem, requests, response, stage)
    for _ in range(MOST_STEPS):
        try:
            step = _step(problem, current, damping)
        except np.linalg.LinAlgError:  # the matrix is singular to working precision
            break
        gain = current.value - step.expected
        following = _follow(problem, current, step, stage)
        if following is None or following.value >= current.value:
            damping *= 6.0
            if damping > most_damping or gain < 0.1 * ENOUGH * current.value:
                break
            continue
        lowered = current.value - following.value
        if lowered > 0.6 * gain:
            damping = max(damping / 5.0, least_damping)
        elif lowered < 0.2 * gain:
            damping *= 3.0
        current = following
        if lowered < ENOUGH * current.value:
            break
    return current.requests, damping


def _iterate(problem: Tracking, requests: Array, response: Response, stage: Stage) -> Iterate:
    cost = quadratic(
        problem.goal.errors(response.angles),
        power=stage.power,
        unit=stage.unit,
        ridge=problem.ridge,
    )
    return Iterate(requests, response, cost, Pull(stage.pull, requests - problem.resting))


def _follow(problem: Tracking, current: Iterate, step: Step, stage: Stage) -> Iterate | None:
    requests = problem.admissible(current.requests + step.requests)
    response = problem.respond(
        requests,
        smoothing=stage.smoothing,
        seam=current.response.angles[-1] + step.angles[-1],
    )
    return None if response is None else _iterate(problem, requests, response, stage)


def _step(problem: Tracking, current: Iterate, damping: float) -> Step:
    """The Gauss-Newton step that holds requests at the limits they would leave."""
    free = problem.movable
    for _ in range(ACTIVE_SET_ROUNDS):
        step = gauss_newton_step(
            problem.stencil,
            current.response,
            current.cost,
            pull=current.pull,
            damping=damping,
            free=free,
        )
        outward = free & (
            ((current.requests <= problem.lower) & (step.requests < 0.0))
            | ((current.requests >= problem.upper) & (step.requests > 0.0))
        )
        if not outward.any():
            break
        free = free & ~outward
    return step
