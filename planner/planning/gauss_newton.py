"""Gauss-Newton with Levenberg-Marquardt terms, on a saturation whose corners sharpen in stages.

Each stage minimises (10) of ``docs/math.md`` on the model with corners of one radius, and the next
one carries on from its answer with sharper corners and less regularisation: a homotopy. Angles and
requests are unknowns both, so no step waits for a simulation (direct multiple shooting: J. T.
Betts, *Practical Methods for Optimal Control Using Nonlinear Programming*, 2010). Until the steps
have closed them, the dynamics have defects; an augmented Lagrangian judges the steps (J. Nocedal,
S. J. Wright, *Numerical Optimization*, 2006, section 17.3), and the exact models the answers.
Requests at a limit are held there by an active set; where their changes are limited, or smoothed,
each step is a quadratic programme.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.planning.kkt_step import (
    Damping,
    Iterate,
    Quadratic,
    Regularisation,
    Step,
    cost_of,
    kkt_step,
)
from planner.planning.qp_step import qp_step
from planner.planning.tracking_problem import Errors, TrackingProblem
from planner.trajectory import Array, Mask


class Stage(NamedTuple):
    """One problem of a search.

    Attributes:
        radius: Radius of the saturation's corners [theta_0].
        weight: Weight of the regularisation, alpha of (10), relative to that of the squared errors.
        power: The errors' exponent in the cost.
        steps: Steps at most: the next stage carries on where this one stops.
        smoothing: Whether the regularisation is the sum of the squared second differences of the
            requests, not the squared distance from the requests that hold the desired angles.
    """

    radius: float
    weight: float
    power: float = 2.0
    steps: int = 6
    smoothing: bool = False


@dataclass(frozen=True, kw_only=True)
class GaussNewtonOptions:
    """What steers the search.

    In brackets what half and twice the value do to the errors of 50 plans that saturate, half of
    them outside Equation 13: mean and worst change in per cent.

    Attributes:
        narrow: The stages. A regularisation keeps the first ones out of the plains where saturated
            requests no longer count, and the last ones from jumping where nothing is gained. Fewer
            than seven stages cost up to 13 %.
        wide: The stages of a search that leaves the place where it begins: under corners so wide
            every request counts. Hardly any regularisation is left at the end, which matters where
            next to no error is. Without this search plans lose up to 18 %.
        largest: Where the largest error counts, the stages that follow those of wide corners: it
            is approached through sums of powers of the errors.
        simulated: Radius below which what a stage ends with is worth a simulation [theta_0] (0.000
            and 0.01; 0 and 0).
        least_decrease: A stage ends when a step lowers its merit by less than this fraction (-0.002
            and 0.04; 0.002 and 0.07, and worse where next to no error is).
        first_damping: Least weight of the Levenberg-Marquardt term in the first step of a stage,
            relative to that of the errors (0.01 and 1.0; 0.01 and 1.7).
        factor: By this the weight grows after a step that failed, or that gained less than ``poor``
            of what was predicted, and falls after one that gained more than ``good`` of it.
        short_factor: By this it grows after a step that had to be shortened; with 3 the errors are
            the same, but requests for the largest error change up to 14 % more.
        good: See ``factor`` [-].
        poor: See ``factor`` [-].
        defect_penalty: Weight on the squares of the defects in the merit, relative to the largest
            curvature of the cost (0.006 and 0.4; 0.000 and 0.02, and 2.5 where it does not
            saturate).
        shortening: Share of a step that is tried after one that was too long (0.02 and 1.7; -0.01
            and 0.2, with requests that change 7 % more).
        lengths: Lengths of a step that are tried before it is computed anew (0.003 and 0.3; 0.001
            and 0.02).
        active_set_rounds: How often a step is taken anew with the requests held that it would take
            beyond their limits (one: 0.000 and 0.01, and 3.4 where it does not saturate; six: 0).
        negligible_prediction: A stage also ends when a step fails of which less than this share of
            ``least_decrease`` was predicted [-]: damped more, the next one would gain even less.
        least_weight: Least weight on an error where powers are summed, relative to that on an error
            of one unit in a sum of squares [-]: with none the matrix of (12) could be singular.
        largest_share: Error in units from which on a cost counts as this large [-]: its highest
            power is still a number.
    """

    narrow: tuple[Stage, ...] = (
        Stage(0.5, 1e-2),
        Stage(0.2, 1e-3),
        Stage(0.1, 1e-4),
        Stage(0.04, 5e-5),
        Stage(0.02, 5e-5),
        Stage(0.008, 5e-5),
        Stage(0.006, 1e-5, steps=2),
    )
    wide: tuple[Stage, ...] = (
        Stage(2.0, 1e-3),
        Stage(1.0, 1e-3),
        Stage(0.5, 1e-4),
        Stage(0.2, 1e-4),
        Stage(0.08, 1e-4),
        Stage(0.02, 1e-5),
        Stage(0.008, 1e-8),
    )
    largest: tuple[Stage, ...] = tuple(
        Stage(radius, 1e-5, power=power, steps=8)
        for radius, power in ((0.1, 4), (0.1, 8), (0.1, 16), (0.05, 32), (0.02, 64), (0.006, 64))
    )
    simulated: float = 0.1
    least_decrease: float = 5e-4
    first_damping: float = 3e-4
    factor: float = 3.0
    short_factor: float = 2.0
    good: float = 0.6
    poor: float = 0.2
    defect_penalty: float = 60.0
    shortening: float = 0.4
    lengths: int = 4
    active_set_rounds: int = 3
    negligible_prediction: float = 0.1
    least_weight: float = 1e-6
    largest_share: float = 1e4


OPTIONS = GaussNewtonOptions()


class State(NamedTuple):
    """Where a search is, and what it has learnt for its next step."""

    requests: Array  # (n, joints) [rad]
    angles: Array  # states, (n, states): angles [rad], and where joints have inertia speeds
    damping: float = 0.0
    multipliers: Array | None = None
    held: Mask | None = None  # requests that stay at their limits


def minimise(
    problem: TrackingProblem, state: State, stages: Sequence[Stage]
) -> tuple[State, float]:
    """The best of where the stages lead, judged by the exact models, and that error.

    Args:
        problem: What to reach, and within which limits.
        state: Where to start; its requests within the limits.
        stages: The stages to go through.
    """
    best, least = state, problem.exact_error(state.requests)
    for stage in stages_for(problem, stages):
        state = descend(problem, state, stage)
        if stage.radius >= OPTIONS.simulated:
            continue
        error = problem.exact_error(state.requests)
        if error < least:
            best, least = state, error
    return best, least


def stages_for(problem: TrackingProblem, stages: Sequence[Stage]) -> Sequence[Stage]:
    """The stages, and where the largest error counts those that turn to it."""
    if problem.norm == "rms":
        return stages
    widest = OPTIONS.largest[0].radius
    return [*(stage for stage in stages if stage.radius >= widest), *OPTIONS.largest]


def descend(problem: TrackingProblem, state: State, stage: Stage) -> State:
    """Lower one stage's cost by damped Gauss-Newton steps."""
    unit = 1.0
    if stage.power > 2.0:
        distances = problem.goal.distances(problem.angles_of(state.angles))
        unit = max(float(np.max(distances)), np.finfo(np.float64).tiny)
    damping = max(state.damping, OPTIONS.first_damping)
    multipliers, held = state.multipliers, state.held
    current = iterate(problem, state.requests, problem.states_of(state.angles), stage, unit)
    penalty = OPTIONS.defect_penalty * float(current.cost.curvature.max())
    negligible = OPTIONS.negligible_prediction * OPTIONS.least_decrease
    for _ in range(stage.steps):
        try:
            step, held = _step_within_limits(problem, current, damping, multipliers, held)
        except np.linalg.LinAlgError:  # the matrix is singular to working precision
            damping *= OPTIONS.factor
            continue
        merit = merit_of(current, step, penalty)
        predicted_reduction = merit - step.predicted
        following, length = _line_search(problem, current, step, stage, unit, penalty)
        if following is None:
            damping *= OPTIONS.factor
            if predicted_reduction < negligible * merit:
                break
            continue
        after = merit_of(following, step, penalty)
        reduction = merit - after
        if length < 1.0:
            damping *= OPTIONS.short_factor
        elif reduction > OPTIONS.good * predicted_reduction:
            damping /= OPTIONS.factor
        elif reduction < OPTIONS.poor * predicted_reduction:
            damping *= OPTIONS.factor
        current, multipliers = following, step.multipliers
        if reduction < OPTIONS.least_decrease * after:
            break
    return State(current.requests, current.angles, damping, multipliers, held)


