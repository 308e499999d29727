"""The search for the requests of a task, from top to bottom.

Each stage minimises (10) of ``docs/math.md`` on the model with corners of one radius, and the next
one carries on from its answer with sharper corners and less regularisation: a homotopy. Joints are
searched one by one, those of a leg together. At the end requests are made smoother for as much
error as a robot would not show (section 6 and (12b)).

Effects of the numbers below were measured over 109 joints, half of them outside Equation 13, where
nothing else is said.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter, itemgetter
from typing import NamedTuple

import numpy as np

from planner.approximation.values import attainable_error
from planner.arrays import Array, Mask, reversals, rms, without_small_reversals
from planner.exceptions import SolverFailed, about
from planner.model.evidence import ENCODER_STEP, UNFORESEEN, Evidence
from planner.model.joint import JointModel
from planner.model.response import farthest_per_period
from planner.planning.closed_form import below_top_speed, best_closed_form, initial_guess
from planner.planning.gauss_newton import (
    COASTING,
    HOLD,
    LARGEST_SHARE,
    SIMULATED,
    Search,
    Stage,
    go_through,
    work_of,
)
from planner.planning.problem import Problem, problem_of
from planner.planning.task import Solver, Task
from planner.planning.time_shift import best_lead, early

LOGGER = logging.getLogger(__name__)

NARROW = (
    *map(Stage, (0.5, 0.2, 0.1, 0.04, 0.02, 0.008), (1e-2, 1e-3, 1e-4, 5e-5, 5e-5, 5e-5)),
    Stage(0.006, 1e-5, steps=2),
)
"""The stages. A regularisation keeps the first ones out of saturated, flat regions, and the last
ones from jumping where nothing is gained. Fewer than seven stages cost up to 13 %."""

SHARP = tuple(stage for stage in NARROW if stage.radius < SIMULATED)
"""Those whose answers are simulated, for a search that begins near its end."""

WIDE = tuple(
    map(Stage, (2.0, 1.0, 0.5, 0.2, 0.08, 0.02, 0.008), (1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-5, 1e-8))
)
"""The stages of a search far from its start: with corners so wide every request has an effect. The
last regularisation is very weak, which matters where next to no error remains. Without this search
plans lose up to 18 %."""

LARGEST = tuple(
    Stage(radius, 1e-5, power, 8)
    for radius, power in zip(
        (0.1, 0.1, 0.1, 0.05, 0.02, 0.006), (4.0, 8.0, 16.0, 32.0, 64.0, 64.0), strict=True
    )
)
"""Where the largest error counts, the stages after the wide corners: it is approached through sums
of powers of the errors."""

SMOOTH = tuple(stage._replace(weight=1e-2, smoothing=True) for stage in NARROW)
"""Stages from which smoothing starts as well where the acceleration is limited: at that limit
requests have little effect, and those of least error chatter. For a hobby servo's walk the squared
second differences are 1/700 of theirs, with a twentieth more error."""

NEAR = tuple(Stage(radius, 1e-2) for radius in (0.1, 0.04, 0.02, 0.008, 0.006))
"""Stages near executed requests. (With a third of the weight the third trials of one servo in two
with an integral term are twice as far off, with three times the weight those of a hobby servo.)"""

FOOT = tuple(stage._replace(steps=16) for stage in (Stage(1.5, 1e-3), Stage(0.7, 1e-3), *NARROW))
"""The stages for a foot. Wide corners first: the joints must leave the best plans for each alone.
Over 38 feet, first corners of 2 and 1 lose 0.35 % at worst, no wide corners 0.55 %. Where joints
can compensate for one another, stages take many steps; 12 or 24 make no difference."""


def solve(
    task: Task,
    *,
    solver: Solver = "gauss-newton",
    # requests from which the disturbance was measured [rad], (n, k): near these a search stays, see
    # :func:`nearer`
    executed: Array | None = None,
    progress: Callable[[str], None] | None = None,  # called with the name of each joint
) -> tuple[Array, Array | None]:
    """The requests for a task [rad], (n, k): of a foot all at once, of joints one by one.

    With several models of a joint also those for the nominal models alone, else None.
    """
    if task.disturbance is not None:  # the models' errors are measured, except for their changes
        models = tuple(
            tuple(each.with_evidence(Evidence(UNFORESEEN * rms(column))) for each in candidates)
            for candidates, column in zip(task.models, task.disturbance.T, strict=True)
        )
        task = replace(task, models=models)
    if task.goal == "foot":
        return solve_foot(task, executed)
    requests, nominal = np.empty_like(task.desired), np.empty_like(task.desired)
    for j, name in enumerate(task.names):
        if progress:
            progress(name)
        with about(name):
            near = None if executed is None else executed[:, j : j + 1]
            own, alone = solve_joint(task.joint(j), solver=solver, executed=near)
            requests[:, j : j + 1], nominal[:, j : j + 1] = own, own if alone is None else alone
    return requests, nominal if max(map(len, task.models)) > 1 else None


def solve_joint(
    task: Task, *, solver: Solver = "gauss-newton", executed: Array | None = None
) -> tuple[Array, Array | None]:
    """The requests for one joint, (n, 1), as :func:`solve`."""
    (models,), problem = task.models, problem_of(task)
    requests, band, best = best_requests(problem, solver), models[0].steady.dead_band, None
    if task.start is not None and band and len(models) == 1:
        problem, requests, best = first_request_freed(problem, requests, solver)
    if band and problem.smoothness == 0.0:
        # Of 374 random joints a closed form is better for 12, all with friction, by up to 57 %.
        requests = min(requests, best_closed_form(problem), key=problem.exact_error)

    others = []
    if band and problem.smoothness > 0.0:
        # Over 36 sines, holds and squares of a servo with 2 degrees of dry friction, half of them
        # with noise of 0.06 degrees, half and twice of 0.2 change nothing; without, requests change
        # direction 15 % more often, at holds 75 %.
        path = without_small_reversals(problem.desired[:, 0], 0.2 * band, cyclic=task.cyclic)
        others.append(best_requests(replace(problem, desired=path[:, np.newaxis]), solver))
    if problem.smoothness > 0.0 and math.isfinite(models[0].max_acceleration):
        others.append(minimise(problem, *initial_guess(problem), SMOOTH)[0])
    requests = smoothed(problem, requests, best=best, others=others)
    if executed is not None:
        requests = nearer(problem, requests, executed)
    return for_all_models(task, problem, requests, NARROW)


def best_requests(problem: Problem, solver: Solver) -> Array:
    """Requests of least error for one joint [rad], (n, 1).

    A joint that is at top speed, or accelerates as fast as it can, for much of the time may follow
    fitted lines better than anything that the search finds: it starts from these as well. Where
    next to no error need be left, the plan for the root mean square leaves the smaller largest
    error, in one of 40 random paths 1/18 of it. If the plan stays far from the ideal, a search with
    wide corners follows; for short cycles and joints that overshoot also from the desired angles,
    as they are and as early as the joint is late, and from the best time shift, where it may be as
    good.
    """
    requests, ideal = initial_guess(problem)
    if solver == "ipopt":
        from planner.planning.direct_transcription import transcribed_requests  # slow to import

        return transcribed_requests(problem, requests, ideal)
    (model,), error = problem.drives, itemgetter(1)
    from_start = partial(minimise, problem, angles=ideal, stages=NARROW)
    starts, best = [requests], from_start(requests)
    # With a smaller multiple of the ideal's error nothing is gained, with a larger one up to 0.4 %
    # is lost.
    near = 1.03 * problem.errors_of_models(ideal)[0]
    if problem.norm == "max":  # the ideal is that of least squares
        farthest = farthest_per_period(model, problem.torques[0])
        near = 1.03 * attainable_error(problem.desired[:, 0], farthest, cyclic=problem.cyclic)
    limited = math.isfinite(model.max_acceleration) and best[1] > near + ENCODER_STEP
    if limited:  # share of the time that the ideal's changes of speed take at the limit
        padded = np.pad(ideal[:, 0], 1, mode="wrap" if problem.cyclic else "edge")
        changes = float(np.mean(np.abs(np.diff(padded, 2))))  # [rad/period^2]
        # Of 160 joints with such a limit one in ten ends closer with that start, by 65 % at most.
        limited = changes / (model.hold**2 * model.law.acceleration) > 0.2
    # Without that start a closed form is better for 6 % of 400 joints on much faster paths.
    if limited or below_top_speed(problem, ideal) <= 16:
        starts.append(best_closed_form(problem))
        best = min(best, from_start(starts[1]), key=error)
    if problem.norm == "max" and best[1] > near:
        best = min(best, from_start(requests, through_rms=True), key=error)
    if best[1] > near + 5e-4 * model.theta_0:  # an error that matters
        count = len(problem.desired)
        if count <= 2 * problem.acting.oldest or model.v_max_per_tick > model.theta_0:
            later = np.arange(count) + round(model.switching_time / model.period)
            later = later % count if problem.cyclic else np.minimum(later, count - 1)
            further = [problem.admissible(problem.resting[later]), problem.resting]
            best = min(best, *map(from_start, further), key=error)
            starts += further
        # Where a path needs far more acceleration than a joint has, plans had up to 4.7 times the
        # error of the best shift without it; of 785 others three were 10 to 20 % worse.
        delay = model.switching_time / model.period + problem.settling
        if limited or problem.exact_error(early(problem, delay)[:, np.newaxis]) < 1.5 * best[1]:
            shift = problem.admissible(early(problem, best_lead(problem))[:, np.newaxis])
            best = min(best, from_start(shift), key=error)
        other = min(map(partial(from_start, stages=WIDE), starts), key=error)
        # Its requests change more: taken for any gain, squared second differences are 3 % larger.
        if other[1] < 0.998 * best[1]:
            best = other
    answer, least = best
    if LOGGER.isEnabledFor(logging.DEBUG):
        text = f"{math.degrees(least):.4g} deg"
        LOGGER.debug("joint: best of the searches from %d start(s) %s", len(starts), text)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion", "no requests lead to a steady cycle")
    return answer


def minimise(
    problem: Problem,
    requests: Array,
    angles: Array,
    stages: Sequence[Stage],
    *,
    through_rms: bool = False,
) -> tuple[Array, float]:
    """The best requests of the stages, judged by the exact models, and their error.

    They start from requests within the limits, (n, J), and from angles, (n, A). Where the largest
    error counts, with ``through_rms`` the plan for the root mean square comes first.
    """
    if problem.norm == "max":
        wide = [stage for stage in stages if stage.radius >= LARGEST[0].radius]
        stages = [*(stages if through_rms else wide), *LARGEST]
    search = search_from(problem, requests, angles, smoothing=stages[0].smoothing)
    ends, _, figures = go_through(problem.spec, search, np.array(stages, dtype=np.float64))
    least = problem.exact_error(requests)
    best = int(np.argmin(figures[:, 0]))
    if figures[best, 0] < least:
        return ends[best], float(figures[best, 0])
    return requests, least


def search_from(problem: Problem, requests: Array, angles: Array, *, smoothing: bool) -> Search:
    """A search from requests (n, J) and angles (n, A) [rad]: see :class:`Search`.

    Speeds are means over the period before, integrals 0.
    """
    count, drives = len(problem.drives), problem.spec.drives
    states = np.zeros((len(angles), problem.spec.parts * count))
    states[:, :count] = angles
    if problem.spec.parts > 1:
        before = np.roll(angles, 1, axis=0)
        if problem.start is not None:
            before[0] = np.resize(problem.start, count)
        states[:, count : 2 * count] = drives[:, COASTING] / drives[:, HOLD] * (angles - before)
    active = np.zeros((2, *requests.shape), dtype=np.int64)
    return Search(
        np.array(requests, order="C"),
        states,
        np.zeros_like(states),
        active,
        np.zeros(1),
        work_of(problem.spec, smoothing=smoothing),
    )


def first_request_freed(
    problem: Problem, requests: Array, solver: Solver
) -> tuple[Problem, Array, Motion | None]:
    """The problem from rest with the first request that serves best, and the plan for it.

    Where the given plan is kept although another is better, the motion of the better one comes
    third. Anywhere within the dead band the first request holds the joint at the start, and until
    it has left the window it draws on a joint that moves. Another one than the middle is taken only
    for a gain that a robot would show: half of 40 random motions with dead bands of 0.2 to 3
    degrees gain a quarter or more. Of a long path the beginning is searched first.
    """
    (model,), middle = problem.drives, problem.first_requests
    assert middle is not None, "from rest a first request holds the joint"
    within = 1.0 - 1e-9  # rounding must not move the joint
    firsts = [middle + edge * model.dead_band for edge in (-within, within)]
    # After a few times that in which a joint settles the first request has no effect.
    count = math.ceil(20.0 * (problem.acting.oldest + problem.settling))
    if len(problem.desired) > 2 * count:
        load = None if problem.load is None else problem.load[:count]
        beginning = replace(problem, desired=problem.desired[:count], load=load)
        beginning, _, _ = first_request_freed(beginning, best_requests(beginning, solver), solver)
        if beginning.first is None:
            return problem, requests, None
        firsts = [beginning.first]
    own, answers = judged(problem, requests), []
    for first in firsts:
        freed = replace(problem, first=first)
        answers.append((judged(freed, best_requests(freed, solver)), freed))
    best, freed = min(answers, key=lambda answer: answer[0].error)
    if own.error == math.inf or best.error >= own.error:
        return problem, requests, None
    if allowed(problem, own, best):
        return problem, requests, best
    return freed, best.requests, None


def nearer(problem: Problem, requests: Array, executed: Array) -> Array:
    """Requests near executed ones, where the best ones are far away and hardly better.

    A saturated joint has very different requests of about the same error by its model. (10) has the
    distances from the executed ones in place of those from R*: a proximal point step.
    """
    start, best = problem.admissible(executed), problem.exact_error(requests)
    angles = problem.exact_angles(start)
    if math.inf in (best, problem.errors_of_models(angles)[0]):
        return requests
    nearby = replace(problem, near=start)
    answer = smoothed(nearby, minimise(nearby, start, angles, NEAR)[0])
    # At 1.05 four of nine series of trials of servos with an integral term go astray. Near the
    # executed requests squared second differences may be a hundred times those of the best ones for
    # a joint far beyond its top speed; for six servos within their speeds they are 2.1 times.
    worse = problem.exact_error(answer) > 1.25 * best
    rougher = problem.roughness(answer) > 3.0 * problem.roughness(requests)
    return requests if worse or rougher else answer


def solve_foot(task: Task, executed: Array | None = None) -> tuple[Array, Array | None]:
    """The requests for all joints of a leg, as :func:`solve`, from plans for them one by one."""
    problem, singly = problem_of(task), []
    for j in range(len(task.names)):
        nearest = np.ascontiguousarray(problem.desired[:, j : j + 1])
        alone = replace(
            task.joint(j).unsmoothed,
            models=((task.nominal[j],),),
            desired=nearest,
            norm="rms",
            start=None if task.cyclic else nearest[0],
            disturbance=None,
        )
        singly.append(solve_joint(alone)[0])
    first = problem.admissible(np.hstack(singly))
    angles = problem.exact_angles(first)
    if math.isnan(angles[0, 0]):
        angles = problem.desired
    best = minimise(problem, first, angles, FOOT)
    if problem.norm == "max":
        other = minimise(problem, first, angles, FOOT, through_rms=True)
        best = min(best, other, key=itemgetter(1))
    requests, least = best
    LOGGER.debug("foot: best cost %.4g", least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion of the foot", "no requests lead to a steady cycle")
    motion = judged(problem, requests)
    problem, requests = with_stationary_joints(problem, motion)
    requests = smoothed(problem, requests, best=motion)
    if executed is not None:
        requests = nearer(problem, requests, executed)
    return for_all_models(task, problem, requests, FOOT)


STATIONARY = 1e-9
"""Range of angles, or of requests, of a joint that does not move [rad]: rounding."""


def with_stationary_joints(problem: Problem, best: Motion) -> tuple[Problem, Array]:
    """The problem with joints held that are stationary along the path, and the plan for it.

    They may move to compensate for errors of other joints by more than the smoothing allows.
    """
    stationary: Mask = np.ptp(problem.resting, axis=0) <= STATIONARY
    if not np.any(stationary) or np.all(stationary):
        return problem, best.requests
    fixed = holding(problem, stationary, problem.resting[0])
    sharp = [stage for stage in FOOT if stage.radius < SIMULATED]
    answer, error = minimise(fixed, fixed.admissible(best.requests), best.angles, sharp)
    as_good = error <= best.error + 1e-13  # rounding [m]
    if as_good or allowed(problem, judged(problem, answer), best):
        return fixed, answer
    return problem, best.requests


def holding(problem: Problem, held: Mask, place: Array) -> Problem:
    """The same problem with some requests held at a place [rad]; both of (n, J), or broadcast."""
    lower, upper = (np.where(held, place, limit) for limit in (problem.lower, problem.upper))
    return replace(problem, lower=lower, upper=upper)


def for_all_models(
    task: Task, nominal: Problem, requests: Array, search: Sequence[Stage]
) -> tuple[Array, Array | None]:
    """The requests for all models of a task, as :func:`solve`, from those for the nominal ones.

    With even weights the cost is the mean over the scenarios. For the worst one weights follow the
    errors until these are even (C. L. Lawson's algorithm, as in J. R. Rice, K. H. Usow,
    *Mathematics of Computation* 22, 1968). Without dead bands the answer's error over all scenarios
    is no larger than that of the plan for the nominal ones, (n, J).
    """
    scenarios = task.scenarios
    if len(scenarios) == 1:
        return requests, None
    small = [stage for stage in search if stage.radius <= 0.2]  # the nominal plan is near
    # Requests that switch between the top speeds, or cross dead bands of different widths, depend
    # less on a joint's gain. On an underdamped servo with friction errors over the models are up to
    # 3 % smaller with a tenth of this, for up to 1.4 times the travel, up to 10 % larger with ten
    # times of it. Of a foot squared second differences are a quarter of those with the same weight,
    # errors 0.3 to 1.2 % larger.
    of_foot = nominal.goal == "foot" and nominal.smoothness > 0.0
    weight = 0.1 if of_foot else 1e-2
    stages = [stage._replace(weight=weight, smoothing=True) for stage in small]
    problem = replace(
        nominal,
        models=task.models,
        robust=task.robust,
        first=nominal.first_requests,
        shares=(1.0 / len(scenarios),) * len(scenarios),
    )
    angles = problem.exact_angles(requests)
    before = problem.errors_of_models(angles)[0]
    if before == math.inf:
        angles = np.tile(nominal.desired, len(scenarios))
    best, least = minimise(problem, requests, angles, stages)
    latest, answer = best, problem
    for _ in range(6 if problem.robust == "worst" else 0):  # five: up to 1 % more, eight: as good
        angles = problem.exact_angles(latest)
        weights = problem.shares * problem.errors_of_models(angles)[1][:-1]
        if not 0.0 < np.sum(weights) < math.inf:
            break
        problem = replace(problem, shares=tuple((weights / np.sum(weights)).tolist()))
        latest, error = minimise(problem, latest, angles, stages[-3:])
        if error < least:
            best, least, answer = latest, error, problem
    if not math.isfinite(least):
        raise SolverFailed(
            "optimised inversion", "no requests lead to a steady cycle of all models"
        )
    return smoothed(answer, best, at_most=before), requests


class Motion(NamedTuple):
    """Requests, the motion of the exact models, and its errors in the problem's unit."""

    requests: Array  # requests [rad], (n, J)
    angles: Array  # angles [rad], (n, A); NaN where a joint has no steady cycle
    error: float  # in the norm that counts; inf without a steady cycle
    mean: float  # root mean square, whichever norm counts
    model_error: float  # known error of the models, rms: at least an encoder's step
    unseen: float  # error that an encoder's step of each joint makes, rms
    # error allowed in any case: ``unseen`` for a foot and with dry friction, as many requests then
    # lead to nearly the same motion; else 0
    negligible: float

    @property
    def shown(self) -> float:
        """The error that a robot would show, of (12b): that of the plan and of its models."""
        return math.hypot(self.error, self.model_error)


