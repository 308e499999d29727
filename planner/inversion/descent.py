"""The search of the optimised inversion: Gauss-Newton on a saturation sharpened in stages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.inversion.goal import quadratic
from planner.inversion.step import Pull, Quadratic, Response, Step, gauss_newton_step
from planner.inversion.tracking import Tracking
from planner.trajectory import Array

GUIDING = ((0.1,), (0.4, 0.1, 0.02))
"""Radii of the saturation's corners [theta_0] while the requests are led along the ideal: two ways
to end in different valleys, of which the better one is kept."""

SHARPENING = (0.1, 0.03, 0.008)
"""Radius of the saturation's corners [theta_0], stage by stage. Wider corners lead astray: measured
on random saturating trajectories, a start at 0.8 ends 1 % worse on average than one at 0.1."""

POWERS = (4.0, 8.0, 16.0, 32.0, 64.0)
"""The largest error is approached through sums of these powers of the errors, one by one."""

PULL = 1e-6
"""Weight on the distance of a request from the desired angle, at the first stage; it falls with the
square of the smoothing. It decides among requests that track equally well."""

QUIETING = (1e-4, 1e-3)
"""Weights that the pull is raised to at the end."""

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
    """One problem of the sequence.

    Attributes:
        smoothing: Radius of the saturation's corners [theta_0].
        power: The errors' exponent in the cost.
        pull: See ``PULL``.
        unit: Error that counts as one: where the largest error counts, the largest one so far.
    """

    smoothing: float
    power: float
    pull: float
    unit: float = 1.0


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


def stages(problem: Tracking, radii: tuple[float, ...]) -> list[Stage]:
    """The stages for the problem's norm, the smoothest first; the largest error comes last."""
    squares = [Stage(radius, 2.0, PULL * (radius / radii[0]) ** 2) for radius in radii]
    if problem.norm == "rms":
        return squares
    return squares + [squares[-1]._replace(power=power) for power in POWERS]


def improve(
    problem: Tracking, requests: Array, radii: tuple[float, ...] = SHARPENING
) -> tuple[Array, float]:
    """Requests that track at least as well as the given ones, and their exact error.

    Args:
        problem: What to reach, and within which limits.
        requests: Where to start [rad], shape (n, joints), within the limits.
        radii: Radius of the saturation's corners [theta_0], stage by stage.

    Returns:
        The best requests met, judged by the exact models, and that error.
    """
    best, least = requests, problem.exact_error(requests)
    damping = DAMPING[1]
    for stage in stages(problem, radii):
        requests, damping = descend(problem, requests, stage, damping)
        error = problem.exact_error(requests)
        if error < least:
            best, least = requests, error
    return best, least


def lead(problem: Tracking, requests: Array, radii: tuple[float, ...]) -> Array:
    """Requests that the stages reach from the given ones, unjudged: a start for a search."""
    damping = DAMPING[1]
    for stage in stages(problem, radii):
        requests, damping = descend(problem, requests, stage, damping)
    return requests


def quieten(problem: Tracking, requests: Array) -> tuple[Array, float]:
    """Requests that track as well as the given ones, to a part in 10,000, and stray less.

    Their pull towards the desired angles is made stronger as long as the error allows it.

    Args:
        problem: What to reach, and within which limits.
        requests: A good plan [rad], shape (n, joints).

    Returns:
        The requests, and their exact error.
    """
    error = least = problem.exact_error(requests)
    for pull in QUIETING:
        quieter = requests
        for stage in stages(problem, (SHARPENING[-2],)):
            quieter, _ = descend(problem, quieter, stage._replace(pull=pull), DAMPING[1])
        reached = problem.exact_error(quieter)
        if not reached <= least * (1.0 + AS_WELL):
            break
        requests, error, least = quieter, reached, min(least, reached)
    return requests, error


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
        except np.linalg.LinAlgError:  # so little damping that the matrix is not definite
            damping *= 6.0
            continue
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
