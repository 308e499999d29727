"""How good could any requests be? Lower bounds on the tracking error (``docs/math.md``).

A lower bound is proved by multipliers: for every trajectory x with G x <= h and every lambda >= 0,
Hölder's inequality gives ``|x - d| >= lambda (G d - h) / |G' lambda|*``. The solver proposes the
multipliers and the inequality is evaluated here, so that a bound is valid whatever the solver did.
"""

from __future__ import annotations

import logging
from time import perf_counter
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, SolverFailed
from planner.given import is_one_of, shown
from planner.inversion.branching import searched_bound
from planner.inversion.exact import TIME_LIMIT, exact_bound
from planner.inversion.limits import positive
from planner.inversion.norm import Norm, check_norm
from planner.inversion.question import Question
from planner.inversion.reachable import Level, Reachable, check_level, reachable_set
from planner.model.joint import JointModel, checked_model
from planner.model.response import checked_start
from planner.trajectory import Array, as_trajectory

Proof = Literal["search", "scip"]
"""How the exact level is proved: by our own branch and bound, or by SCIP on condition 4 alone."""


class Certificate(NamedTuple):
    """A lower bound, and how it was come by.

    Attributes:
        bound: No requests go below this error [rad].
        norm: Which error.
        level: What was used of the joint.
        solver_gap: Relative distance between the bound and the best that is known of the same
            level, for "exact" the error of a plan; 0 where one set of multipliers proves the bound,
            inf where nothing is known.
        seconds: Time it took [s].
    """

    bound: float
    norm: Norm
    level: Level
    solver_gap: float
    seconds: float


def lower_bound(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    level: Level = "envelope",
    start: float | None = None,
    time_limit: float = TIME_LIMIT,
    proof: Proof = "search",
) -> float:
    """An error that no requests whatever can go below [rad]: see :func:`certify`."""
    return certify(
        model,
        desired,
        cyclic=cyclic,
        norm=norm,
        level=level,
        start=start,
        time_limit=time_limit,
        proof=proof,
    ).bound


def certify(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    level: Level = "envelope",
    start: float | None = None,
    time_limit: float = TIME_LIMIT,
    proof: Proof = "search",
) -> Certificate:
    """An error that no requests whatever can go below, with what is known about it.

    ``slope`` uses that the joint never moves faster than v_max; ``envelope`` also that its speed
    cannot change at once; ``exact`` follows every request through the window, and searches among
    all of them for any that are better than a plan (``docs/math.md``, section 5). Each is at least
    the one before, and costs more: one and a few milliseconds, and seconds to the time limit for a
    hundred samples.

    Args:
        model: The joint.
        desired: Wanted angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        norm: "rms" for the root mean square of the errors, "max" for the largest.
        level: "slope", "envelope" or "exact".
        start: From rest: angle at which the joint rests until the plan begins [rad]. Without it the
            bound holds for every start.
        time_limit: For "exact": when to stop with what is proved by then [s].
        proof: For "exact": "search", which comes closest, or "scip", an independent solver on a
            programme that holds less of the joint; it needs the extra ``exact``.

    Returns:
        The bound, at least 0.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 2.
        InvalidInput: The norm, level or proof has another name, or a cycle is given a start.
        MissingExtra: "scip" without SCIP.
        SolverFailed: The solver proposed no multipliers.
    """
    began = perf_counter()
    model = checked_model(model)
    time_limit = positive("time_limit", time_limit, "a number of seconds above 0")
    desired = as_trajectory(desired, name="desired")
    check_norm(norm)
    check_level(level)
    if not is_one_of(proof, ("search", "scip")):
        raise InvalidInput(f"proof: got {shown(proof)}, expected 'search' or 'scip'")
    start = checked_start(start, cyclic=cyclic)
    linear: tuple[Level, ...] = ("slope",) if level == "slope" else ("slope", "envelope")
    sets = (
        reachable_set(model, len(desired), cyclic=cyclic, level=each, start=start)
        for each in linear
    )
    bound = max(_proved(model, desired, reachable, norm) for reachable in sets)
    gap = 0.0
    if level == "exact":
        prove = exact_bound if proof == "scip" else searched_bound
        question = Question(model, desired, cyclic, norm, start)
        proved, known = prove(question, time_limit=time_limit)
        bound = max(bound, proved)
        gap = max(known / bound - 1.0, 0.0) if bound > 0.0 else 0.0
    return Certificate(bound, norm, level, gap, perf_counter() - began)