def judged(problem: Problem, requests: Array, angles: Array | None = None) -> Motion:
    """Requests and their motion, by default simulated, with its errors."""
    angles = problem.exact_angles(requests) if angles is None else angles
    if math.isnan(angles[0, 0]):
        return Motion(requests, angles, *(math.inf,) * 5)
    weights = np.asarray(problem.shares)
    shares = np.repeat(weights, len(problem.names))  # mean squared error for a radian of each model
    if problem.goal == "foot":
        jacobians = problem.errors(angles)[1]
        shares *= np.einsum("kcij,kcij->cj", jacobians, jacobians).ravel() / len(angles)
    models = problem.nominal * len(weights)  # drawn models were not tested
    known = known_errors(models, angles, cyclic=problem.cyclic)
    model_error = math.sqrt(float(shares @ known**2))
    unseen = ENCODER_STEP * math.sqrt(float(np.sum(shares)))
    error, errors = problem.errors_of_models(angles)
    alike = problem.goal == "foot" or any(map(attrgetter("dead_band"), problem.drives))
    negligible = unseen if alike else 0.0
    return Motion(requests, angles, error, float(errors[-1]), model_error, unseen, negligible)


def known_errors(models: Sequence[JointModel], angles: Array, *, cyclic: bool) -> Array:
    """Known errors of the models in a motion (n, A) [rad], (A,), at least an encoder's step."""
    errors = np.full(len(models), ENCODER_STEP)
    for j, model in enumerate(models):
        if model.evidence is not None and not math.isnan(model.evidence.error):
            known = model.evidence.error_of(angles[:, j], period=model.period, cyclic=cyclic)
            errors[j] = max(known, ENCODER_STEP)
    return errors


