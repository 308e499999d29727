"""The search of the optimised inversion: Gauss-Newton on a saturation sharpened in stages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.inversion.step import Step, gauss_newton_step
from planner.inversion.tracking import Tracking
from planner.model.transition import Linearised
from planner.trajectory import Array

GUIDING = ((0.1,), (0.4, 0.1, 0.02))
"""Radii of the saturation's corners [theta_0] while the requests are led along the ideal: two ways
to end in different valleys, of which the better one is kept."""

SHARPENING = (0.1, 0.04, 0.02, 0.008)
"""Radius of the saturation's corners [theta_0], stage by stage. Wider corners lead astray: measured
on random saturating trajectories, a start at 0.8 ends 1 % worse on average than one at 0.1."""

POWERS = (4.0, 8.0, 16.0, 32.0, 64.0)
"""The largest error is approached through sums of these powers of the errors, one by one."""

PULL = 1e-6
"""Weight on the distance of a request from the desired angle, at the first stage; it falls with the
square of the smoothing. It decides among requests that track equally well."""

ENOUGH = 1e-4
"""A stage ends when a step lowers its cost by less than this fraction."""

MOST_STEPS = 12
"""Steps in one stage: the next stage carries on where this one stops."""

DAMPING = (1e-9, 1e-4, 1e2)
"""Least, first and largest weight on the size of a step, relative to that on the errors."""


LEAST_WEIGHT = 1e-6
"""Weight on errors that the cost's power makes vanish, which keeps the step's matrix definite."""

ACTIVE_SET_ROUNDS = 3
"""How often requests that would leave their limits are held there and the step is taken anew."""


class Stage(NamedTuple):
    """One problem of the sequence.

    Attributes:
        smoothing: Radius of the saturation's corners [rad].
        power: The errors' exponent in the cost.
        pull: See ``PULL``.
    """

    smoothing: float
    power: float
    pull: float


class Iterate(NamedTuple):
    """Requests and the smoothed model's answer to them."""

    requests: Array
    run: Linearised
    cost: float


def stages(problem: Tracking, radii: tuple[float, ...]) -> list[Stage]:
    """The stages for the problem's norm, the smoothest first; the largest error comes last."""
    squares = [
        Stage(radius * problem.model.theta_0, 2.0, PULL * (radius / radii[0]) ** 2)
        for radius in radii
    ]
    if problem.norm == "rms":
        return squares
    return squares + [squares[-1]._replace(power=power) for power in POWERS]


def improve(
    problem: Tracking, requests: Array, radii: tuple[float, ...] = SHARPENING
) -> tuple[Array, float]:
    """Requests that track at least as well as the given ones, and their exact error.

    Args:
        problem: What to follow, and within which limits.
        requests: Where to start [rad], shape (n,), within the limits.
        radii: Radius of the saturation's corners [theta_0], stage by stage.

    Returns:
        The best requests met, judged by the exact model, and that error [rad].
    """
    best, least = requests, problem.exact_error(requests)
    damping = DAMPING[1]
    for stage in stages(problem, radii):
        requests, damping = descend(problem, requests, stage, damping)
        error = problem.exact_error(requests)
        if error < least:
            best, least = requests, error
    return best, least


def descend(
    problem: Tracking, requests: Array, stage: Stage, damping: float
) -> tuple[Array, float]:
    """Lower one stage's cost by damped Gauss-Newton steps.

    Returns:
        The requests reached, and the damping that served last.
    """
    least_damping, _, most_damping = DAMPING
    damping = max(damping, 1e3 * least_damping)
    current = _start(problem, requests, stage)
    if current is None:
        return requests, damping
    unit = max(float(np.max(np.abs(current.run.angles - problem.desired))), 1e-12)
    current = current._replace(cost=_cost(problem, current.requests, current.run, stage, unit))
    for _ in range(MOST_STEPS):
        step, expected = _step(problem, current, stage, unit, damping)
        gain = current.cost - expected
        following = _follow(problem, current, step, stage, unit)
        if following is None or following.cost >= current.cost:
            damping *= 6.0
            if damping > most_damping or gain < 0.1 * ENOUGH * current.cost:
                break
            continue
        lowered = current.cost - following.cost
        if lowered > 0.6 * gain:
            damping = max(damping / 5.0, least_damping)
        elif lowered < 0.2 * gain:
            damping *= 3.0
        current = following
        if lowered < ENOUGH * current.cost:
            break
    return current.requests, damping


def _start(problem: Tracking, requests: Array, stage: Stage) -> Iterate | None:
    run = problem.linearise(requests, smoothing=stage.smoothing, seam=float(problem.desired[-1]))
    return None if run is None else Iterate(requests, run, 0.0)


def _follow(
    problem: Tracking, current: Iterate, step: Step, stage: Stage, unit: float
) -> Iterate | None:
    requests = problem.admissible(current.requests + step.requests)
    run = problem.linearise(
        requests,
        smoothing=stage.smoothing,
        seam=float(current.run.angles[-1] + step.angles[-1]),
    )
    if run is None:
        return None
    return Iterate(requests, run, _cost(problem, requests, run, stage, unit))


def _cost(problem: Tracking, requests: Array, run: Linearised, stage: Stage, unit: float) -> float:
    """The stage's cost [rad^2]: sum of unit^2 |error / unit|^power, and the pull."""
    errors = np.abs(run.angles - problem.desired) / unit
    away = requests - problem.resting
    return float(unit**2 * np.sum(errors**stage.power) + stage.pull * (away @ away))


def _step(
    problem: Tracking, current: Iterate, stage: Stage, unit: float, damping: float
) -> tuple[Step, float]:
    """The Gauss-Newton step that leaves the limits nowhere, and the cost it expects."""
    errors = current.run.angles - problem.desired
    power = stage.power
    # unit^2 |e / unit|^p to second order, written as weight * (e / (p - 1) + change of angle)^2
    curvature = power * (power - 1.0) / 2.0
    weights = np.maximum(curvature * (np.abs(errors) / unit) ** (power - 2.0), LEAST_WEIGHT)
    residuals = errors / (power - 1.0)
    away = current.requests - problem.resting
    pull = np.full_like(away, stage.pull)
    free = problem.movable
    for _ in range(ACTIVE_SET_ROUNDS):
        step = gauss_newton_step(
            problem.stencil,
            current.run,
            residuals,
            weights=weights,
            pull=pull,
            toward=-away,
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
    before = weights @ residuals**2
    after = weights @ (residuals + step.angles) ** 2
    moved = away + step.requests
    expected = current.cost + after - before + stage.pull * (moved @ moved - away @ away)
    return step, float(expected)
