"""The optimised inversion: direct optimal control over the requests, on the full model."""

from __future__ import annotations

import logging
import math
from operator import itemgetter

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import PiecewiseLinear
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
from planner.inversion.closed_form import requests_along, switching_time
from planner.inversion.direct_transcription import transcribed_requests
from planner.inversion.gauss_newton import OPTIONS, State, minimise
from planner.inversion.line_inverse import interpolated_offset
from planner.inversion.result import Inversion
from planner.inversion.smoothing import smoothed
from planner.inversion.tracking_problem import TrackingProblem, in_reach, track
from planner.model.joint import JointModel, checked_model
from planner.model.response import checked_start
from planner.trajectory import Array, as_trajectory

FAR_FROM_IDEAL = 1.03
"""Error over that of the ideal from which on further searches are worth their time, where the first
is known to mislead."""

FARTHER = 1.25
"""Error over that of the ideal from which on a wide search is worth its time for every joint: below
it found half a percent or more in 9 of 700 random instances, beyond it up to 14 %."""

WORTH_UNREST = 2e-3
"""Relative gain from which on the wide search's answer is taken, whose requests are less quiet."""

NEGLIGIBLE = 5e-4
"""Error up to which another search is not worth its time [theta_0]."""


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

    From rest the joint rests at ``start`` until the plan begins: the first request holds it there.

    Args:
        model: The joint.
        desired: Wanted angles [rad], shape (n,), one every ``model.period``.
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
        InvalidInput: The norm is none, the limits are no pair, or ``start`` does not fit.
        Infeasible: The limits exclude each other, the start or a desired angle.
        SolverFailed: No requests were found under which the joint finds a cycle, or CasADi's
            solver stopped without an answer.
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
    begin = _begin(problem, desired)
    if solver == "gauss-newton":
        column = search(problem, desired, begin)
    else:
        column = transcribed_requests(problem, desired, begin, solver=solver)
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


def _begin(problem: TrackingProblem, desired: Array) -> State:
    """Where every solver begins: the ideal, the best trajectory within ±v_max, and its closed form.

    Every sample of the ideal is a line of its own.
    """
    (model,) = problem.models
    start = None if problem.start is None else float(problem.start[0])
    slopes = model.v_max * model.period
    ideal = in_reach(model, slope_bounded(desired, slopes, cyclic=problem.cyclic), start)
    lines = _line_per_sample(model, ideal, cyclic=problem.cyclic)
    return State(problem.admissible(lines), ideal[:, np.newaxis])


def search(problem: TrackingProblem, desired: Array, begin: State) -> Array:
    """The best requests found for one joint, (n, 1).

    The search sets out from the ideal and its closed form. If the plan stays far from the ideal, a
    wide search sets out too. For short cycles and joints that overshoot, where derivatives tell
    little, further ones set out from the desired angles and from those as early as the joint is
    late.
    """
    (model,) = problem.models
    wanted = begin.angles
    at_most = problem.exact_error(begin.requests)
    answers = [(begin, at_most), minimise(problem, begin)]
    of_ideal, negligible = problem.error(wanted), NEGLIGIBLE * model.theta_0
    if answers[-1][1] > FARTHER * of_ideal + negligible:
        wide = minimise(problem, begin, OPTIONS.wide)
        if wide[1] < (1.0 - WORTH_UNREST) * answers[-1][1]:
            answers.append(wide)
    short = len(desired) <= 2 * problem.reach.oldest
    overshooting = model.v_max_per_tick > model.theta_0
    least = min(error for _, error in answers)
    if least > FAR_FROM_IDEAL * of_ideal + negligible and (short or overshooting):
        others = _further_starts(problem)
        answers += [minimise(problem, State(other, wanted)) for other in others]
    best, least = min(answers, key=itemgetter(1))
    logging.getLogger(__name__).debug("joint: %d searches, best %.4g rad", len(answers), least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion", "no requests lead to a steady cycle")
    return smoothed(problem, best.requests, at_most=at_most, seam=best.angles[-1])


def _line_per_sample(model: JointModel, angles: Array, *, cyclic: bool) -> Array:
    """The closed form of a trajectory whose every sample is a knot: requests (n, 1) [rad]."""
    lines = PiecewiseLinear(
        knots=np.arange(len(angles), dtype=np.float64),
        values=angles,
        samples=len(angles),
        tick=model.period,
        cyclic=cyclic,
    )
    requests = requests_along(model, lines, rule="exact", offset_of=interpolated_offset)
    return requests[:, np.newaxis]


def _further_starts(problem: TrackingProblem) -> list[Array]:
    """The desired angles, and those as early as the joint is late: requests (n, 1) [rad]."""
    (model,) = problem.models
    early = problem.admissible(_earlier(problem, switching_time(model) / model.period))
    return [problem.resting, early]


def _earlier(problem: TrackingProblem, samples: float) -> Array:
    """The requests that would hold the desired angles, so many samples early [rad], (n, 1)."""
    later = np.arange(len(problem.resting)) + round(samples)
    count = len(problem.resting)
    shifted: Array = problem.resting[
        later % count if problem.cyclic else np.minimum(later, count - 1)
    ]
    return shifted