def allowed(problem: Problem, motion: Motion, best: Motion) -> bool:
    """Whether a motion is allowed beside the best one, by (12b) of ``docs/math.md``.

    With a smoothness of 0 no rise of the error is.
    """
    if problem.smoothness == 0.0:
        return motion.error <= best.error
    rise = motion.shown <= (1.0 + problem.smoothness) * best.shown
    return rise or motion.error <= best.negligible


class Allowance(NamedTuple):
    """How large the errors of smoother requests may be."""

    shown: float = math.inf  # largest error that a robot may show
    growth: float = math.inf  # largest ratio of it to the least shown error so far
    heaviest: float = math.inf  # largest weight on the second differences beside the errors
    at_most: float = math.inf  # largest error
    mean: float = math.inf  # where the largest error counts, also the largest root mean square

    def error(self, motion: Motion) -> float:
        """The allowed error of such a motion."""
        return min(math.sqrt(max(self.shown**2 - motion.model_error**2, 0.0)), self.at_most)

    def share_used(self, motion: Motion, error: float) -> float:
        """Share of the allowed rise of an error that a motion uses; inf where it exceeds limits."""
        room = self.error(motion) - error
        if motion.mean > self.mean or room <= 0.0:
            return math.inf
        return (motion.error - error) / room


def smoothed(
    problem: Problem,  # the goal, and the limits
    requests: Array,  # a good plan [rad], shape (n, J)
    *,
    best: Motion | None = None,  # the best plan, if it is another one
    others: Iterable[Array] = (),  # requests [rad], (n, J), to start from too, if they are allowed
    at_most: float = math.inf,  # upper limit of the error in any case
) -> Array:
    """Smoother requests whose shown error is within the limits of :func:`allowed`.

    Where requests would shake a joint, an error up to an encoder's step is allowed as well. With a
    smoothness of 0 the answer is ``requests``.
    """
    smoothness = problem.smoothness
    if smoothness == 0.0 or (given := judged(problem, requests)).error == math.inf:
        return requests
    best = best or given
    motions = map(partial(judged, problem), others)
    starts = [given, *filter(partial(allowed, problem, best=best), motions)]
    mean = math.inf
    if problem.norm == "max":
        # Without this limit a joint could rest if it must miss one sample anyway. With a twentieth
        # of it requests of the reference walk are two to four times as rough.
        mean = (1.0 + 20.0 * smoothness) * math.hypot(given.mean, given.model_error)
        mean = max(math.sqrt(max(mean**2 - given.model_error**2, 0.0)), best.negligible)
    relative = Allowance(
        shown=(1.0 + smoothness) * best.shown, growth=1.0 + smoothness, at_most=at_most, mean=mean
    )
    absolute = Allowance(
        heaviest=50.0 * smoothness,  # requests that are smooth already are not flattened
        at_most=min(best.unseen, at_most),
        mean=max(mean, best.unseen),
    )
    smoothed_within = partial(smoothest, problem, error=given.error)
    answers = list(map(partial(smoothed_within, allowance=relative), starts))
    allowance = absolute
    if not any(map(partial(shakes, problem), answers)):
        allowance = absolute._replace(at_most=min(best.negligible, at_most), mean=mean)
    answers += map(partial(smoothed_within, allowance=allowance), starts)
    answer = min(answers, key=problem.roughness)
    return resting_at_rests(problem, answer, given.error, (relative, absolute))


