"""The optimised inversion in the foot's space: all joints of a leg at once."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.leg import Leg
from kinematics.symbolic import foot_function
from planner.exceptions import Infeasible, SolverFailed
from planner.model.load import rest_angles
from planner.planning.gauss_newton import OPTIONS as SEARCH
from planner.planning.gauss_newton import Stage, State, minimise
from planner.planning.smoothing import allowed_beside, smoothed
from planner.planning.task import Task, axis_scales
from planner.planning.tracking_problem import Errors, TrackingProblem
from planner.trajectory import Array, Mask

LEAST_FOOT_MOTION = 1e-9
"""Movement of the foot per radian that is rounding, relative to the last link's length."""

SAME_ERROR = 1e-13
"""Errors that differ by no more than this are equal: rounding [m]."""

STATIONARY = 1e-9
"""Range of the requests that hold a joint that does not move [rad]: rounding."""


@dataclass(frozen=True, kw_only=True)
class FootOptions:
    """What steers the search for a foot, beside the options of the search itself.

    Attributes:
        stages: Wide corners first: the joints must leave the plans that were best for each alone.
            Over 38 feet, without a second search from narrow corners: +0.003 % on average and
            0.08 % at worst; corners of 2 and 1 in front lose 0.35 % at worst, none 0.55 %.
        steps: Steps of a stage at most: where joints can stand in for one another, it takes many.
            12 or 24 make no difference to 18 feet.
        ridge: Curvature added to that of the squared errors, where a joint that does not move the
            foot has none [-]; errors are in radians of a typical joint.
    """

    stages: tuple[Stage, ...] = (Stage(1.5, 1e-3), Stage(0.7, 1e-3), *SEARCH.narrow)
    steps: int = 16
    ridge: float = 1e-4


OPTIONS = FootOptions()


class FollowFoot:
    """A foot that should follow a path; its errors count in radians of a typical joint's turn."""

    shared = True

    def __init__(
        self, leg: Leg, desired: Array, scale: Array, disturbance: Array | float = 0.0
    ) -> None:
        """Compile the leg for a path as long as the desired one, (n, 3) [m].

        ``scale`` turns metres along each axis into errors [rad/m], (3,); ``disturbance`` [rad],
        (n, k), is added to the joints' angles before the foot's position is computed.
        """
        self.desired = desired
        self._scale = scale
        self._disturbance = disturbance
        self._foot = foot_function(leg).map(len(desired))
        self._joints = len(leg.joint_names)

    def distances(self, angles: Array) -> Array:
        """Scaled distances [rad], (n,)."""
        distances: Array = np.linalg.norm(self.errors(angles).values, axis=1)
        return distances

    def errors(self, angles: Array) -> Errors:
        """Foot minus desired, each axis times its scale [rad]."""
        foot, jacobian = self._foot((angles + self._disturbance).T)
        values = (np.asarray(foot).T - self.desired) * self._scale
        # CasADi lays the Jacobians (3, k) side by side.
        stacked = np.asarray(jacobian).reshape(3, len(angles), self._joints).transpose(1, 0, 2)
        return Errors(values, stacked * self._scale[:, np.newaxis])


def foot_problem(task: Task) -> TrackingProblem:
    """What the joints of a leg should do together for its foot."""
    assert task.leg is not None, "a foot belongs to a leg"
    assert task.foot is not None, "what should follow a path"
    assert task.weights is not None, "the axes of a foot have weights"
    joints, leg, angles, loads = task.nominal, task.leg, task.desired, task.loads_on(task.nominal)
    added: Array | float = 0.0 if task.disturbance is None else task.disturbance
    least, most = (rest_angles(joints, end, loads) for end in (task.lower, task.upper))
    nearest = np.clip(angles - added, least, most)
    return TrackingProblem(
        joints,
        FollowFoot(leg, task.foot, _scale(task.weights, nearest + added, leg), added),
        nearest,
        cyclic=task.cyclic,
        norm=task.norm,
        limits=(task.lower, task.upper),
        max_step=task.max_step,
        start=task.start,
        ridge=OPTIONS.ridge,
        loads=loads,
    )


def foot_requests(
    problem: TrackingProblem, singly: Array, *, smoothness: float
) -> tuple[TrackingProblem, Array]:
    """The best requests found for the foot, (n, k), from the plans for its joints one by one.

    They come with the problem that they solve, in which joints may be held.
    """
    first = problem.admissible(singly)
    angles = problem.exact_angles(first)
    state = State(first, problem.desired if angles is None else angles)
    best, least = minimise(problem, state, longer(OPTIONS.stages))
    logging.getLogger(__name__).debug("foot: best cost %.4g", least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion of the foot", "no requests lead to a steady cycle")
    reached = problem.exact_angles(best.requests)
    assert reached is not None, "the search's error is finite"
    problem, best = with_stationary_joints(problem, best, reached, smoothness=smoothness)
    return problem, smoothed(problem, best.requests, best=reached, smoothness=smoothness)


def longer(stages: Sequence[Stage]) -> list[Stage]:
    """The stages with as many steps as a foot takes."""
    return [stage._replace(steps=OPTIONS.steps) for stage in stages]


def with_stationary_joints(
    problem: TrackingProblem, found: State, angles: Array, *, smoothness: float
) -> tuple[TrackingProblem, State]:
    """The plan with the joints at rest that need not move, if a robot shows no difference.

    A joint that stays where it is all along the path can still compensate for a little of the
    errors of the others. Where the smoothing allows what that gains, it should not move at all.

    Args:
        problem: What the joints should do together.
        found: A good plan.
        angles: Its angles by the exact models [rad], shape (n, k).
        smoothness: Relative rise of the shown error that is allowed [-].

    Returns:
        The problem with those joints held, and the plan for it; or what was given.
    """
    stationary: Mask = np.ptp(problem.resting, axis=0) <= STATIONARY
    if not np.any(stationary) or np.all(stationary):
        return problem, found
    held = holding(problem, stationary)
    begin = State(held.admissible(found.requests), found.angles)
    sharp = [stage for stage in SEARCH.narrow if stage.radius < SEARCH.simulated]
    answer, error = minimise(held, begin, longer(sharp))
    reached = held.exact_angles(answer.requests)
    allowed = allowed_beside(problem, angles, smoothness=smoothness)
    as_good = error <= problem.error(angles) + SAME_ERROR
    if reached is not None and (as_good or allowed.by(problem, reached)):
        return held, answer
    return problem, found


def holding(problem: TrackingProblem, stationary: Mask) -> TrackingProblem:
    """The same problem with some of the joints where they rest, from the first sample on."""
    place = problem.resting[0]
    lower, upper = (np.where(stationary, place, limit) for limit in (problem.lower, problem.upper))
    return problem.within((lower, upper))


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
