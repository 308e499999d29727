"""The optimised inversion: direct optimal control over the requests, on the full model."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from planner.approximation.slope_projection import slope_bounded
from planner.exceptions import SolverFailed
from planner.inversion.arguments import (
    Norm,
    Solver,
    check_norm,
    check_solver,
    check_within,
    checked_limits,
    checked_tolerance,
)
from planner.inversion.closed_form import SAME_TIME, best_closed_form, switching_time
from planner.inversion.direct_transcription import transcribed_requests
from planner.inversion.gauss_newton import OPTIONS as SEARCH
from planner.inversion.gauss_newton import State, minimise
from planner.inversion.line_inverse import interpolated_offset
from planner.inversion.result import Inversion
from planner.inversion.smoothing import smoothed
from planner.inversion.tracking_problem import TrackingProblem, track, within_attainable_range
from planner.model.joint import JointModel, checked_model
from planner.model.response import checked_start
from planner.trajectory import Array, as_trajectory


@dataclass(frozen=True, kw_only=True)
class FurtherSearchOptions:
    """When one search is not enough.

    Measured over 109 joints, half of them outside Equation 13, and 366 for ``compared``.

    Attributes:
        far: Error over that of the ideal from which on further searches are worth their time. At
            1.015 nothing is gained, at 1.06 up to 0.4 % lost.
        gain: Relative gain from which on the answer of a wide search is taken, whose requests
            change more. At half and twice no error changes by more than 0.01 %; without it Σ(ΔR)²
            is 3 % larger.
        negligible: Error up to which further searches are not worth their time [theta_0]. Half and
            twice matter only below 0.01 degrees.
        compared: Samples of a cycle shorter than twice the window up to which the closed forms are
            judged too. No longer one tracked better; each costs 0.1 s.
    """

    far: float = 1.03
    gain: float = 2e-3
    negligible: float = 5e-4
    compared: int = 12


OPTIONS = FurtherSearchOptions()


def invert_optimal(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: tuple[float, float] | None = None,
    norm: Norm = "rms",
    start: float | None = None,
    tolerance: float | None = None,
    solver: Solver = "gauss-newton",
) -> Inversion:
    """Requests that make the joint come as close to ``desired`` as the search can find.

    Angles and requests are the unknowns. Damped Gauss-Newton steps, each at a cost in proportion to
    the length, lower the error on a saturation whose rounded corners are sharpened stage by stage,
    from the best trajectory within ±v_max and its closed form onwards. The exact model, run, judges
    the last stages, and the best requests are kept, so the plan is never worse than that form.
    Cycles of a few samples are compared with :func:`planner.invert_closed_form` too.

    From rest the joint rests at ``start`` until the plan begins: the first request holds it there.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        limits: Smallest and largest request allowed [rad]; -inf and inf where there is none.
        norm: "rms" to minimise the root mean square of the errors, "max" the largest one.
        start: From rest: where the joint rests before [rad]; by default at the first desired angle.
        tolerance: Error that the plan should keep [rad]; the plan says whether it does.
        solver: "gauss-newton", the search above; "ipopt" or "fatrop", CasADi's, for the same
            problem as a nonlinear programme (``docs/math.md``, section 6), judged as exactly.

    Returns:
        The plan; its bound and gap say how much better any other could be.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 3.
        InvalidInput: The norm or the solver is unknown, the limits are not two numbers, or a cycle
            is given a ``start``.
        Infeasible: The limits exclude each other, the start or a desired angle.
        SolverFailed: No requests were found that lead to a steady cycle, or CasADi's solver
            stopped without an answer.
    """
    model = checked_model(model)
    check_norm(norm)
    check_solver(solver)
    tolerance = checked_tolerance(tolerance)
    desired = as_trajectory(desired, name="desired", minimum=3)
    start = checked_start(start, cyclic=cyclic)
    if not cyclic and start is None:
        start = float(desired[0])
    checked = None if limits is None else checked_limits(limits)
    if checked is not None:
        check_within(checked, desired=desired, start=start, model=model)
    problem = track(model, desired, cyclic=cyclic, norm=norm, limits=checked, start=start)
    guess = initial_guess(problem, desired)
    if solver == "gauss-newton":
        column = search(problem, desired, guess)
    else:
        column = transcribed_requests(problem, desired, guess, solver=solver)
    best = column[:, 0].copy()
    best.setflags(write=False)
    return Inversion(
        model=model,
        desired=desired,
        requests=best,
        method="optimal",
        solver=solver,
        cyclic=cyclic,
        norm=norm,
        limits=checked,
        start=start,
        tolerance=tolerance,
    )


def search(problem: TrackingProblem, desired: Array, guess: State) -> Array:
    """The best requests found for one joint, (n, 1).

    If the plan stays far from the ideal, a search with wide corners follows. For short cycles and
    joints that overshoot, where derivatives say little, further ones start from the desired angles
    and from those as early as the joint is late. A cycle of few samples may follow fitted lines
    better than anything that these find: its closed forms are judged as well. Where next to no
    error need be left, high powers of it lead nowhere, and the plan for the root mean square leaves
    the smaller largest error.
    """
    (model,) = problem.models
    starts, narrow, wide = [guess], SEARCH.narrow, SEARCH.wide
    answers = [(guess, problem.exact_error(guess.requests)), minimise(problem, guess, narrow)]
    near = OPTIONS.far * problem.error(guess.angles)
    if problem.norm == "max" and answers[-1][1] > near:
        found, _ = minimise(problem.with_norm("rms"), guess, narrow)
        answers.append((found, problem.exact_error(found.requests, found.angles[-1])))
    bar = near + OPTIONS.negligible * model.theta_0
    short = len(desired) <= 2 * problem.ages.oldest
    if answers[-1][1] > bar:
        if short or model.v_max_per_tick > model.theta_0:
            starts += [guess._replace(requests=requests) for requests in _early_and_late(problem)]
            answers += [minimise(problem, start, narrow) for start in starts[1:]]
        widely = min((minimise(problem, start, wide) for start in starts), key=itemgetter(1))
        if widely[1] < (1.0 - OPTIONS.gain) * min(error for _, error in answers):
            answers.append(widely)
    at_most = answers[0][1]
    if short and len(desired) <= OPTIONS.compared:
        lines = best_closed_form(problem, desired)
        at_most = min(at_most, problem.exact_error(lines))
        answers.append((guess._replace(requests=lines), problem.exact_error(lines)))
    best, least = min(answers, key=itemgetter(1))
    logging.getLogger(__name__).debug("joint: %d searches, best %.4g rad", len(answers), least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion", "no requests lead to a steady cycle")
    return smoothed(problem, best.requests, at_most=at_most, boundary=best.angles[-1])


def initial_guess(problem: TrackingProblem, desired: Array) -> State:
    """The ideal, the best trajectory within ±v_max (section 4), and its closed form.

    Every sample is a knot: request k is on the line from sample i = floor(k + l + a/2) on, raised
    by its C_m (section 3). From rest the ideal is brought to where the joint can be by then.
    """
    (model,) = problem.models
    count, cyclic = len(desired), problem.cyclic
    ideal = slope_bounded(desired, model.v_max * model.period, cyclic=cyclic)
    if problem.start is not None:
        ideal = within_attainable_range(model, ideal, float(problem.start[0]))
    steps = np.diff(ideal, append=ideal[:1]) if cyclic else np.diff(ideal)
    steps = np.clip(steps, -model.v_max * model.period, model.v_max * model.period)
    samples = np.arange(count)
    knots = samples + int(switching_time(model) / model.period + SAME_TIME)
    knots = knots if cyclic else np.minimum(knots, count - 2)
    steps = steps[knots % count]
    offsets = interpolated_offset(model, steps / model.period, rule="exact")
    requests = ideal[knots % count] + steps * (samples - knots) + offsets
    return State(problem.admissible(requests[:, np.newaxis]), ideal[:, np.newaxis])


def _early_and_late(problem: TrackingProblem) -> list[Array]:
    """The desired angles as requests, l + a/2 early and as they are [rad], (n, 1)."""
    (model,) = problem.models
    count = len(problem.resting)
    later = np.arange(count) + round(switching_time(model) / model.period)
    later = later % count if problem.cyclic else np.minimum(later, count - 1)
    return [problem.admissible(problem.resting[later]), problem.resting]