RADII = *(0.04,) * 2, *(0.015,) * 16
"""Radius of the corners in each step of the smoothing [theta_0]."""

KEPT = 0.0, 0.1, 1.0
"""Where the largest error counts: shares of the smoothing's weight with which the squares of all
errors are part of the cost, so that those below the largest do not drift; the smoothest requests
of the three are taken. Over 21 plans with 0 alone squared second differences are four times as
large in the mean, with it and one of the others a fifth or more larger."""


def smoothest(problem: Problem, start: Motion, error: float, allowance: Allowance) -> Array:
    """The smoothest requests found whose errors are within the allowance: see :func:`smoother`."""
    kept = KEPT if problem.norm == "max" else KEPT[:1]
    each = map(partial(smoother, problem, start, error, allowance), kept)
    return min(each, key=problem.roughness)


def smoother(
    problem: Problem, start: Motion, error: float, allowance: Allowance, kept: float
) -> Array:
    """Smoother requests whose errors are within the allowance.

    Steps minimise ``J + w |D2 R|^2`` with sharp corners, J the cost of the errors and D2 the second
    differences of the requests. Each takes ``w = c (J_allowed - J) / |D2 R|^2`` anew, with a factor
    c that grows while the exact error is allowed. ``error`` is that of the best plan. Where the
    largest error counts, J has the sum of squares as well, so weighted that with ``kept`` = 1 the
    smoothing costs about as much of it as the root mean square may rise. Half and twice each number
    of the loop change the sum of squared second differences by at most 11 % in the mean of 86.
    """
    power = LARGEST[-1].power if problem.norm == "max" else 2.0
    best, least, straight = start.requests, problem.roughness(start.requests), 1e-24  # [rad^2]
    most, factor, motion, squares = allowance.error(start), 1.0, start, 0.0
    if least <= straight or most <= error:
        return best
    search = search_from(problem, start.requests, start.angles, smoothing=True)
    now, cost = least, 0.0
    varying = problem.goal == "foot"
    for model in problem.nominal:
        varying |= model.evidence is not None and model.evidence.depends_on_motion
    if power != 2.0 and error:  # the sum of the powers at the start, in units of the error
        shares = np.minimum(problem.distances(start.angles) / error, LARGEST_SHARE)
        cost = float(np.sum(shares**power))
    for radius in RADII:
        before, share = now, min(most / error, LARGEST_SHARE) if error else 1.0
        rise = len(best) * (most**2 - error**2)  # of the cost, if all errors grow in proportion
        if power != 2.0:
            rise = error**2 * cost * (share**power - 1.0)
        if before <= straight or rise <= 0.0 or most <= error:
            break
        weight = min(factor * rise / before, allowance.heaviest * share ** (power - 2.0))
        if power != 2.0:
            room = max(allowance.mean**2 - motion.mean**2, 0.02 * allowance.mean**2)
            squares = kept * weight * before / (len(best) * room)
        stages = np.array([Stage(radius, weight, power, 1, smoothing=True, squares=squares)])
        (requests,), (reached,), figures = go_through(problem.spec, search, stages)
        ((reached_error, mean, now),) = figures.tolist()
        motion = start._replace(error=reached_error, mean=mean)
        if varying:
            motion = judged(problem, requests, reached)
        used = allowance.share_used(motion, error)
        if used <= 1.0:
            if now < least:
                best, least = requests, now
            allowance = allowance._replace(
                shown=min(allowance.shown, allowance.growth * motion.shown)
            )
            most, used = allowance.error(motion), allowance.share_used(motion, error)
            if used > 0.9 and now > 0.5 * before:
                break
            factor *= max(used, 1.0 / 9.0) ** -0.5
        else:
            factor *= max(0.9 / used, 0.5) * now / before
        if 0.5 < used <= 1.0 and abs(now / before - 1.0) < 0.1:
            break
    if LOGGER.isEnabledFor(logging.DEBUG):
        LOGGER.debug("smoothing: second differences %.4g deg", math.degrees(math.sqrt(least)))
    return best


