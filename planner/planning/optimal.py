"""The optimised inversion: direct optimal control over the requests, on the full model."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from planner.approximation.ideal import slope_bounded
from planner.exceptions import SolverFailed, angle_text
from planner.model.joint import JointModel, request_ages
from planner.model.load import checked_load, felt
from planner.model.response import checked_start
from planner.planning.arguments import (
    Norm,
    Solver,
    check_norm,
    check_solver,
    check_within,
    checked_limits,
    checked_max_step,
    checked_smoothness,
    checked_tolerance,
)
from planner.planning.closed_form import SAME_TIME, best_closed_form, switching_time
from planner.planning.direct_transcription import transcribed_requests
from planner.planning.gauss_newton import OPTIONS as SEARCH
from planner.planning.gauss_newton import State, minimise
from planner.planning.line_inverse import interpolated_offset
from planner.planning.result import Inversion
from planner.planning.reversals import LEAST_REVERSAL, without_small_reversals
from planner.planning.robust import (
    ModelOrModels,
    Robust,
    checked_models,
    robust_requests,
)
from planner.planning.smoothing import allowed_beside, smoothed
from planner.planning.tracking_problem import TrackingProblem, track
from planner.trajectory import Array, as_trajectory, check_radians


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


@np.errstate(under="ignore")  # too small to matter, whatever the caller has set
def invert_optimal(
    model: ModelOrModels,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: tuple[float, float] | None = None,
    norm: Norm = "rms",
    start: float | None = None,
    tolerance: float | None = None,
    solver: Solver = "gauss-newton",
    load: npt.ArrayLike | None = None,
    max_step: float | None = None,
    smoothness: float | None = None,
    robust: Robust | None = None,
) -> Inversion:
    """Requests of least tracking error, by a local search over requests and angles.

    Angles and requests are the unknowns. Damped Gauss-Newton steps, each at a cost in proportion to
    the length, lower the error on a saturation whose rounded corners are sharpened stage by stage,
    from the best trajectory within ±v_max and its closed form onwards. The exact model, run, judges
    the last stages, and the best requests are kept, so that they are never worse than that form
    before they are smoothed. Where next to no sample can be reached below the top speeds, the
    search also starts from the answers of :func:`planner.invert_closed_form`.

    At the end requests are smoothed: their sum of squared second differences is lowered as far as
    ``smoothness`` allows (``docs/math.md``, section 6). With 0 the error was at most that of
    :func:`planner.invert_closed_form` on every joint that was tried; by default it may be above it
    by what the smoothing allows.

    From rest the joint rests at ``start`` until the plan begins: the first request holds it there.

    Args:
        model: The joint. Or several models that it may have, the nominal one first, or the answer
            of :func:`planner.identify`, from whose intervals eight are drawn beside its own, always
            the same ones: the requests are then good for all of them. With a sequence of one the
            joint has that model in any case.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        limits: Smallest and largest request allowed [rad]; -inf and inf where there is none.
        norm: "rms" to minimise the root mean square of the errors, "max" the largest one.
        start: From rest: where the joint rests before [rad]; by default at the first desired angle.
        tolerance: Error that the plan should keep [rad]; the plan says whether it does.
        solver: "gauss-newton", the search above; "ipopt" for the same problem as a nonlinear
            programme, through CasADi (``docs/math.md``, section 6), judged as exactly.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape (n,);
            entry k acts in the request period that ends in sample k.
        max_step: Largest change from one request to the next [rad], in a cycle also from the last
            to the first, from rest also from the request that holds the start. Each is kept
            exactly.
        smoothness: Relative rise of the error that smoother requests may cost; by default 0.005, 0
            for none. It is the error that a robot would show, to which the error of the model adds
            in quadrature: that known of an identified one, and at least an encoder's step of 0.088
            degrees. With dry friction an error up to that step is allowed in any case.
        robust: "mean" to minimise the root mean square of the errors of several models, the default
            for them, "worst" for the largest of them. With a model by itself eight others are
            drawn from the intervals that its file has.

    Returns:
        The plan; its bound and gap say how much better any other could be. The bound does not know
        of ``limits`` and ``max_step``: it holds with them, but the gap then includes their cost.
        Error, bound and gap are those of the nominal model, ``errors_of_models`` has all errors,
        ``nominal`` the plan for the nominal model alone.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 3.
        InvalidInput: The norm or the solver is unknown, the limits are not two numbers, a cycle is
            given a ``start``, the load does not fit the samples or the joint, ``max_step`` is not
            above 0, ``smoothness`` below it, or a model without intervals, or one in any
            case, is to be planned for robustly.
        Infeasible: The limits exclude each other, the start or a desired angle.
        SolverFailed: No requests were found that lead to a steady cycle, or IPOPT stopped without
            an answer.

    Example:
        >>> import numpy as np
        >>> desired = 1.2 * np.sin(2 * np.pi * np.arange(88) / 88) ** 3  # [rad], every 8 ms
        >>> made = invert_optimal(JointModel.ers210a(), desired, limits=(-1.5, 1.5))
        >>> f"{np.degrees(made.rms):.1f} deg rms, {np.degrees(made.lower_bound):.1f} at best"
        '10.4 deg rms, 10.2 at best'
    """
    models = checked_models(model, robust)
    model = models[0]
    check_norm(norm)
    check_solver(solver)
    tolerance = checked_tolerance(tolerance)
    desired = as_trajectory(desired, name="desired", minimum=3)
    check_radians(desired, name="desired")
    start = checked_start(start, cyclic=cyclic)
    loads = [checked_load(load, each, len(desired)) for each in models]
    torques = loads[0]
    if not cyclic and start is None:
        start = float(desired[0])
    checked = None if limits is None else checked_limits(limits)
    step = checked_max_step(max_step)
    share = checked_smoothness(smoothness)
    if checked is not None:
        check_within(checked, desired=desired, start=start, model=model, load=torques)
    follow: Callable[..., TrackingProblem] = partial(
        track,
        model,
        cyclic=cyclic,
        norm=norm,
        limits=checked,
        max_step=step,
        start=start,
        load=torques,
    )
    problem = follow(desired)
    column = _best_requests(problem, solver)
    if start is not None and model.dead_band and len(models) == 1:
        follow, problem, column = _first_request_freed(follow, problem, column, solver, share)
    others = []
    if model.dead_band and share:
        least = LEAST_REVERSAL * model.dead_band
        filtered = without_small_reversals(desired, least, cyclic=cyclic)
        others = [_best_requests(follow(filtered), solver)]
    column = smoothed(problem, column, smoothness=share, others=others)
    alone = Inversion(
        model=model,
        desired=desired,
        requests=_only(column),
        method="optimal",
        solver=solver,
        cyclic=cyclic,
        norm=norm,
        limits=checked,
        start=start,
        max_step=None if math.isinf(step) else step,
        smoothness=share,
        tolerance=tolerance,
        load=felt(loads),
    )
    if len(models) == 1:
        return alone
    robust = robust or "mean"
    column = robust_requests(
        problem,
        tuple((each,) for each in models),
        [(each,) for each in loads],
        column,
        robust=robust,
        smoothness=share,
    )
    return replace(
        alone,
        requests=_only(column),
        models=models,
        robust=robust,
        nominal=replace(alone, models=models),
    )


def _only(column: Array) -> Array:
    """The requests of one joint, (n,), from those of shape (n, 1)."""
    requests: Array = column[:, 0].copy()
    requests.setflags(write=False)
    return requests


def _first_request_freed(
    follow: Callable[..., TrackingProblem],
    problem: TrackingProblem,
    column: Array,
    solver: Solver,
    smoothness: float,
) -> tuple[Callable[..., TrackingProblem], TrackingProblem, Array]:
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
        requests = _best_requests(other, solver)
        answers.append((other.exact_error(requests), held, other, requests))
    error, held, other, requests = min(answers, key=itemgetter(0))
    angles, best = problem.exact_angles(column), other.exact_angles(requests)
    if angles is None or best is None or error >= problem.error(angles):
        return follow, problem, column
    if allowed_beside(problem, best, smoothness=smoothness).by(problem, angles):
        return follow, problem, column
    return held, other, requests


def _best_requests(problem: TrackingProblem, solver: Solver) -> Array:
    """Requests of least error by a solver [rad], (n, 1)."""
    guess = initial_guess(problem)
    if solver == "gauss-newton":
        return search(problem, guess)
    return transcribed_requests(problem, guess)


def search(problem: TrackingProblem, state: State) -> Array:
    """The best requests found for one joint, (n, 1).

    A joint that is at top speed nearly throughout, or whose acceleration is limited, may follow
    fitted lines better than anything that the search finds: it starts from these as well. Where
    next to no error need be left, high powers of it lead nowhere, and the plan for the root mean
    square leaves the smaller largest error. If the plan stays far from the ideal, a search with
    wide corners follows. For short cycles and joints that overshoot, where derivatives say little,
    further ones start from the desired angles and from those as early as the joint is late.
    """
    (model,) = problem.models
    starts, narrow, wide = [state], SEARCH.narrow, SEARCH.wide
    limited = math.isfinite(model.max_acceleration)  # of which the ideal does not know
    if limited or below_top_speed(problem, state.angles) <= OPTIONS.compared:
        starts.append(state._replace(requests=best_closed_form(problem)))
    best = min((minimise(problem, start, narrow) for start in starts), key=itemgetter(1))
    near = OPTIONS.far * problem.error(state.angles)
    if problem.norm == "max" and best[1] > near:
        found, _ = minimise(problem.with_norm("rms"), state, narrow)
        best = min(best, (found, problem.exact_error(found.requests)), key=itemgetter(1))
    if best[1] > near + OPTIONS.negligible * model.theta_0:
        short = len(problem.desired) <= 2 * problem.ages.oldest
        if short or model.v_max_per_tick > model.theta_0:
            further = [state._replace(requests=requests) for requests in _early_and_late(problem)]
            answers = [minimise(problem, start, narrow) for start in further]
            best = min(best, *answers, key=itemgetter(1))
            starts += further
        other = min((minimise(problem, start, wide) for start in starts), key=itemgetter(1))
        if other[1] < (1.0 - OPTIONS.gain) * best[1]:
            best = other
    answer, least = best
    logging.getLogger(__name__).debug(
        "joint: best of the searches from %d start(s) %s", len(starts), angle_text(least)
    )
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion", "no requests lead to a steady cycle")
    return answer.requests


def initial_guess(problem: TrackingProblem) -> State:
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


def below_top_speed(problem: TrackingProblem, ideal: Array) -> int:
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


def _early_and_late(problem: TrackingProblem) -> list[Array]:
    """The desired angles as requests, l + a/2 early and as they are [rad], (n, 1)."""
    (model,) = problem.models
    count = len(problem.resting)
    later = np.arange(count) + round(switching_time(model) / model.period)
    later = later % count if problem.cyclic else np.minimum(later, count - 1)
    return [problem.admissible(problem.resting[later]), problem.resting]