def merit_of(current: Iterate, step: Step, penalty: float) -> float:
    """The augmented Lagrangian: to first order, the cost once the defects are closed.

    Args:
        current: Where the search is.
        step: The step whose multipliers count.
        penalty: Weight on the squares of the defects.
    """
    worth = np.vdot(penalty * current.defects - 2.0 * step.multipliers, current.defects)
    return current.value + float(worth)


def iterate(
    problem: TrackingProblem, requests: Array, angles: Array, stage: Stage, unit: float = 1.0
) -> Iterate:
    """What the smoothed models and the stage make of requests and angles.

    Args:
        problem: What to reach.
        requests: Requests [rad], shape (n, joints).
        angles: Angles [rad], shape (n, joints).
        stage: Corners, regularisation and power.
        unit: Error that counts as one where powers are summed [rad].
    """
    response = problem.respond(angles, requests, radius=stage.radius)
    errors = problem.errors(angles)
    cost = power_cost(errors, power=stage.power, unit=unit, ridge=problem.ridge)
    if stage.smoothing:
        regularisation = Regularisation(
            stage.weight, problem.roughness_terms(requests), second_differences=True
        )
    else:
        regularisation = Regularisation(stage.weight, requests - problem.resting)
    defects = response.reached - angles
    value = cost.value + cost_of(regularisation)
    return Iterate(requests, angles, response, defects, cost, regularisation, value)


