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
from typing import NamedTuple

import numpy as np

from planner.exceptions import angle_text
from planner.model.joint import JointModel
from planner.planning.error_norm import error_norm
from planner.planning.gauss_newton import (
    OPTIONS as SEARCH_OPTIONS,
)
from planner.planning.gauss_newton import (
    Stage,
    State,
    descend,
    power_cost,
    stages_for,
)
from planner.planning.tracking_problem import TrackingProblem
from planner.trajectory import Array


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
        heaviest: Largest weight of the second differences beside the errors, times ``smoothness``,
            where an encoder would not show the error [-]: requests that are smooth already are not
            flattened.
    """

    radii: tuple[float, ...] = (*(0.04,) * 2, *(0.015,) * 16)
    factor: float = 1.0
    growth: float = 3.0
    reduction: float = 0.5
    enough: float = 0.9
    large_gain: float = 0.5
    unchanged: float = 0.1
    settled: float = 0.5
    heaviest: float = 50.0


OPTIONS = SmoothingOptions()

ENCODER_STEP = 2.0 * math.pi / 4096.0
"""Step of an encoder of 12 bits for a turn [rad]: what joints are sent and measured in."""

MEAN = 20.0
"""Where the largest error counts: relative rise of the root mean square beside ``smoothness`` [-].
Without a limit a joint that misses one sample in any case could rest. With 1 the largest errors of
the reference walk are followed by requests that are two to four times as rough."""

UNCHANGED = 1e-24
"""Sum of squared second differences up to which requests count as straight [rad^2]."""


def smoothed(
    problem: TrackingProblem,
    requests: Array,
    *,
    smoothness: float,
    best: Array | None = None,
    others: Sequence[Array] = (),
    at_most: float = math.inf,
) -> Array:
    """Smoother requests whose shown error is within what :func:`allowed_beside` says.

    Args:
        problem: What is to be reached, and within which limits.
        requests: A good plan [rad], shape (n, joints).
        smoothness: Relative rise of the shown error that is allowed [-]; 0 leaves the requests
            alone.
        best: Angles of the best plan [rad], (n, joints), where that is not this one.
        others: Requests [rad], (n, joints), to start from as well where their error is allowed.
        at_most: Error that is not to be passed in any case.

    Returns:
        The smoother requests, or the given ones.
    """
    if smoothness == 0.0:
        return requests
    angles = problem.exact_angles(requests)
    if angles is None:
        return requests
    least = problem.error(angles)
    allowed = allowed_beside(problem, angles if best is None else best, smoothness=smoothness)
    starts = [State(requests, angles)]
    for other in others:
        reached = problem.exact_angles(other)
        if reached is not None and allowed.by(problem, reached):
            starts.append(State(other, reached))
    mean = math.inf
    if problem.norm == "max":
        shown = math.hypot(_mean_error(problem, angles), known_error(problem, angles))
        mean = max(error_within(problem, angles, (1.0 + MEAN * smoothness) * shown), allowed.unseen)
    unseen, heaviest = min(allowed.unseen, at_most), OPTIONS.heaviest * smoothness
    bounds = (
        _Bound(allowed.shown, 1.0 + smoothness, math.inf, at_most, mean),
        _Bound(math.inf, math.inf, heaviest, unseen, mean),
    )
    found = [_smoothest(problem, start, least, bound) for start in starts for bound in bounds]
    return min(found, key=lambda state: roughness(problem, state.requests)).requests


class Allowed(NamedTuple):
    """What smoother requests are allowed: a shown error up to one, or an error up to another.

    Attributes:
        shown: Largest error that a robot may show.
        unseen: Error that an encoder's step of each joint makes, for a foot and with dry friction;
            0 for others.
    """

    shown: float
    unseen: float

    def by(self, problem: TrackingProblem, angles: Array) -> bool:
        """Whether angles (n, joints) are allowed."""
        return shown_error(problem, angles) <= self.shown or problem.error(angles) <= self.unseen


def allowed_beside(problem: TrackingProblem, best: Array, *, smoothness: float) -> Allowed:
    """What is allowed beside the best plan, (12b) of ``docs/math.md``.

    Args:
        problem: What is to be reached.
        best: The angles under the best requests [rad], shape (n, joints).
        smoothness: Relative rise of the shown error that is allowed [-]; with 0 nothing is.
    """
    if smoothness == 0.0:
        return Allowed(0.0, problem.error(best))
    unseen = 0.0  # where nearly the same motion follows from many requests, more is allowed
    if problem.goal.shared or any(model.dead_band for model in problem.models):
        unseen = _through(problem, best, np.full(len(problem.models), ENCODER_STEP))
    return Allowed((1.0 + smoothness) * shown_error(problem, best), unseen)


def shown_error(problem: TrackingProblem, angles: Array) -> float:
    """The error that a robot would show, of (12b): that of the plan and of its models."""
    return math.hypot(problem.error(angles), known_error(problem, angles))


def error_within(problem: TrackingProblem, angles: Array, shown: float) -> float:
    """The error that is shown as ``shown`` by a motion like these angles; 0 where there is none."""
    return math.sqrt(max(shown**2 - known_error(problem, angles) ** 2, 0.0))


def known_error(problem: TrackingProblem, angles: Array) -> float:
    """The known errors of the joints' models, in the unit of the problem's error, rms."""
    return _through(problem, angles, known_errors(problem.models, angles, cyclic=problem.cyclic))


def known_errors(models: Sequence[JointModel], angles: Array, *, cyclic: bool) -> Array:
    """What the models are known to miss of a motion [rad], (joints,), at least an encoder's step.

    Args:
        models: The joints.
        angles: Their motion [rad], shape (n, joints).
        cyclic: Whether it repeats for ever.
    """
    known = [
        ENCODER_STEP
        if model.evidence is None or math.isnan(model.evidence.error)
        else model.evidence.error_of(column, period=model.period, cyclic=cyclic)
        for model, column in zip(models, angles.T, strict=True)
    ]
    return np.maximum(known, ENCODER_STEP)


def _through(problem: TrackingProblem, angles: Array, errors: Array) -> float:
    """Errors of the joints [rad], (joints,), in the unit of the problem's error, rms."""
    moved = problem.goal.errors(angles).jacobians * errors
    return math.sqrt(float(np.vdot(moved, moved)) / len(angles))


