"""The optimised inversion in the foot's space: all joints of a leg at once."""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np

from kinematics.leg import Leg
from planner.exceptions import Infeasible, SolverFailed
from planner.model.load import rest_angles
from planner.planning.problem import FootGoal, Problem
from planner.planning.search import (
    FOOT,
    SIMULATED,
    State,
    allowed_beside,
    judged,
    minimise,
    smoothed,
)
from planner.planning.task import Task, axis_scales
from planner.trajectory import Array, Mask

LEAST_FOOT_MOTION = 1e-9
"""Movement of the foot per radian that is rounding, relative to the last link's length."""

SAME_ERROR = 1e-13
"""Errors that differ by no more than this are equal: rounding [m]."""

STATIONARY = 1e-9
"""Range of the requests that hold a joint that does not move [rad]: rounding."""


RIDGE = 1e-4
"""Curvature added to that of the squared errors, where a joint that does not move the foot has none
[-]; errors are in radians of a typical joint."""


def foot_problem(task: Task) -> Problem:
    """What the joints of a leg should do together for its foot."""
    assert task.leg is not None, "a foot belongs to a leg"
    assert task.foot is not None, "what should follow a path"
    assert task.weights is not None, "the axes of a foot have weights"
    joints, leg, angles, loads = task.nominal, task.leg, task.desired, task.loads_on(task.nominal)
    added = np.zeros_like(angles) if task.disturbance is None else task.disturbance
    least, most = (rest_angles(joints, end, loads) for end in (task.lower, task.upper))
    nearest = np.clip(angles - added, least, most)
    scale = _scale(task.weights, nearest + added, leg)
    return Problem(
        models=joints,
        desired=nearest,
        foot=FootGoal(leg, task.foot, scale, added, ridge=RIDGE),
        cyclic=task.cyclic,
        norm=task.norm,
        lower=task.lower,
        upper=task.upper,
        max_step=task.max_step,
        start=task.start,
        loads=tuple(loads),
    )


def foot_requests(problem: Problem, singly: Array, *, smoothness: float) -> tuple[Problem, Array]:
    """The best requests found for the foot, (n, k), from the plans for its joints one by one.

    They come with the problem that they solve, in which joints may be held.
    """
    first = problem.admissible(singly)
    angles = problem.exact_angles(first)
    state = State(first, problem.desired if angles is None else angles)
    best, least = minimise(problem, state, FOOT)
    logging.getLogger(__name__).debug("foot: best cost %.4g", least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion of the foot", "no requests lead to a steady cycle")
    reached = problem.exact_angles(best)
    assert reached is not None, "the search's error is finite"
    problem, best = with_stationary_joints(problem, best, reached, smoothness=smoothness)
    return problem, smoothed(problem, best, best=reached, smoothness=smoothness)


def with_stationary_joints(
    problem: Problem, found: Array, angles: Array, *, smoothness: float
) -> tuple[Problem, Array]:
    """The plan with the joints at rest that need not move, if a robot shows no difference.

    A joint that stays where it is all along the path can still compensate for a little of the
    errors of the others. Where the smoothing allows what that gains, it should not move at all.

    Args:
        problem: What the joints should do together.
        found: The requests of a good plan [rad], shape (n, k).
        angles: Its angles by the exact models [rad], shape (n, k).
        smoothness: Relative rise of the shown error that is allowed [-].

    Returns:
        The problem with those joints held, and the plan for it; or what was given.
    """
    stationary: Mask = np.ptp(problem.resting, axis=0) <= STATIONARY
    if not np.any(stationary) or np.all(stationary):
        return problem, found
    held = holding(problem, stationary)
    sharp = [stage for stage in FOOT if stage.radius < SIMULATED]
    answer, error = minimise(held, State(held.admissible(found), angles), sharp)
    reached = held.exact_angles(answer)
    allowed = allowed_beside(problem, judged(problem, angles), smoothness=smoothness)
    as_good = error <= problem.error(angles) + SAME_ERROR
    if reached is not None and (as_good or allowed.by(judged(problem, reached))):
        return held, answer
    return problem, found


def holding(problem: Problem, stationary: Mask) -> Problem:
    """The same problem with some of the joints where they rest, from the first sample on."""
    place = problem.resting[0]
    lower, upper = (np.where(stationary, place, limit) for limit in (problem.lower, problem.upper))
    return replace(problem, lower=lower, upper=upper)


def foot_motion(leg: Leg, angles: Array, weights: Array) -> float:
    """How far a radian of a joint moves the foot [m/rad], rms over joints, axes and samples."""
    jacobians = leg.jacobians(angles) * axis_scales(weights)[:, np.newaxis]
    return float(np.sqrt(np.mean(jacobians**2)))


def _scale(importance: Array, angles: Array, leg: Leg) -> Array:
    """Root of each axis' weight over how far a radian of a joint moves the foot [rad/m], (3,)."""
    moved = foot_motion(leg, angles, importance)
    if moved <= LEAST_FOOT_MOTION * float(np.max(np.abs(leg.chain.tip), initial=LEAST_FOOT_MOTION)):
        raise Infeasible(
            "leg: none of its joints moves the foot along an axis that counts; choose another foot "
            "frame, or give the axis along which it moves a weight"
        )
    return axis_scales(importance) / moved