def _line_search(
    problem: TrackingProblem,
    current: Iterate,
    step: Step,
    stage: Stage,
    unit: float,
    penalty: float,
) -> tuple[Iterate | None, float]:
    """The first share of the step that lowers the merit, and how large a share; None if none."""
    length, merit = 1.0, merit_of(current, step, penalty)
    for _ in range(OPTIONS.lengths):
        requests = problem.admissible(current.requests + length * step.requests)
        angles = current.angles + length * step.angles
        following = iterate(problem, requests, angles, stage, unit)
        if merit_of(following, step, penalty) < merit:
            return following, length
        length *= OPTIONS.shortening
    return None, length


def _step_within_limits(
    problem: TrackingProblem,
    current: Iterate,
    damping: float,
    multipliers: Array | None,
    held: Mask | None,
) -> tuple[Step, Mask | None]:
    """The Gauss-Newton step, and the requests held at the limits that they would leave."""
    if problem.coupled or current.regularisation.second_differences:
        return qp_step(problem, current, _damping(problem, current, damping, multipliers)), None
    below, above = current.requests <= problem.lower, current.requests >= problem.upper
    free = problem.movable if held is None else problem.movable & ~(held & (below | above))
    for _ in range(OPTIONS.active_set_rounds):
        weights = _damping(problem, current, damping, multipliers)
        step = kkt_step(problem.windows, current, weights, free=free)
        if not problem.limited:
            return step, None
        gradient = step.reduced_gradient
        outward = (below & (gradient > 0.0)) | (above & (gradient < 0.0))
        before, free = free, problem.movable & ~outward
        if np.all(free >= before):  # those that may come back do so in the next step
            break
    return step, problem.movable & ~free


def _damping(
    problem: TrackingProblem, current: Iterate, damping: float, multipliers: Array | None
) -> Damping:
    """An even weight, and the curvature of the Lagrangian at the corners where it is positive.

    See ``docs/math.md``, section 6.
    """
    even = np.full_like(current.requests, damping)
    if multipliers is None:
        return Damping(even, np.zeros_like(current.angles))
    bending = -multipliers * current.response.bending
    angles = len(problem.models)
    if problem.has_speeds:
        bending = bending[..., :angles] + bending[..., angles:]
    bending = np.maximum(bending, 0.0)
    after = np.zeros_like(current.angles)  # bends by the angle before each sample
    after[:, :angles] = bending.sum(axis=0)[problem.windows.after]
    bending = problem.over_driven(bending)
    return Damping(even + problem.windows.gathered(bending), after)


def power_cost(errors: Errors, *, power: float, unit: float, ridge: float) -> Quadratic:
    """The sum of ``unit^2 |error / unit|^power`` to second order in the angles: (13).

    Gauss-Newton: the errors themselves are taken to be linear in the angles.

    Args:
        errors: Errors and their derivatives.
        power: 2 for least squares; large powers approach the largest error.
        unit: Error that counts as one.
        ridge: Added to the curvature, so that it is definite where the errors do not see an angle.
    """
    gradient = np.einsum("kmi,km->ki", errors.jacobians, errors.values)
    curvature = np.einsum("kmi,kmj->kij", errors.jacobians, errors.jacobians)
    if power == 2.0:
        value = float(np.vdot(errors.values, errors.values))
    else:
        lengths = np.linalg.norm(errors.values, axis=1)
        # Beyond this a power overflows; such a step is refused for its cost in any case.
        share = np.minimum(lengths / unit, OPTIONS.largest_share)
        value = unit**2 * float(np.sum(share**power))
        weights = power / 2.0 * np.maximum(share ** (power - 2.0), OPTIONS.least_weight)
        radial = gradient / np.maximum(lengths, np.finfo(np.float64).tiny)[:, np.newaxis]
        curvature += (power - 2.0) * radial[:, :, np.newaxis] * radial[:, np.newaxis]
        gradient = weights[:, np.newaxis] * gradient
        curvature *= weights[:, np.newaxis, np.newaxis]
    if ridge > 0.0:
        curvature = curvature + ridge * np.eye(curvature.shape[-1])
    return Quadratic(value, gradient, curvature)