SHAKING = 8.0
"""Least excess of changes of direction over the path's with which requests shake a joint [1/s]. Of
20 smooth paths that joints can follow one has such requests, of four paths of legs with kinks all.
"""


def resting_at_rests(
    problem: Problem, requests: Array, error: float, allowances: Sequence[Allowance]
) -> Array:
    """Requests that rest where the path does, if the given ones shake there and errors allow it.

    Around a motion they stay free for the time in which joints settle, or twice as long, and so on.
    """
    margin = math.ceil(problem.settling)
    while margin <= len(requests):
        resting = shaking_rests(problem, requests, margin)
        if resting is None:
            break
        # Of 155 paths with rests, at 1.2 requests of 32 shake, at 2 those of 23; without a limit
        # they step up to three times as far beside some rests.
        most = 2.0 * problem.roughness(requests)
        held = holding(problem, resting[:, np.newaxis], problem.resting)
        angles = problem.exact_angles(requests)
        best, _ = minimise(held, held.admissible(requests), angles, SHARP)
        start, answers = judged(problem, best), []
        for allowance in allowances:
            if allowance.share_used(start, error) <= 1.0:
                answer = problem.admissible(smoothest(held, start, error, allowance))
                kept = allowance.share_used(judged(problem, answer), error) <= 1.0
                if kept and problem.roughness(answer) <= most:
                    answers.append(answer)
        if answers:
            calm = (each for each in answers if not shakes(problem, each))
            return next(calm, min(answers, key=problem.roughness))
        margin *= 2
    return requests


