"""From a task to requests: which searches run, and how their best answer is chosen."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from planner.approximation.values import slope_bounded
from planner.exceptions import SolverFailed, about, angle_text
from planner.model.evidence import ENCODER_STEP, Evidence
from planner.model.joint import JointModel, request_ages
from planner.planning.arguments import Solver
from planner.planning.closed_form import SAME_TIME, best_closed_form
from planner.planning.gauss_newton import SIMULATED, Stage
from planner.planning.line_inverse import interpolated_offset
from planner.planning.problem import Problem, problem_of
from planner.planning.result import UNFORESEEN
from planner.planning.search import (
    FOOT,
    NARROW,
    STATIONARY,
    WIDE,
    State,
    allowed_beside,
    holding,
    judged,
    minimise,
    robust_requests,
    smoothed,
)
from planner.planning.task import Task
from planner.trajectory import Array, Mask, rms, steps

# Effects were measured over 109 joints, half of them outside Equation 13.

FAR = 1.03
"""Ratio of the error to that of the ideal from which on further searches follow. At 1.015 nothing
is gained, at 1.06 up to 0.4 % lost."""

GAIN = 2e-3
"""Least relative gain for the answer of a wide search to be chosen, as its requests change more:
without it the sum of squared second differences is 3 % larger."""

NEGLIGIBLE = 5e-4
"""Error up to which no further searches follow [theta_0]."""

COMPARED = 16
"""Samples that the ideal reaches below the top speeds up to which the search also starts from the
closed forms, as only the times of changes between lines are free. Without it a closed form is
better for 6 % of 400 joints on much faster paths of 4 to 69 samples, by 0.8 % at worst; with it for
none. It takes 0.05 to 0.3 s."""

ACCELERATING = 0.2
"""Share of the time that the ideal, which ignores the acceleration limit, would accelerate at that
limit, from which on the search also starts from the closed forms [-], unless the plan is within an
encoder's step of the ideal. Of 160 joints with such a limit one in ten ends closer with that start,
by 65 % at most; all are above 0.2. It takes 0.1 to 0.8 s."""

BEGINNING = 20.0
"""Length of the beginning of a path, relative to a joint's settling time [-]: the first request has
no effect after a few of these."""

BARELY_SLOWER = 1e-3
"""Relative tolerance of a speed that counts as the top speed: the ideal is iterative."""

SMOOTH = tuple(stage._replace(weight=1e-2, smoothing=True) for stage in NARROW)
"""Stages from which smoothing starts as well where the acceleration is limited: at that limit
requests have little effect, and those of least error chatter. For a hobby servo's walk the squared
second differences are 1/700 of theirs, with a twentieth more error."""


class Solved(NamedTuple):
    """The answer of a search.

    Attributes:
        requests: Requests to the joints [rad], shape (n, k).
        nominal: With several models: requests for the nominal ones alone; else None.
    """

    requests: Array
    nominal: Array | None


HARDLY = 1.25
"""Ratio of the errors up to which the best requests are hardly better than those near executed
ones. At 1.05 four of nine series of trials of servos with an integral term go astray."""

ROUGHER = 3.0
"""Ratio of the sums of squared second differences beyond which the best requests are smoother: of
a joint far beyond its top speed requests near the executed ones may have a hundred times theirs,
of six servos within their speeds at most 2.1 times."""

NEAR = tuple(Stage(radius, 1e-2) for radius in (0.1, 0.04, 0.02, 0.008, 0.006))
"""Stages near executed requests. (With a third of the weight the third trials of one servo in two
with an integral term are twice as far off, with three times the weight those of a hobby servo.)"""


def solve(
    task: Task,
    *,
    solver: Solver = "gauss-newton",
    executed: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Solved:
    """The requests for a task: of a foot all at once, of joints one by one.

    Args:
        task: The task.
        solver: Solver of a joint.
        executed: Requests from which the disturbance was measured [rad], (n, k): near these a
            search stays, see :func:`nearer`.
        progress: Called with the name of each joint.

    Raises:
        SolverFailed: No requests were found that lead to a steady cycle.
    """
    if task.disturbance is not None:  # the models' errors are measured, except for their changes
        sizes = [UNFORESEEN * rms(column) for column in task.disturbance.T]
        models = (
            tuple(each.with_evidence(Evidence(size)) for each in candidates)
            for candidates, size in zip(task.models, sizes, strict=True)
        )
        task = replace(task, models=tuple(models))
    if task.goal == "foot":
        return solve_foot(task, executed)
    solutions = []
    for j, name in enumerate(task.names):
        progress(name)
        with about(name):
            column = None if executed is None else executed[:, j : j + 1]
            solutions.append(solve_joint(task.joint(j), solver=solver, executed=column))
    requests = np.column_stack([each.requests for each in solutions])
    if all(each.nominal is None for each in solutions):
        return Solved(requests, None)
    nominal = [each.requests if each.nominal is None else each.nominal for each in solutions]
    return Solved(requests, np.column_stack(nominal))


def solve_joint(
    task: Task, *, solver: Solver = "gauss-newton", executed: Array | None = None
) -> Solved:
    """The requests for one joint, (n, 1)."""
    (models,), problem = task.models, problem_of(task)
    column, band, best = best_requests(problem, solver), models[0].steady.dead_band, None
    if task.start is not None and band and len(models) == 1:
        problem, column, best = first_request_freed(problem, column, solver)
    if band and problem.smoothness == 0.0:
        # Of 374 random joints a closed form is better for 12, all with friction, by up to 57 %.
        column = min(column, best_closed_form(problem), key=problem.exact_error)

    def candidates() -> Iterator[Array]:
        if band:
            # Over 36 sines, holds and squares of a servo with 2 degrees of dry friction, half of
            # them with noise of 0.06 degrees, half and twice of 0.2 change nothing; without,
            # requests change direction 15 % more often, at holds 75 %.
            path = without_small_reversals(problem.desired[:, 0], 0.2 * band, cyclic=task.cyclic)
            yield best_requests(replace(problem, desired=path[:, np.newaxis]), solver)
        if math.isfinite(models[0].max_acceleration):
            yield minimise(problem, initial_guess(problem), SMOOTH)[0]

    column = smoothed(problem, column, best=best, candidates=candidates())
    if executed is not None:
        column = nearer(problem, column, executed)
    return _for_all_models(task, problem, column, NARROW)


def nearer(problem: Problem, requests: Array, executed: Array) -> Array:
    """Requests near executed ones, where the best ones are far away and hardly better.

    A saturated joint has very different requests of about the same error by its model. Where the
    joint saturates later, a change from the ones to the others shows. Near the executed requests
    (10) has the distances from these in place of those from R*: a proximal point step.

    Args:
        problem: The problem, with the disturbance measured under the executed requests.
        requests: The best requests [rad], (n, J).
        executed: The executed requests [rad], (n, J).
    """
    start = problem.admissible(executed)
    angles, best = problem.exact_angles(start), problem.exact_angles(requests)
    if angles is None or best is None:
        return requests
    nearby = replace(problem, near=start)
    answer = smoothed(nearby, minimise(nearby, State(start, angles), NEAR)[0])
    worse = problem.exact_error(answer) > HARDLY * problem.error(best)
    rougher = problem.roughness(answer) > ROUGHER * problem.roughness(requests)
    return requests if worse or rougher else answer


def first_request_freed(
    problem: Problem, column: Array, solver: Solver
) -> tuple[Problem, Array, Array | None]:
    """The problem from rest with the first request that serves best, and the plan for it.

    Where the given plan is kept although another is better, the angles of the better one come
    third.

    Anywhere within the dead band it holds the joint at the start. Until it has left the window of
    the acceleration it draws on a joint that moves, the less the nearer it is to the edge on the
    side of the motion. Another request is taken only for a gain that a robot would show: without
    smoothing half of 40 random motions with dead bands of 0.2 to 3 degrees gain a quarter or more.
    The middle may lie beyond the limits: edges are about the middle itself, and the problem clips
    them.

    Of a long path the beginning is searched first. A difference that does not show there does not
    show in the whole.
    """
    (model,), middle = problem.models, problem.first_requests
    assert middle is not None, "from rest a first request holds the joint"
    within = 1.0 - 1e-9  # rounding must not move the joint
    firsts = [middle + edge * model.dead_band for edge in (-within, within)]
    settled = (model.theta_0 / model.v_max + model.time_constant) / model.period
    count = math.ceil(BEGINNING * (problem.ages.oldest + settled))
    if len(problem.desired) > 2 * count:
        beginning = problem.beginning(count)
        freed, _, _ = first_request_freed(beginning, best_requests(beginning, solver), solver)
        if freed.first is None:
            return problem, column, None
        firsts = [freed.first]
    answers = []
    for first in firsts:
        candidate = replace(problem, first=first)
        requests = best_requests(candidate, solver)
        answers.append((candidate.exact_error(requests), candidate, requests))
    error, candidate, requests = min(answers, key=itemgetter(0))
    angles, best = problem.exact_angles(column), candidate.exact_angles(requests)
    if angles is None or best is None or error >= problem.error(angles):
        return problem, column, None
    if allowed_beside(problem, judged(problem, best)).by(judged(problem, angles)):
        return problem, column, best
    return candidate, requests, None


def without_small_reversals(angles: Array, least: float, *, cyclic: bool) -> Array:
    """The path made monotone between its deep turning points, by least squares.

    To turn back, the requests of a joint with dry friction jump from one edge of the dead band to
    the other. Along a path with noise they would do so at almost every sample, for errors that are
    small beside the dead band.

    A path of which no reversal is shallower than ``least`` is returned as it is.

    Args:
        angles: The path [rad], shape (n,).
        least: Depth up to which a reversal is removed [rad].
        cyclic: Whether the path repeats for ever.

    Returns:
        The path to follow [rad], shape (n,).
    """
    from scipy.optimize import isotonic_regression  # slow to import

    first = int(np.argmax(angles)) if cyclic else 0
    turned = np.roll(angles, -first)
    if cyclic:
        turned = np.append(turned, turned[0])
    points = turning_points(turned, least)
    if not points:
        return np.roll(_without_turn(turned, cyclic=cyclic)[: len(angles)], first)
    ends = [*(sample for sample, _ in points), len(turned)]
    # Before the first turning point the path goes towards it, after each away from it.
    pieces = [(0, *points[0])]
    pieces += [(at, end, not high) for (at, high), end in zip(points, ends[1:], strict=True)]
    monotone = [
        isotonic_regression(turned[begin:end], increasing=rising).x
        for begin, end, rising in pieces
        if end > begin
    ]
    return np.roll(np.concatenate(monotone)[: len(angles)], first)


def turning_points(angles: Array, least: float) -> list[tuple[int, bool]]:
    """Where a path turns by more than ``least``: extrema with so large moves between them.

    Each is a sample, and whether it is a maximum.
    """
    points: list[tuple[int, bool]] = []
    low = high = direction = 0
    for k, angle in enumerate(angles.tolist()):
        if angle > angles[high]:
            high = k
        if angle < angles[low]:
            low = k
        if direction >= 0 and angles[high] - angle > least:
            points.append((high, True))
            direction, low = -1, k
        elif direction <= 0 and angle - angles[low] > least:
            points.append((low, False))
            direction, high = 1, k
    return points


def _without_turn(angles: Array, *, cyclic: bool) -> Array:
    """The nearest path that does not turn: monotone, and for a cycle constant."""
    from scipy.optimize import isotonic_regression  # slow to import

    if cyclic:
        return np.full(len(angles), float(np.mean(angles[:-1])))
    both = [isotonic_regression(angles, increasing=way).x for way in (True, False)]
    nearest: Array = min(both, key=lambda path: float(np.sum((path - angles) ** 2)))
    return nearest


def best_requests(problem: Problem, solver: Solver) -> Array:
    """Requests of least error by a solver [rad], (n, 1)."""
    guess = initial_guess(problem)
    if solver == "gauss-newton":
        return search(problem, guess)
    from planner.planning.direct_transcription import transcribed_requests  # slow to import

    return transcribed_requests(problem, guess)


def search(problem: Problem, state: State) -> Array:
    """The best requests of the searches for one joint, (n, 1).

    A joint that is at top speed, or accelerates as fast as it can, for much of the time may follow
    fitted lines better than anything that the search finds: it starts from these as well. Where
    next to no error need be left, high powers of it lead nowhere, and the plan for the root mean
    square leaves the smaller largest error, in one of 40 random paths 1/18 of it. If the plan stays
    far from the ideal, a search with wide corners follows. For short cycles and joints that
    overshoot, where derivatives help little, further ones start from the desired angles, as they
    are and as early as the joint is late.
    """
    (model,) = problem.models
    starts, best = [state], minimise(problem, state, NARROW)
    near = FAR * problem.error(state.angles)
    limited = math.isfinite(model.max_acceleration) and best[1] > near + ENCODER_STEP
    limited = limited and time_accelerating(problem, state.angles) > ACCELERATING
    if limited or below_top_speed(problem, state.angles) <= COMPARED:
        starts.append(state._replace(requests=best_closed_form(problem)))
        best = min(best, minimise(problem, starts[1], NARROW), key=itemgetter(1))
    if problem.norm == "max" and best[1] > near:
        other = minimise(problem, state, NARROW, through_rms=True)
        best = min(best, other, key=itemgetter(1))
    if best[1] > near + NEGLIGIBLE * model.theta_0:
        short = len(problem.desired) <= 2 * problem.ages.oldest
        if short or model.v_max_per_tick > model.theta_0:
            further = [state._replace(requests=requests) for requests in early_and_late(problem)]
            answers = [minimise(problem, start, NARROW) for start in further]
            best = min(best, *answers, key=itemgetter(1))
            starts += further
        other = min((minimise(problem, start, WIDE) for start in starts), key=itemgetter(1))
        if other[1] < (1.0 - GAIN) * best[1]:
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
    by its C_m (section 3). From rest the ideal is clipped to the attainable range.
    """
    (model,), (load,) = problem.models, problem.loads
    desired, cyclic = problem.desired[:, 0], problem.cyclic
    count = len(desired)
    ideal = nearest_within_speeds(model, desired, load, cyclic=cyclic)
    if problem.start is not None:
        ideal = within_attainable_range(model, ideal, float(problem.start[0]), load)
    torques = np.zeros(count) if load is None else np.roll(load, -1)  # on the way to the next
    low, high = (limit * model.period for limit in model.speed_limits(torques, ideal))
    to_next = steps(np.append(ideal, ideal[:1] if cyclic else ideal[-1:]), cyclic=False)
    to_next = np.clip(to_next, low, high)
    samples = np.arange(count)
    knots = samples + int(model.switching_time / model.period + SAME_TIME)
    knots = knots if cyclic else np.minimum(knots, count - 2)
    at = knots % count
    slopes = to_next[at] / model.period
    offsets = interpolated_offset(model, slopes, rule="exact", load=torques[at], angle=ideal[at])
    requests = ideal[at] + to_next[at] * (samples - knots) + offsets - model.pose_sag(ideal[at])
    return State(problem.admissible(requests[:, np.newaxis]), ideal[:, np.newaxis])


