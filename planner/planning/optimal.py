"""The optimised inversion: direct optimal control over the requests, on the full model."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

import numpy as np

from planner.approximation.ideal import slope_bounded
from planner.exceptions import SolverFailed, angle_text
from planner.model.joint import JointModel, request_ages
from planner.planning.arguments import Solver
from planner.planning.closed_form import SAME_TIME, best_closed_form, switching_time
from planner.planning.direct_transcription import transcribed_requests
from planner.planning.line_inverse import interpolated_offset
from planner.planning.problem import Problem
from planner.planning.search import NARROW, WIDE, State, allowed_beside, judged, minimise
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class FurtherSearchOptions:
    """When one search is not enough.

    Measured over 109 joints, half of them outside Equation 13.

    Attributes:
        far: Error over that of the ideal from which on further searches are worth their time. At
            1.015 nothing is gained, at 1.06 up to 0.4 % lost.
        gain: Relative gain from which on the answer of a wide search is taken, whose requests
            change more. At half and twice no error changes by more than 0.01 %; without it Σ(ΔR)²
            is 3 % larger.
        negligible: Error up to which further searches are not worth their time [theta_0]. Half and
            twice matter only below 0.01 degrees.
        compared: Samples that the ideal reaches below the top speeds up to which the search also
            starts from the closed forms, as what is left to choose is where lines change. Without
            it 6 % of 400 joints on paths far beyond them, 4 to 69 samples long, are followed better
            by a closed form, by 0.8 % at worst; with it none. It takes 0.05 to 0.3 s.
    """

    far: float = 1.03
    gain: float = 2e-3
    negligible: float = 5e-4
    compared: int = 16


OPTIONS = FurtherSearchOptions()

WITHIN_BAND = 1.0 - 1e-9
"""Share of a dead band within which the first request is: rounding must not move the joint."""

BARELY_SLOWER = 1e-3
"""By what share a speed may be below the top speed and count as it: the ideal is iterative."""


def first_request_freed(
    follow: Callable[..., Problem],
    problem: Problem,
    column: Array,
    solver: Solver,
    smoothness: float,
) -> tuple[Callable[..., Problem], Problem, Array]:
    """The problem from rest with the first request that serves best, and the plan for it.

    Anywhere within the dead band it holds the joint at the start. Until it has left the window of
    the acceleration it draws on a joint that moves, the less the nearer it is to the edge on the
    side of the motion. The middle is left only for what a robot would show.
    """
    (model,), (middle,) = problem.models, problem.admissible(problem.resting)[0]
    answers = []
    for edge in (-WITHIN_BAND, WITHIN_BAND):
        held = partial(follow, first=float(middle) + edge * model.dead_band)
        other = held(problem.desired[:, 0])
        requests = best_requests(other, solver)
        answers.append((other.exact_error(requests), held, other, requests))
    error, held, other, requests = min(answers, key=itemgetter(0))
    angles, best = problem.exact_angles(column), other.exact_angles(requests)
    if angles is None or best is None or error >= problem.error(angles):
        return follow, problem, column
    if allowed_beside(problem, judged(problem, best), smoothness=smoothness).by(
        judged(problem, angles)
    ):
        return follow, problem, column
    return held, other, requests


def best_requests(problem: Problem, solver: Solver) -> Array:
    """Requests of least error by a solver [rad], (n, 1)."""
    guess = initial_guess(problem)
    if solver == "gauss-newton":
        return search(problem, guess)
    return transcribed_requests(problem, guess)


def search(problem: Problem, state: State) -> Array:
    """The best requests found for one joint, (n, 1).

    A joint that is at top speed nearly throughout, or whose acceleration is limited, may follow
    fitted lines better than anything that the search finds: it starts from these as well. Where
    next to no error need be left, high powers of it lead nowhere, and the plan for the root mean
    square leaves the smaller largest error. If the plan stays far from the ideal, a search with
    wide corners follows. For short cycles and joints that overshoot, where derivatives say little,
    further ones start from the desired angles and from those as early as the joint is late.
    """
    (model,) = problem.models
    starts = [state]
    limited = math.isfinite(model.max_acceleration)  # of which the ideal does not know
    if limited or below_top_speed(problem, state.angles) <= OPTIONS.compared:
        starts.append(state._replace(requests=best_closed_form(problem)))
    best = min((minimise(problem, start, NARROW) for start in starts), key=itemgetter(1))
    near = OPTIONS.far * problem.error(state.angles)
    if problem.norm == "max" and best[1] > near:
        found, _ = minimise(replace(problem, norm="rms"), state, NARROW)
        best = min(best, (found, problem.exact_error(found)), key=itemgetter(1))
    if best[1] > near + OPTIONS.negligible * model.theta_0:
        short = len(problem.desired) <= 2 * problem.ages.oldest
        if short or model.v_max_per_tick > model.theta_0:
            further = [state._replace(requests=requests) for requests in _early_and_late(problem)]
            answers = [minimise(problem, start, NARROW) for start in further]
            best = min(best, *answers, key=itemgetter(1))
            starts += further
        other = min((minimise(problem, start, WIDE) for start in starts), key=itemgetter(1))
        if other[1] < (1.0 - OPTIONS.gain) * best[1]:
            best = other
    answer, least = best
    logging.getLogger(__name__).debug(
        "joint: best of the searches from %d start(s) %s", len(starts), angle_text(least)
    )
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion", "no requests lead to a steady cycle")
    return answer


def initial_guess(problem: Problem) -> State:
    """The ideal, the best trajectory within the top speeds (section 4), and its closed form.

    Every sample is a knot: request k is on the line from sample i = floor(k + l + a/2) on, raised
    by its C_m (section 3). From rest the ideal is brought to where the joint can be by then.
    """
    (model,), (load,) = problem.models, problem.loads
    desired, cyclic = problem.desired[:, 0], problem.cyclic
    count = len(desired)
    ideal = nearest_within_speeds(model, desired, load, cyclic=cyclic)
    if problem.start is not None:
        ideal = within_attainable_range(model, ideal, float(problem.start[0]), load)
    torques = np.zeros(count) if load is None else np.roll(load, -1)  # on the way to the next
    low, high = (limit * model.period for limit in model.speed_limits(torques))
    steps = np.diff(ideal, append=ideal[:1] if cyclic else ideal[-1:])
    steps = np.clip(steps, low, high)
    samples = np.arange(count)
    knots = samples + int(switching_time(model) / model.period + SAME_TIME)
    knots = knots if cyclic else np.minimum(knots, count - 2)
    at = knots % count
    slopes = steps[at] / model.period
    offsets = interpolated_offset(model, slopes, rule="exact", load=torques[at])
    requests = ideal[at] + steps[at] * (samples - knots) + offsets
    return State(problem.admissible(requests[:, np.newaxis]), ideal[:, np.newaxis])


def nearest_within_speeds(
    model: JointModel, desired: Array, load: Array | None, *, cyclic: bool
) -> Array:
    """The trajectory within the joint's top speeds that is nearest in least squares [rad], (n,).

    Either top speed is v_max away from their mean, -v^- / 2 + v^+ / 2. What exceeds the sum of the
    means is bounded alike in both directions; a cycle is cut out of three in a row.
    """
    low, high = model.speed_limits(0.0 if load is None else load)
    mean = (low + high) / 2.0 * model.period
    if not np.any(mean):
        return slope_bounded(desired, model.v_max_per_period, cyclic=cyclic)
    turns, count = 3 if cyclic else 1, len(desired)
    drift = np.cumsum(np.tile(np.broadcast_to(mean, count), turns))
    sheared = np.tile(desired, turns) - drift
    bounded = slope_bounded(sheared, model.v_max_per_period, cyclic=False) + drift
    return bounded[(turns // 2) * count :][:count]


def below_top_speed(problem: Problem, ideal: Array) -> int:
    """How many samples the best trajectory within the top speeds reaches at less than these.

    Args:
        problem: One joint.
        ideal: That trajectory [rad], shape (n, 1).
    """
    (model,), (load,) = problem.models, problem.loads
    limits = model.speed_limits(0.0 if load is None else load)
    low, high = ((1.0 - BARELY_SLOWER) * limit * model.period for limit in limits)
    before = ideal[-1:] if problem.cyclic else ideal[:1]
    steps = np.diff(ideal[:, 0], prepend=before[:, 0])
    fast = (steps <= low) | (steps >= high)
    resting = 0 if problem.cyclic else request_ages(model).youngest + 1
    return int(np.count_nonzero(~fast[resting:]))


def within_attainable_range(
    model: JointModel, angles: Array, start: float, load: Array | None = None
) -> Array:
    """Angles, clipped to what a joint that rests at the start can attain by then [rad], (n,)."""
    resting = request_ages(model).youngest + 1  # samples before the second request acts
    moving = np.maximum(np.arange(len(angles)) - resting + 1.0, 0.0)
    if load is None:
        low, high = (limit * model.period * moving for limit in model.speed_limits())
    else:
        steps = np.diff(moving, prepend=0.0)  # 1 once it moves
        low, high = (np.cumsum(limit * model.period * steps) for limit in model.speed_limits(load))
    return np.clip(angles, start + low, start + high)


def _early_and_late(problem: Problem) -> list[Array]:
    """The desired angles as requests, l + a/2 early and as they are [rad], (n, 1)."""
    (model,) = problem.models
    count = len(problem.resting)
    later = np.arange(count) + round(switching_time(model) / model.period)
    later = later % count if problem.cyclic else np.minimum(later, count - 1)
    return [problem.admissible(problem.resting[later]), problem.resting]