def shaking_rests(problem: Problem, requests: Array, margin: int) -> Mask | None:
    """The requests that act only where the path rests, (n,), with a margin [samples] both ways.

    None if they change direction little.
    """
    desired, count = problem.desired, len(problem.desired)
    before = np.roll(desired, 1, axis=0)
    if problem.start is not None:
        before[0] = problem.start
    moving = np.any(np.abs(desired - before) > STATIONARY, axis=1)
    if np.all(moving):
        return None
    first, last = problem.acting.youngest - margin, problem.acting.oldest + margin
    reach = max(abs(first), last)
    padded = np.pad(moving, reach, mode="wrap" if problem.cyclic else "constant")
    moved = np.concatenate([[0], np.cumsum(padded)])
    samples = np.arange(reach, reach + count)
    resting: Mask = moved[samples + last + 1] == moved[samples + first]
    rows = np.flatnonzero(resting)
    if not len(rows):
        return None
    rests = np.split(requests[rows], np.flatnonzero(np.diff(rows) > 1) + 1)
    turns = [[reversals(column, cyclic=False) for column in each.T] for each in rests]
    most = int(np.max(np.sum(turns, axis=0))) - 1
    return resting if most > SHAKING * len(rows) * problem.period else None


def shakes(problem: Problem, requests: Array) -> bool:
    """Whether requests of a joint, (n, 1), change direction much more often than its path does."""
    turns = reversals(requests[:, 0], cyclic=problem.cyclic)
    turns -= reversals(problem.desired[:, 0], cyclic=problem.cyclic)
    return turns > SHAKING * len(requests) * problem.period