def nearest_within_speeds(
    model: JointModel, desired: Array, load: Array | None, *, cyclic: bool
) -> Array:
    """The trajectory within the joint's top speeds that is nearest in least squares [rad], (n,).

    Either top speed is v_max away from their mean, -v^- / 2 + v^+ / 2. The trajectory less the sum
    of the means has the same bound in both directions; a cycle is cut out of three in a row. A sag
    by the pose counts as at the desired angles.
    """
    low, high = model.speed_limits(0.0 if load is None else load, desired)
    mean = (low + high) / 2.0 * model.period
    if not np.any(mean):
        return slope_bounded(desired, model.v_max_per_period, cyclic=cyclic)
    turns, count = 3 if cyclic else 1, len(desired)
    drift = np.cumsum(np.tile(np.broadcast_to(mean, count), turns))
    sheared = np.tile(desired, turns) - drift
    bounded = slope_bounded(sheared, model.v_max_per_period, cyclic=False) + drift
    return bounded[(turns // 2) * count :][:count]


def below_top_speed(problem: Problem, ideal: Array) -> int:
    """Number of samples that the best trajectory within the top speeds reaches below these.

    Args:
        problem: One joint.
        ideal: This trajectory [rad], shape (n, 1).
    """
    (model,), (load,) = problem.models, problem.loads
    limits = model.speed_limits(0.0 if load is None else load, ideal[:, 0])
    low, high = ((1.0 - BARELY_SLOWER) * limit * model.period for limit in limits)
    before = ideal[-1:, 0] if problem.cyclic else ideal[:1, 0]
    moved = ideal[:, 0] - np.concatenate([before, ideal[:-1, 0]])
    fast = (moved <= low) | (moved >= high)
    resting = 0 if problem.cyclic else request_ages(model).youngest + 1
    return int(np.count_nonzero(~fast[resting:]))


def time_accelerating(problem: Problem, ideal: Array) -> float:
    """Share of the time that the ideal's changes of speed take at the acceleration limit.

    Args:
        problem: One joint.
        ideal: The best trajectory within the top speeds [rad], shape (n, 1).
    """
    (model,) = problem.models
    ends = (ideal[-1:], ideal[:1]) if problem.cyclic else (ideal[:1], ideal[-1:])
    changes = np.diff(np.concatenate([ends[0], ideal, ends[1]]), 2, axis=0)  # [rad/period^2]
    return float(np.mean(np.abs(changes))) / (model.hold**2 * model.law.acceleration)


def within_attainable_range(
    model: JointModel, angles: Array, start: float, load: Array | None = None
) -> Array:
    """Angles clipped to the attainable range of a joint at rest at the start [rad], (n,)."""
    resting = request_ages(model).youngest + 1  # samples before the second request acts
    moving = np.maximum(np.arange(len(angles)) - resting + 1.0, 0.0)
    if load is None and model.most_pose_sag == 0.0:
        low, high = (limit * model.period * moving for limit in model.speed_limits())
    else:
        limits = model.speed_limits(0.0 if load is None else load, angles)
        low, high = (np.cumsum(limit * model.period * (moving > 0.0)) for limit in limits)
    return np.clip(angles, start + low, start + high)


def early_and_late(problem: Problem) -> list[Array]:
    """The desired angles as requests, l + a/2 early and as they are [rad], (n, 1)."""
    (model,) = problem.models
    count = len(problem.resting)
    later = np.arange(count) + round(model.switching_time / model.period)
    later = later % count if problem.cyclic else np.minimum(later, count - 1)
    return [problem.admissible(problem.resting[later]), problem.resting]


def solve_foot(task: Task, executed: Array | None = None) -> Solved:
    """The requests for all joints of a leg, (n, k), from the plans for its joints one by one."""
    problem = problem_of(task)
    singly = [solve_joint(_alone(task, problem, j)).requests for j in range(len(task.names))]
    problem, requests = foot_requests(problem, np.hstack(singly))
    if executed is not None:
        requests = nearer(problem, requests, executed)
    return _for_all_models(task, problem, requests, FOOT)


def _for_all_models(
    task: Task, problem: Problem, nominal: Array, search: Sequence[Stage]
) -> Solved:
    """The requests for all models of a task, from the requests for the nominal ones."""
    if len(task.scenarios) == 1:
        return Solved(nominal, None)
    robust = robust_requests(
        problem,
        task.scenarios,
        [task.loads_on(each) for each in task.scenarios],
        nominal,
        robust=task.robust or "mean",
        search=search,
    )
    return Solved(robust, nominal)


def _alone(task: Task, problem: Problem, j: int) -> Task:
    """The task of one joint of a leg that should follow its angles in the problem of the foot."""
    nearest = np.ascontiguousarray(problem.desired[:, j : j + 1])
    return replace(
        task.joint(j).unsmoothed,
        models=((task.nominal[j],),),
        desired=nearest,
        norm="rms",
        start=None if task.cyclic else nearest[0],
        disturbance=None,
    )


def foot_requests(problem: Problem, singly: Array) -> tuple[Problem, Array]:
    """The best requests for the foot, (n, k), from the plans for its joints one by one.

    They come with the problem that they solve, in which joints may be held.
    """
    first = problem.admissible(singly)
    angles = problem.exact_angles(first)
    state = State(first, problem.desired if angles is None else angles)
    best, least = minimise(problem, state, FOOT)
    if problem.norm == "max":
        other = minimise(problem, state, FOOT, through_rms=True)
        best, least = min((best, least), other, key=itemgetter(1))
    logging.getLogger(__name__).debug("foot: best cost %.4g", least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion of the foot", "no requests lead to a steady cycle")
    reached = problem.exact_angles(best)
    assert reached is not None, "the search's error is finite"
    problem, best = with_stationary_joints(problem, best, reached)
    return problem, smoothed(problem, best, best=reached)


def with_stationary_joints(
    problem: Problem, requests: Array, angles: Array
) -> tuple[Problem, Array]:
    """The plan with stationary joints at rest, if a robot shows no difference.

    A joint that is stationary along the whole path can still compensate for a little of the errors
    of the other joints. Where this gain is within what the smoothing allows, it should not move.

    Args:
        problem: The problem of the joints together.
        requests: The requests of a good plan [rad], shape (n, k).
        angles: Its angles by the exact models [rad], shape (n, k).

    Returns:
        The problem with these joints held, and the plan for it; or the arguments unchanged.
    """
    stationary: Mask = np.ptp(problem.resting, axis=0) <= STATIONARY
    if not np.any(stationary) or np.all(stationary):
        return problem, requests
    fixed_problem = holding(problem, stationary, problem.resting[0])
    sharp = [stage for stage in FOOT if stage.radius < SIMULATED]
    state = State(fixed_problem.admissible(requests), angles)
    answer, error = minimise(fixed_problem, state, sharp)
    reached = fixed_problem.exact_angles(answer)
    allowed = allowed_beside(problem, judged(problem, angles))
    as_good = error <= problem.error(angles) + 1e-13  # rounding [m]
    if reached is not None and (as_good or allowed.by(judged(problem, reached))):
        return fixed_problem, answer
    return problem, requests
