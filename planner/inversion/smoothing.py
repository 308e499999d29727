"""Smoothing of a plan: the least sum of squared second differences at nearly the same error.

Gauss-Newton steps minimise ``J + w |D2 R|^2`` with sharp corners, J the cost of the errors and D2
the second differences of the requests. At the best weight w the smoothing costs about as much as J
may rise, so that each step takes ``w = c (J_allowed - J) / |D2 R|^2`` anew from the requests that
it sets out from, with a factor c that grows while the exact error stays within what is allowed.
Where it does not, c is such that the weight itself falls (``docs/math.md``, section 6).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.exceptions import angle_text
from planner.inversion.gauss_newton import (
    OPTIONS as SEARCH_OPTIONS,
)
from planner.inversion.gauss_newton import (
    Stage,
    State,
    descend,
    power_cost,
    stages_for,
)
from planner.inversion.reversals import OPTIONS as DEAD_BAND
from planner.inversion.reversals import typical_band
from planner.inversion.tracking_problem import TrackingProblem
from planner.model.joint import JointModel
from planner.trajectory import Array, rms


@dataclass(frozen=True, kw_only=True)
class SmoothingOptions:
    """What steers the smoothing.

    In brackets what other values do to the sum of squared second differences, in the mean, and to
    the number of steps, over the smoothing of 86 plans: random joints, some with limits, from rest,
    with dry friction or for the largest error.

    Attributes:
        radii: Radius of the corners in each step [theta_0].
        factor: Factor c of the first weight [-] (0.5: +5 and +5 %; 2: -1 and +7 %; from 4 on some
            requests cross the dead band needlessly).
        growth: By this c grows at most after a step within the allowed error [-] (1.7: -1 and
            +9 %; 6: -2 and +2 %).
        reduction: By this the weight falls at most after one beyond it [-] (0.25: -1 and +8 %; 0.8:
            -2 and +6 %).
        enough: Share of the allowed rise from which on an answer is kept if it was no large gain,
            and at which steps aim from beyond it (0.8: +7 and -3 %; 0.95: -2 and +8 %).
        large_gain: Ratio of the second differences after a step to those before up to which it was
            a large gain, so that another one follows [-] (0.25: 0 and 0 %; 0.8: -4 and +8 %).
        unchanged: Relative change of the second differences after which no step follows [-],
        settled: where this share of the allowed rise is used [-] (``unchanged`` 0.05: -2 and +9 %,
            0.2: +9 and -7 %; ``settled`` 0.25: +5 and -14 %, with needless crossings; 0.8: -8 and
            +18 %).
    """

    radii: tuple[float, ...] = (*(0.04,) * 2, *(0.015,) * 16)
    factor: float = 1.0
    growth: float = 3.0
    reduction: float = 0.5
    enough: float = 0.9
    large_gain: float = 0.5
    unchanged: float = 0.1
    settled: float = 0.5


OPTIONS = SmoothingOptions()

ENCODER_NOISE = 2.0 * math.pi / 4096.0 / math.sqrt(12.0)
"""Rounding of an encoder of 12 bits for a turn [rad], rms."""

UNCHANGED = 1e-24
"""Sum of squared second differences up to which requests count as straight [rad^2]."""


def smoothed(
    problem: TrackingProblem,
    requests: Array,
    *,
    smoothness: float,
    at_most: float = math.inf,
) -> Array:
    """Smoother requests whose error is larger by a share ``smoothness`` at most.

    Args:
        problem: What is to be reached, and within which limits.
        requests: A good plan [rad], shape (n, joints).
        smoothness: Relative rise of the error that is allowed, see :func:`allowed_error` [-].
        at_most: Error that is not to be passed in any case.

    Returns:
        The smoother requests, or the given ones.
    """
    if smoothness == 0.0:
        return requests
    angles = problem.exact_angles(requests)
    if angles is None:
        return requests
    state, error = State(requests, angles), problem.error(angles)
    most = most_error(problem, error, smoothness=smoothness, at_most=at_most)
    smoothest = _smoothest(problem, state, error, most)
    if any(model.dead_band for model in problem.models):
        smoothest = _without_needless_crossings(problem, state, error, smoothest)
    return smoothest.requests


def most_error(
    problem: TrackingProblem, error: float, *, smoothness: float, at_most: float
) -> float:
    """The error that smoother requests may have, given that of the best ones.

    ``at_most`` holds up to what is lost in the known error of a model.
    """
    noise = noise_of(problem.models)
    lost = allowed_error(0.0, smoothness, noise=noise) if noise > ENCODER_NOISE else 0.0
    return min(allowed_error(error, smoothness, noise=noise), max(at_most, lost))


def allowed_error(error: float, smoothness: float, *, noise: float = ENCODER_NOISE) -> float:
    """The error to which smoother requests may raise one.

    Errors count as they would be measured on the robot, noise added in quadrature: with sigma that
    noise the answer e meets ``e^2 + sigma^2 = (1 + smoothness)^2 (error^2 + sigma^2)``.
    """
    variance = noise**2
    return math.sqrt((1.0 + smoothness) ** 2 * (error**2 + variance) - variance)


def noise_of(models: Sequence[JointModel]) -> float:
    """What errors of plans are seen through [rad], rms over the joints.

    For each the error of its model on rows that were not fitted, where it is known, and at least
    the rounding of an encoder.
    """
    known = [model.evidence.error for model in models if model.evidence is not None]
    errors = [max(error, ENCODER_NOISE) for error in known if not math.isnan(error)]
    errors += [ENCODER_NOISE] * (len(models) - len(errors))
    return rms(np.array(errors))


def roughness(problem: TrackingProblem, requests: Array) -> float:
    """The sum of the squared second differences of requests [rad^2]."""
    terms = problem.roughness_terms(requests)
    return float(np.vdot(terms, terms))


def _without_needless_crossings(
    problem: TrackingProblem, state: State, error: float, smoother: State
) -> State:
    """Requests that cross the dead band only where that reduces the error by enough.

    To follow a path's noise, requests would jump from one edge of the dead band to the other and
    back. What of the second differences can be spared within the errors that ``DeadBandOptions``
    allow consists of such jumps.
    """
    band = typical_band(problem.models)
    worth = DEAD_BAND.worth * roughness(problem, state.requests)
    for error_share in DEAD_BAND.error_shares:
        most = math.hypot(error, error_share * band)
        answer = _smoothest(problem, smoother, error, most)
        if roughness(problem, answer.requests) < roughness(problem, smoother.requests) - worth:
            smoother = answer
    return smoother


def _smoothest(problem: TrackingProblem, state: State, error: float, most: float) -> State:
    """The smoothest requests that are met within the allowed error, with their angles."""
    power = stages_for(problem, SEARCH_OPTIONS.narrow)[-1].power
    allowed = _allowed_rise(problem, state, error, most, power)
    best, least = state, roughness(problem, state.requests)
    factor = OPTIONS.factor
    for radius in OPTIONS.radii:
        before = roughness(problem, state.requests)
        if before <= UNCHANGED or allowed <= 0.0:
            break
        stage = Stage(radius, factor * allowed / before, power=power, steps=1, smoothing=True)
        state = descend(problem, state, stage)
        angles = problem.exact_angles(state.requests)
        reached = math.inf if angles is None else problem.error(angles)
        now = roughness(problem, state.requests)
        used = (reached - error) / (most - error)
        if used <= 1.0 and angles is not None:
            if now < least:
                best, least = State(state.requests, angles), now
            if used > OPTIONS.enough and now > OPTIONS.large_gain * before:
                break
            factor *= max(used, OPTIONS.growth**-2.0) ** -0.5
        else:
            factor *= max(OPTIONS.enough / used, OPTIONS.reduction) * now / before
        if OPTIONS.settled < used <= 1.0 and abs(now / before - 1.0) < OPTIONS.unchanged:
            break
    logging.getLogger(__name__).debug(
        "smoothing: error %s of %s, second differences %s",
        angle_text(problem.error(best.angles)),
        angle_text(most),
        angle_text(math.sqrt(least)),
    )
    return best


def _allowed_rise(
    problem: TrackingProblem, state: State, error: float, most: float, power: float
) -> float:
    """By how much the cost rises when all errors grow until theirs is the one that is allowed."""
    if power == 2.0:
        return len(state.requests) * (most**2 - error**2)
    if error == 0.0:
        return 0.0
    cost = power_cost(problem.goal.errors(state.angles), power=power, unit=error, ridge=0.0)
    growth = min(most / error, SEARCH_OPTIONS.largest_share)
    return cost.value * float(growth**power - 1.0)
