"""The search for requests: stages of sharper corners, several models, and smoothing.

Each stage minimises (10) of ``docs/math.md`` on the model with corners of one radius, and the next
one carries on from its answer with sharper corners and less regularisation: a homotopy. The descent
within a stage is compiled (``gauss_newton``); simulations of the exact models judge its answers.
Several joints that share an error, a foot's, are searched together, and so are several models that
joints may have, under the same requests. At the end requests are made smoother for as much error as
a robot would not show (section 6 and (12b) of ``docs/math.md``).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from planner.exceptions import SolverFailed, angle_text
from planner.model.evidence import ENCODER_STEP
from planner.model.joint import JointModel
from planner.model.response import Loads
from planner.planning.gauss_newton import (
    LARGEST_SHARE,
    SIMULATED,
    Search,
    Stage,
    go_through,
    pattern_of,
)
from planner.planning.problem import Problem
from planner.trajectory import Array, Mask, reversals

NARROW = (
    Stage(0.5, 1e-2),
    Stage(0.2, 1e-3),
    Stage(0.1, 1e-4),
    Stage(0.04, 5e-5),
    Stage(0.02, 5e-5),
    Stage(0.008, 5e-5),
    Stage(0.006, 1e-5, steps=2),
)
"""The stages. A regularisation keeps the first ones out of saturated, flat regions, and the last
ones from jumping where nothing is gained. Fewer than seven stages cost up to 13 %."""

WIDE = (
    Stage(2.0, 1e-3),
    Stage(1.0, 1e-3),
    Stage(0.5, 1e-4),
    Stage(0.2, 1e-4),
    Stage(0.08, 1e-4),
    Stage(0.02, 1e-5),
    Stage(0.008, 1e-8),
)
"""The stages of a search far from its start: with corners so wide every request has an effect. The
last regularisation is very weak, which matters where next to no error remains. Without this search
plans lose up to 18 %."""

LARGEST = tuple(
    Stage(radius, 1e-5, power, 8)
    for radius, power in (
        (0.1, 4.0),
        (0.1, 8.0),
        (0.1, 16.0),
        (0.05, 32.0),
        (0.02, 64.0),
        (0.006, 64.0),
    )
)
"""Where the largest error counts, the stages after the wide corners: it is approached through sums
of powers of the errors."""

FOOT = tuple(stage._replace(steps=16) for stage in (Stage(1.5, 1e-3), Stage(0.7, 1e-3), *NARROW))
"""The stages for a foot. Wide corners first: the joints must leave the best plans for each alone.
Over 38 feet, first corners of 2 and 1 lose 0.35 % at worst, no wide corners 0.55 %. Where joints
can compensate for one another, stages take many steps; 12 or 24 make no difference."""


class State(NamedTuple):
    """Start of a search: requests (n, J) and angles (n, A) [rad], not always their response."""

    requests: Array
    angles: Array


def begun(problem: Problem, state: State) -> Search:
    """A search from a state."""
    requests, states = np.array(state.requests, order="C"), problem.states_of(state.angles).copy()
    active = np.zeros((2, *requests.shape), dtype=np.int64)
    active[0][np.broadcast_to(problem.lower == problem.upper, requests.shape)] = -1
    return Search(requests, states, np.zeros_like(states), active, np.zeros(2))


def _gone_through(problem: Problem, search: Search, stages: Sequence[Stage]) -> tuple[Array, Array]:
    """The requests with which each stage ends [rad], (stages, n, J), and their angles.

    The angles are those of the exact models where corners are sharp, else NaN, (stages, n, A).
    """
    ends = np.empty((len(stages), *search.requests.shape))
    angles = np.empty((len(stages), len(search.requests), len(problem.models)))
    pattern = pattern_of(problem.spec, smoothing=stages[0].smoothing)
    go_through(problem.spec, pattern, search, np.array(stages, dtype=np.float64), ends, angles)
    return ends, angles


def minimise(
    problem: Problem, state: State, stages: Sequence[Stage], *, through_rms: bool = False
) -> tuple[Array, float]:
    """The best requests of the stages, judged by the exact models, and their error.

    Args:
        problem: The goal, and the limits.
        state: Start of the search; its requests within the limits.
        stages: The stages to go through.
        through_rms: Where the largest error counts: whether the plan for the root mean square comes
            first, and the stages that turn to the largest error start from it.
    """
    first, then = (stages, ()) if through_rms else ((), stages)
    stages = [*first, *stages_for(problem, then)]
    ends, angles = _gone_through(problem, begun(problem, state), stages)
    best, least = state.requests, problem.exact_error(state.requests)
    for stage, end, reached in zip(stages, ends, angles, strict=True):
        if stage.radius < SIMULATED and (error := problem.error(reached)) < least:
            best, least = end, error
    return best, least


def stages_for(problem: Problem, stages: Sequence[Stage]) -> Sequence[Stage]:
    """The stages; where the largest error counts, also the stages that approach it."""
    if problem.norm == "rms":
        return stages
    return [*(stage for stage in stages if stage.radius >= LARGEST[0].radius), *LARGEST]


ROBUST_RADIUS = 0.2
"""Corners of the first stage for several models [theta_0]: the plan for the nominal one is near.
Over 19 joints and 5 feet, half: their errors fall by 1 % less; 0.5: as good."""

ROBUST_SMOOTHING = 1e-2
"""Weight of the squared second differences beside the squared errors of several models [-].
Requests that switch between the top speeds, or cross dead bands of different widths, depend less on
a joint's gain: on an underdamped servo with friction a tenth of it has errors over the models up to
3 % smaller, for up to 1.4 times the travel; ten times has them up to 10 % larger."""

ROUNDS = 6
"""How often the weights follow the errors for the worst model. (Five: its error changes by up to
1 %, eight: as good.)"""


def robust_requests(
    nominal: Problem,
    scenarios: Sequence[tuple[JointModel, ...]],
    loads: Sequence[Loads],
    requests: Array,
    *,
    robust: Literal["mean", "worst"],
    search: Sequence[Stage] = NARROW,
) -> Array:
    """Requests with a small error over all scenarios, from a plan for the nominal one.

    With even weights the cost is the mean over the scenarios. For the worst one the weights follow
    the errors: they grow in scenarios with larger errors until the errors are even (C. L. Lawson's
    algorithm, as in J. R. Rice, K. H. Usow, *Mathematics of Computation* 22, 1968).

    Args:
        nominal: The problem of the nominal models.
        scenarios: The models of the joints in each scenario, the nominal ones first.
        loads: Torques on the joints as the models of each scenario feel them.
        requests: A plan for the nominal models [rad], shape (n, J). Without dead bands the answer's
            error over all scenarios is no larger than that of this plan.
        robust: Which error over the scenarios counts.
        search: The stages; only the ones with small corners are used.

    Raises:
        SolverFailed: Under no requests all models have a steady cycle.
    """
    stages = [
        stage._replace(weight=ROBUST_SMOOTHING, smoothing=True)
        for stage in search
        if stage.radius <= ROBUST_RADIUS
    ]
    problem = nominal.in_scenarios(scenarios, loads, robust)
    angles = problem.exact_angles(requests)
    if angles is None:
        angles = np.tile(nominal.desired, len(scenarios))
    best, least = minimise(problem, State(requests, angles), stages)
    column, answer = best, problem
    for _ in range(ROUNDS if robust == "worst" else 0):
        reached = problem.exact_angles(column)
        if reached is None:
            break
        weights = problem.weights * problem.errors_of_models(reached)
        if not np.sum(weights) > 0.0:
            break
        problem = replace(problem, weights=tuple((weights / np.sum(weights)).tolist()))
        column, error = minimise(problem, State(column, reached), stages[-3:])
        if error < least:
            best, least, answer = column, error, problem
    if not math.isfinite(least):
        raise SolverFailed(
            "optimised inversion", "no requests lead to a steady cycle of all models"
        )
    before = problem.exact_error(requests)
    return smoothed(answer, best, at_most=before)


RADII = *(0.04,) * 2, *(0.015,) * 16
"""Radius of the corners in each step of the smoothing [theta_0]."""

# In brackets below, up to LARGE_GAIN: the effect of other values on the sum of squared second
# differences, in the mean, and on the number of steps, over the smoothing of 86 plans: random
# joints, some limited, from rest, with dry friction or for the largest error.

GROWTH = 3.0
"""By this the factor c of the weight grows at most after a step within the allowed error (1.7: -1
and +9 %; 6: -2 and +2 %)."""

REDUCTION = 0.5
"""By this the weight falls at most after a step beyond it (0.25: -1 and +8 %; 0.8: -2 and +6 %)."""

UNCHANGED = 0.1
"""Relative change of the second differences after which no step follows, where enough of the
allowed rise is used (0.05: -2 and +9 %; 0.2: +9 and -7 %)."""

SETTLED = 0.5
"""The share of the allowed rise that is enough for this (0.25: +5 and -14 %, with needless
crossings; 0.8: -8 and +18 %)."""

ENOUGH = 0.9
"""Share of the allowed rise from which on an answer is kept if it was no large gain, and at which
steps aim from beyond it (0.8: +7 and -3 %; 0.95: -2 and +8 %)."""

LARGE_GAIN = 0.5
"""Ratio of the second differences after a step to those before up to which it was a large gain, so
that another step follows (0.25: 0 and 0 %; 0.8: -4 and +8 %)."""

HEAVIEST = 50.0
"""Largest weight of the second differences beside the errors, times ``smoothness``, where an
encoder would not show the error [-]: requests that are smooth already are not flattened."""

MEAN = 20.0
"""Where the largest error counts: relative rise of the root mean square beside ``smoothness`` [-].
Without a limit a joint could rest if it must miss one sample anyway. With 1 requests for the
largest errors of the reference walk are two to four times as rough."""

STRAIGHT = 1e-24
"""Sum of squared second differences up to which requests count as straight [rad^2]."""


def smoothed(
    problem: Problem,
    requests: Array,
    *,
    best: Array | None = None,
    candidates: Iterable[Array] = (),
    at_most: float = math.inf,
) -> Array:
    """Smoother requests whose shown error is within the limits of :func:`allowed_beside`.

    Where requests would shake a joint, an error up to an encoder's step is allowed as well.

    Args:
        problem: The goal, and the limits.
        requests: A good plan [rad], shape (n, J).
        best: Angles of the best plan [rad], (n, A), if it is another plan.
        candidates: Requests [rad], (n, J), to start from as well where their error is allowed; they
            are computed only where requests may be smoothed.
        at_most: Upper limit of the error in any case.

    Returns:
        The smoother requests, or ``requests``: always with a smoothness of 0.
    """
    smoothness = problem.smoothness
    if smoothness == 0.0:
        return requests
    given = reached_by(problem, requests)
    if given is None:
        return requests
    _, errors = given
    closest = errors if best is None else judged(problem, best)
    allowed = allowed_beside(problem, closest)
    others = (reached_by(problem, candidate) for candidate in candidates)
    starts = [given, *(other for other in others if other is not None and allowed.by(other[1]))]
    mean = math.inf
    if problem.norm == "max":
        share = 1.0 + MEAN * smoothness
        mean = share * math.hypot(errors.mean, errors.model_error)
        mean = max(math.sqrt(max(mean**2 - errors.model_error**2, 0.0)), allowed.unseen)
    shown = _Bound(allowed.shown, 1.0 + smoothness, math.inf, at_most, mean)

    def within(unseen: float) -> _Bound:
        heaviest = HEAVIEST * smoothness
        return _Bound(math.inf, math.inf, heaviest, min(unseen, at_most), max(mean, unseen))

    smoother = [_smoothest(problem, *start, errors.error, shown) for start in starts]
    shaking = any(shakes(problem, each) for each in smoother)
    bound = within(closest.unseen if shaking else allowed.unseen)
    smoother += [_smoothest(problem, *start, errors.error, bound) for start in starts]
    answer = min(smoother, key=problem.roughness)
    return _at_rests(problem, answer, errors.error, (shown, within(closest.unseen)))


def _at_rests(problem: Problem, requests: Array, error: float, bounds: Sequence[_Bound]) -> Array:
    """Requests that rest where the path does, if the given ones shake there and a bound allows it.

    Before and after a motion requests stay free: for the time in which the joints settle, or twice
    as long, and so on until the error is allowed.

    Args:
        problem: The goal, and the limits.
        requests: Smoothed requests [rad], shape (n, J).
        error: Error of the best plan.
        bounds: The limits of the smoothing, of which one must be kept.
    """
    sharp = [stage for stage in NARROW if stage.radius < SIMULATED]
    margin = settling_time(problem)
    while margin <= len(requests):
        resting = without_effect_on_motion(problem, margin)
        if not shakes_within(problem, requests, resting):
            break
        most, angles = ROUGHER * problem.roughness(requests), problem.exact_angles(requests)
        if angles is None:
            break
        held = holding(problem, resting[:, np.newaxis], problem.resting)
        best = minimise(held, State(held.admissible(requests), angles), sharp)[0]
        start, allowed = reached_by(problem, best), []
        for bound in bounds:
            if start is not None and bound.used(start[1], error) <= 1.0:
                answer = problem.admissible(_smoothest(held, *start, error, bound))
                reached = reached_by(problem, answer)
                kept = reached is not None and bound.used(reached[1], error) <= 1.0
                if kept and problem.roughness(answer) <= most:
                    allowed.append(answer)
        if allowed:
            calm = (each for each in allowed if not shakes(problem, each))
            return next(calm, min(allowed, key=problem.roughness))
        margin *= 2
    return requests


def holding(problem: Problem, held: Mask, place: Array) -> Problem:
    """The same problem with some requests held at a place [rad]; both of (n, J), or broadcast."""
    lower, upper = (np.where(held, place, limit) for limit in (problem.lower, problem.upper))
    return replace(problem, lower=lower, upper=upper)


ROUGHER = 2.0
"""How much larger the sum of squared second differences may be with requests held at rests [-]. Of
155 paths with rests, 1.2 leaves requests of 32 shaking and 2 those of 23; without a limit they step
up to three times as far beside some rests."""


def settling_time(problem: Problem) -> int:
    """Time in which all joints settle, without their delays [periods]."""
    times = (model.theta_0 / model.v_max + model.time_constant for model in problem.models)
    return math.ceil(max(times) / problem.models[0].period)


STATIONARY = 1e-9
"""Range of angles, or of requests, of a joint that does not move [rad]: rounding."""


def without_effect_on_motion(problem: Problem, margin: int) -> Mask:
    """The requests that act only where the path rests, and has done and will do for a time, (n,).

    Args:
        problem: The goal.
        margin: This time [samples].
    """
    desired, count = problem.desired, len(problem.desired)
    before = np.roll(desired, 1, axis=0)
    if problem.start is not None:
        before[0] = problem.start
    moving = np.any(np.abs(desired - before) > STATIONARY, axis=1)
    if np.all(moving):
        return np.zeros(count, dtype=np.bool_)
    first, last = problem.ages.youngest - margin, problem.ages.oldest + margin
    reach = max(abs(first), last)
    padded = np.pad(moving, reach, mode="wrap" if problem.cyclic else "constant")
    moved = np.concatenate([[0], np.cumsum(padded)])
    samples = np.arange(reach, reach + count)
    resting: Mask = moved[samples + last + 1] == moved[samples + first]
    return resting


SHAKING = 8.0
"""Least excess of changes of direction over the path's with which requests shake a joint [1/s]. Of
20 smooth paths that joints can follow one has such requests, of four paths of legs with kinks all.
"""


def shakes(problem: Problem, requests: Array) -> bool:
    """Whether requests of a joint, (n, 1), change direction much more often than its path does."""
    turns, of_path = (
        reversals(each[:, 0], cyclic=problem.cyclic) for each in (requests, problem.desired)
    )
    return turns - of_path > SHAKING * len(requests) * problem.models[0].period


def shakes_within(problem: Problem, requests: Array, resting: Mask) -> bool:
    """Whether requests, (n, J), change direction much where a mask, (n,), says that they rest."""
    rows = np.flatnonzero(resting)
    if not len(rows):
        return False
    rests = np.split(requests[rows], np.flatnonzero(np.diff(rows) > 1) + 1)
    turns = [[reversals(column, cyclic=False) for column in each.T] for each in rests]
    return int(np.max(np.sum(turns, axis=0))) - 1 > SHAKING * len(rows) * problem.models[0].period


class Judged(NamedTuple):
    """The errors of a motion, in the unit of the problem's error.

    Attributes:
        error: In the norm that counts.
        mean: Root mean square, whichever norm counts.
        model_error: Known error of the models, rms: at least an encoder's step.
        unseen: Error that an encoder's step of each joint makes, rms.
    """

    error: float
    mean: float
    model_error: float
    unseen: float

    @property
    def shown(self) -> float:
        """The error that a robot would show, of (12b): that of the plan and of its models."""
        return math.hypot(self.error, self.model_error)


def judged(problem: Problem, angles: Array) -> Judged:
    """The errors of a motion of the exact models [rad], (n, A)."""
    weights = np.asarray(problem.weights)
    shares = np.repeat(weights, problem.joints)  # mean squared error for a radian of each model
    if problem.foot is not None:
        jacobians = problem.errors(angles)[1]
        shares *= np.einsum("kcij,kcij->cj", jacobians, jacobians).ravel() / len(angles)
    models = problem.nominal * len(weights)  # drawn models were not tested
    known = known_errors(models, angles, cyclic=problem.cyclic)
    step = np.full(len(known), ENCODER_STEP)
    model_error, unseen = (math.sqrt(float(shares @ each**2)) for each in (known, step))
    return Judged(problem.error(angles), problem.mean_error(angles), model_error, unseen)


def reached_by(problem: Problem, requests: Array) -> tuple[State, Judged] | None:
    """The motion of the exact models, and its errors; None where a joint has no steady cycle."""
    angles = problem.exact_angles(requests)
    return None if angles is None else (State(requests, angles), judged(problem, angles))


class Allowed(NamedTuple):
    """Limits for smoother requests: of the shown error, or of the error.

    Attributes:
        shown: Largest error that a robot may show.
        unseen: Error that an encoder's step of each joint makes, for a foot and with dry friction;
            0 for other plans. (:func:`smoothed` allows more there where requests shake.)
    """

    shown: float
    unseen: float

    def by(self, motion: Judged) -> bool:
        """Whether a motion is allowed."""
        return motion.shown <= self.shown or motion.error <= self.unseen


def allowed_beside(problem: Problem, best: Judged) -> Allowed:
    """Limits of the errors beside the best plan, (12b) of ``docs/math.md``.

    Args:
        problem: The goal; with a smoothness of 0 no rise is allowed.
        best: The errors under the best requests.
    """
    if problem.smoothness == 0.0:
        return Allowed(0.0, best.error)
    # where many requests lead to nearly the same motion, a larger error is allowed
    many = problem.foot is not None or any(model.dead_band for model in problem.models)
    return Allowed((1.0 + problem.smoothness) * best.shown, best.unseen if many else 0.0)


def known_errors(models: Sequence[JointModel], angles: Array, *, cyclic: bool) -> Array:
    """Known errors of the models in a motion [rad], (A,), at least an encoder's step.

    Args:
        models: The joints.
        angles: Their motion [rad], shape (n, A).
        cyclic: Whether it repeats for ever.
    """
    errors = [
        ENCODER_STEP
        if model.evidence is None or math.isnan(model.evidence.error)
        else model.evidence.error_of(column, period=model.period, cyclic=cyclic)
        for model, column in zip(models, angles.T, strict=True)
    ]
    return np.maximum(errors, ENCODER_STEP)


class _Bound(NamedTuple):
    """Limits that smoother requests keep."""

    shown: float  # largest shown error
    growth: float  # by which it may exceed the least shown error so far
    heaviest: float  # largest weight on the second differences beside the errors
    at_most: float  # largest error
    mean: float  # where the largest error counts, also the largest root mean square

    def error(self, motion: Judged) -> float:
        """The allowed error of such a motion."""
        return min(math.sqrt(max(self.shown**2 - motion.model_error**2, 0.0)), self.at_most)

    def used(self, motion: Judged, error: float) -> float:
        """Share of the allowed rise of an error that a motion uses; inf where it exceeds limits."""
        room = self.error(motion) - error
        if motion.mean > self.mean or math.isnan(motion.error):
            return math.inf
        return (motion.error - error) / room if room > 0.0 else math.inf


def _smoothest(problem: Problem, state: State, start: Judged, error: float, bound: _Bound) -> Array:
    """The smoothest requests within the bound.

    Steps minimise ``J + w |D2 R|^2`` with sharp corners, J the cost of the errors and D2 the second
    differences of the requests. At the best weight w the smoothing costs about as much as J may
    rise, so that each step takes ``w = c (J_allowed - J) / |D2 R|^2`` anew from the requests from
    which it sets out, with a factor c that grows while the exact error is allowed. Where it is not,
    c is such that the weight itself falls. ``start`` are the errors of the state, ``error`` is that
    of the best plan.
    """
    power = stages_for(problem, NARROW)[-1].power
    best, least = state.requests, problem.roughness(state.requests)
    most, factor = bound.error(start), 1.0
    if least <= STRAIGHT or most <= error:
        return best
    search, now, cost = begun(problem, state), least, 0.0
    evidence = [model.evidence for model in problem.nominal]
    varying = problem.foot is not None
    varying |= any(each is not None and each.depends_on_motion for each in evidence)
    if power != 2.0 and error:  # the sum of the powers at the start, in units of the error
        shares = np.minimum(problem.distances(state.angles) / error, LARGEST_SHARE)
        cost = float(np.sum(shares**power))
    for radius in RADII:
        before = now
        allowed = _allowed_rise(error, most, power, len(best), cost)
        if before <= STRAIGHT or allowed <= 0.0 or most <= error:
            break
        share = min(most / error, LARGEST_SHARE) if error else 1.0
        weight = min(factor * allowed / before, bound.heaviest * share ** (power - 2.0))
        stage = Stage(radius, weight, power, 1, smoothing=True)
        (smoother,), (reached,) = _gone_through(problem, search, [stage])
        now, motion = problem.roughness(smoother), start._replace(error=problem.error(reached))
        if varying and not math.isnan(motion.error):
            motion = judged(problem, reached)
        elif problem.norm == "max":
            motion = motion._replace(mean=problem.mean_error(reached))
        used = bound.used(motion, error)
        if used <= 1.0:
            if now < least:
                best, least = smoother, now
            bound = bound._replace(shown=min(bound.shown, bound.growth * motion.shown))
            most, used = bound.error(motion), bound.used(motion, error)
            if used > ENOUGH and now > LARGE_GAIN * before:
                break
            factor *= max(used, GROWTH**-2.0) ** -0.5
        else:
            factor *= max(ENOUGH / used, REDUCTION) * now / before
        if SETTLED < used <= 1.0 and abs(now / before - 1.0) < UNCHANGED:
            break
    logging.getLogger(__name__).debug(
        "smoothing: second differences %s", angle_text(math.sqrt(least))
    )
    return best


def _allowed_rise(error: float, most: float, power: float, samples: int, cost: float) -> float:
    """Rise of the cost when all errors grow in proportion up to the allowed error.

    ``cost`` is the sum of the powers at the start, in units of the error.
    """
    if power == 2.0:
        return samples * (most**2 - error**2)
    if error == 0.0:
        return 0.0
    return error**2 * cost * float(min(most / error, LARGEST_SHARE) ** power - 1.0)