def _mean_error(problem: TrackingProblem, angles: Array) -> float:
    """Root mean square of the distances, whichever error counts."""
    return error_norm(problem.goal.distances(angles), "rms")


def roughness(problem: TrackingProblem, requests: Array) -> float:
    """The sum of the squared second differences of requests [rad^2]."""
    terms = problem.roughness_terms(requests)
    return float(np.vdot(terms, terms))


class _Bound(NamedTuple):
    """What smoother requests keep."""

    shown: float  # largest shown error
    growth: float  # and by this it may exceed the least that was met
    heaviest: float  # largest weight on the second differences beside the errors
    at_most: float  # largest error
    mean: float  # where the largest error counts, also the largest root mean square

    def error(self, problem: TrackingProblem, angles: Array) -> float:
        """The error that is allowed to a motion like these angles."""
        return min(error_within(problem, angles, self.shown), self.at_most)

    def used(self, problem: TrackingProblem, angles: Array, error: float) -> float:
        """Share of what may be added to an error that angles use; inf where they add too much."""
        room = self.error(problem, angles) - error
        if _mean_error(problem, angles) > self.mean:
            return math.inf
        return (problem.error(angles) - error) / room if room > 0.0 else math.inf


def _smoothest(problem: TrackingProblem, state: State, error: float, bound: _Bound) -> State:
    """The smoothest requests that are met within the bound, with their angles.

    ``error`` is that of the best plan.
    """
    power = stages_for(problem, SEARCH_OPTIONS.narrow)[-1].power
    start = state
    best, least = state, roughness(problem, state.requests)
    most, factor = bound.error(problem, state.angles), OPTIONS.factor
    for radius in OPTIONS.radii:
        before = roughness(problem, state.requests)
        allowed = _allowed_rise(problem, start, error, most, power)
        if before <= UNCHANGED or allowed <= 0.0 or most <= error:
            break
        share = min(most / error, SEARCH_OPTIONS.largest_share) if error else 1.0
        heaviest = bound.heaviest * share ** (power - 2.0)
        weight = min(factor * allowed / before, heaviest)
        stage = Stage(radius, weight, power=power, steps=1, smoothing=True)
        state = descend(problem, state, stage)
        angles = problem.exact_angles(state.requests)
        now, used = roughness(problem, state.requests), math.inf
        if angles is not None:
            used = bound.used(problem, angles, error)
        if used <= 1.0 and angles is not None:
            if now < least:
                best, least = State(state.requests, angles), now
            shown = min(bound.shown, bound.growth * shown_error(problem, angles))
            bound = bound._replace(shown=shown)
            most, used = bound.error(problem, angles), bound.used(problem, angles, error)
            if used > OPTIONS.enough and now > OPTIONS.large_gain * before:
                break
            factor *= max(used, OPTIONS.growth**-2.0) ** -0.5
        else:
            factor *= max(OPTIONS.enough / used, OPTIONS.reduction) * now / before
        if OPTIONS.settled < used <= 1.0 and abs(now / before - 1.0) < OPTIONS.unchanged:
            break
    logging.getLogger(__name__).debug(
        "smoothing: error %s, second differences %s",
        angle_text(problem.error(best.angles)),
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