def _proved(model: JointModel, desired: Array, reachable: Reachable, norm: Norm) -> float:
    """The distance from a set that multipliers prove [rad], computed on a scale of about one."""
    middle = float(np.mean(desired))
    scale = max(float(np.ptp(desired)), model.v_max * model.period)
    centred = (desired - middle) / scale
    scaled = reachable._replace(limit=_relative(reachable, middle) / scale)
    reference, multipliers = propose(scaled, centred, norm=norm)
    slack = model.v_max * model.period / scale
    return scale * certified_error(scaled, centred, reference, multipliers, norm=norm, slack=slack)


def propose(reachable: Reachable, desired: Array, *, norm: Norm) -> tuple[Array, Array]:
    """The nearest trajectory of the set and the multipliers that prove it so, as a solver has them.

    Args:
        reachable: The set.
        desired: Wanted angles, shape (n,).
        norm: Which distance.

    Returns:
        Angles at every tick, and a multiplier >= 0 for every row.

    Raises:
        SolverFailed: The solver has none.
    """
    import cvxpy

    angles: Any = cvxpy.Variable(reachable.matrix.shape[1])
    errors = angles[reachable.sampled] - desired
    distance: Any = cvxpy.sum_squares if norm == "rms" else cvxpy.norm_inf  # type: ignore[attr-defined]
    objective = distance(errors)
    conditions = reachable.matrix @ angles <= reachable.limit
    problem = cvxpy.Problem(cvxpy.Minimize(objective), [conditions])
    try:
        problem.solve(solver=cvxpy.CLARABEL)  # type: ignore[no-untyped-call]
    except cvxpy.SolverError as error:
        raise SolverFailed("lower bound", str(error)) from error
    logging.getLogger(__name__).debug(
        "lower bound: Clarabel says %s after %s iterations",
        problem.status,
        problem.solver_stats.num_iters if problem.solver_stats else "no",
    )
    if angles.value is None or conditions.dual_value is None:
        raise SolverFailed("lower bound", problem.status)
    return angles.value, np.maximum(conditions.dual_value, 0.0)


def certified_error(
    reachable: Reachable,
    desired: Array,
    reference: Array,
    multipliers: Array,
    *,
    norm: Norm,
    slack: float,
) -> float:
    """The lower bound that the multipliers prove, whoever proposed them.

    Args:
        reachable: The set.
        desired: Wanted angles, shape (n,).
        reference: Any angles at the ticks between samples, shape (ticks,).
        multipliers: lambda >= 0, shape (rows,).
        norm: Which error.
        slack: How far an angle between two samples can be from the sample before it.

    Returns:
        A number >= 0 that no trajectory of the set can go below.
    """
    point = reference.copy()
    point[reachable.sampled] = desired
    pull = reachable.matrix.T @ multipliers  # G' lambda, one entry per tick
    proved = float(multipliers @ (reachable.matrix @ point - reachable.limit))
    at_samples = pull[reachable.sampled]
    # Angles between samples are free, so there G' lambda should vanish; what is left of it counts.
    between = np.abs(pull)
    between[reachable.sampled] = 0.0
    nearest = np.repeat(desired, np.diff(reachable.sampled, append=len(point)))
    proved -= float(between @ (np.abs(point - nearest) + slack))
    if norm == "rms":
        size = np.sqrt(len(desired)) * (np.linalg.norm(at_samples) + between.sum())
    else:
        size = np.abs(at_samples).sum() + between.sum()
    return max(proved / float(size), 0.0) if size > 0.0 else 0.0


def _relative(reachable: Reachable, middle: float) -> Array:
    """The limits for angles measured from ``middle``."""
    shift: Array = reachable.matrix @ np.full(reachable.matrix.shape[1], middle)
    return reachable.limit - shift
