"""The optimised inversion in the foot's space: all joints of a leg at once."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from kinematics.symbolic import foot_function
from planner.exceptions import Infeasible, InvalidInput, SolverFailed
from planner.model.joint import JointModel
from planner.model.load import Loads, felt, rest_angles
from planner.planning.arguments import (
    Norm,
    check_norm,
    checked_smoothness,
    load_of_each,
    model_of_each,
    steps_of_each,
)
from planner.planning.foot.arguments import (
    axis_scales,
    checked_leg,
    foot_motion,
    joints_of,
    limits_of,
)
from planner.planning.foot.result import FootInversion
from planner.planning.gauss_newton import OPTIONS as SEARCH
from planner.planning.gauss_newton import Stage, State, minimise
from planner.planning.load_of_pose import LoadOfPose, settled
from planner.planning.optimal import invert_optimal
from planner.planning.robust import ModelOrModels, Robust, robust_requests, scenarios_of
from planner.planning.smoothing import allowed_beside, smoothed
from planner.planning.tracking_problem import Errors, TrackingProblem
from planner.trajectory import Array, Mask
from planner.validation import as_flag, as_reals, freeze, shown

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


@np.errstate(under="ignore")  # too small to matter, whatever the caller has set
def invert_foot(
    models: ModelOrModels | Sequence[ModelOrModels],
    leg: Leg,
    foot: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    norm: Norm = "rms",
    weights: npt.ArrayLike = (1.0, 1.0, 1.0),
    unreachable: Literal["nearest", "raise"] = "nearest",
    load: npt.ArrayLike | LoadOfPose | None = None,
    disturbance: npt.ArrayLike | None = None,
    max_step: npt.ArrayLike | None = None,
    smoothness: float | None = None,
    robust: Robust | None = None,
) -> FootInversion:
    """Requests to all joints of a leg that keep its foot as close to a path as the search can.

    The error of one joint can compensate for that of another. The search is that of
    :func:`planner.invert_optimal` with the joints stacked, from their own plans on; the leg's
    kinematics come from CasADi. From rest the joints rest at the first point, or nearest to it.

    Args:
        models: One joint model for all joints of the leg, or one for each. In the place of a model
            there may be several that the joint may have, the nominal one first, or an
            identification, from whose intervals eight are drawn: the requests are then good for the
            first, the second ... models of all joints together; with a sequence of one in that
            place the joint has that model in any case. Those of different joints are drawn
            independently; joints with the same model have the same ones. For a leg of one joint a
            flat sequence of more than one is such a sequence.
        leg: A leg of up to three joints.
        foot: Desired positions in the leg's base frame [m], shape (n, 3), one every model's period.
        cyclic: Whether the path repeats for ever.
        limits: Smallest and largest requests [rad], numbers or shape (k,); by default the leg's.
        norm: "rms" to minimise the root mean square distance, "max" the largest one.
        weights: How much each axis of the base frame counts, shape (3,).
        unreachable: Points out of reach are followed as closely as the leg can ("nearest"; the
            plan's ``reachable`` says which), or are an error that lists them ("raise").
        load: Torque on the joints in the direction of positive angles [N m], a number, shape (k,)
            for each joint's, or (n, k); row i acts in the request period that ends in sample i. Or
            a function of the angles (n, k) [rad]: see :func:`planner.plan`.
        disturbance: Measured minus modelled angles [rad], shape (n, k), which the models' angles
            are taken to miss under other requests too: see :func:`planner.refine`.
        max_step: Largest change from one request of a joint to the next [rad], a number or shape
            (k,): see :func:`planner.invert_optimal`.
        smoothness: Relative rise of the foot's error that smoother requests may cost, as there: an
            error that a robot would show, those of the joints through the leg's Jacobian.
        robust: "mean" to minimise the root mean square of the foot's errors over several models,
            the default for them, "worst" for the largest of them. For models that are in no such
            sequence eight others are drawn from the intervals that their files have.

    Returns:
        The plan. Error, bound and gap are those of the nominal models; ``errors_of_models`` has all
        errors, ``nominal`` the plan for the nominal models alone.

    Raises:
        InvalidInput: The models do not fit the leg or each other, or the weights are not three
            numbers, 0 or more and not all 0, or load or disturbance do not fit the points, or
            ``max_step`` is not above 0 or ``smoothness`` below it, or a model without
            intervals, or only models in any case, are to be planned for robustly.
        Infeasible: The limits exclude each other, or no joint moves the foot where it counts.
        kinematics.KinematicsError: The path is not an array (n, 3), or the leg has no inverse.
        SolverFailed: No requests were found that lead to a steady cycle of every joint.

    Example:
        >>> from planner import reference_walk
        >>> walk = reference_walk()
        >>> made = invert_foot(JointModel.ers210a(), walk.leg, walk.desired_foot)
        >>> f"{100 * made.rms:.2f} cm rms"
        '0.62 cm rms'
    """
    check_norm(norm)
    cyclic = as_flag("cyclic", cyclic)
    leg = checked_leg(leg)
    scenarios = scenarios_of(models, len(leg.joint_names), robust, joints=joints_of(leg))
    joints = model_of_each(
        scenarios[0], len(leg.joint_names), given_as="models", joints=joints_of(leg)
    )
    importance = _checked_weights(weights)
    lower, upper = limits_of(limits, leg)
    steps = steps_of_each(max_step, len(joints), joints=joints_of(leg))
    share = checked_smoothness(smoothness)
    solution = leg.inverse(foot, unreachable=unreachable)
    desired = _long_enough(foot)
    if callable(load):
        again = partial(
            invert_foot,
            [*zip(*scenarios, strict=True)],
            leg,
            desired,
            cyclic=cyclic,
            limits=(lower, upper),
            norm=norm,
            weights=importance,
            unreachable=unreachable,
            disturbance=disturbance,
            max_step=max_step,
            smoothness=smoothness,
            robust=robust,
        )
        return settled(lambda torques: again(load=torques), load, solution.angles)
    by_scenario = [
        load_of_each(load, each, len(desired), joints=joints_of(leg)) for each in scenarios
    ]
    added = _checked_disturbance(disturbance, solution.angles)
    problem = _problem(
        joints,
        leg,
        desired,
        solution.angles,
        weights=importance,
        limits=(lower, upper),
        max_step=steps,
        cyclic=cyclic,
        norm=norm,
        loads=by_scenario[0],
        disturbance=added,
    )
    problem, requests = _search(problem, smoothness=share)
    freeze(requests, desired, lower, upper, steps, problem.start, added)
    alone = FootInversion(
        models=joints,
        leg=leg,
        desired_foot=desired,
        requests=requests,
        cyclic=cyclic,
        norm=norm,
        weights=importance,
        limits=(lower, upper),
        max_step=steps if np.any(np.isfinite(steps)) else None,
        smoothness=share,
        start=problem.start,
        reachable=solution.reachable,
        loads=tuple(felt(each) for each in zip(*by_scenario, strict=True)),
        disturbance=added,
    )
    if len(scenarios) == 1:
        return alone
    robust = robust or "mean"
    requests = robust_requests(
        problem,
        scenarios,
        by_scenario,
        requests,
        robust=robust,
        smoothness=share,
        search=_longer(SEARCH.narrow),
    )
    freeze(requests)
    return replace(
        alone,
        requests=requests,
        scenarios=scenarios,
        robust=robust,
        nominal=replace(alone, scenarios=scenarios),
    )


def _long_enough(foot: npt.ArrayLike) -> Array:
    """A copy of a path that the leg's inverse has accepted, if it has three points."""
    desired = np.array(foot, dtype=np.float64)
    if len(desired) < 3:
        raise InvalidInput(f"foot: got {len(desired)} points, expected at least 3")
    return desired


def _problem(
    joints: tuple[JointModel, ...],
    leg: Leg,
    desired: Array,
    angles: Array,
    *,
    weights: Array,
    limits: tuple[Array, Array],
    max_step: Array,
    cyclic: bool,
    norm: Norm,
    loads: Loads,
    disturbance: Array | None = None,
) -> TrackingProblem:
    """What the joints should do together, if these angles (n, k) bring the foot nearest [rad]."""
    lower, upper = limits
    added: Array | float = 0.0 if disturbance is None else disturbance
    least, most = rest_angles(joints, lower, loads), rest_angles(joints, upper, loads)
    nearest = np.clip(angles - added, least, most)
    return TrackingProblem(
        joints,
        FollowFoot(leg, desired, _scale(weights, nearest + added, leg), added),
        nearest,
        cyclic=cyclic,
        norm=norm,
        limits=limits,
        max_step=max_step,
        start=None if cyclic else np.clip(angles, least, most)[0],
        ridge=OPTIONS.ridge,
        loads=loads,
    )


def _search(problem: TrackingProblem, *, smoothness: float) -> tuple[TrackingProblem, Array]:
    """The best requests found for the foot, (n, k), from the plans for its joints one by one.

    They come with the problem that they solve, in which joints may be held.
    """
    columns = zip(
        problem.models,
        problem.desired.T,
        problem.lower,
        problem.upper,
        problem.max_step,
        problem.loads,
        strict=True,
    )
    singly = [
        invert_optimal(
            model,
            column,
            cyclic=problem.cyclic,
            limits=(low, high),
            load=load,
            max_step=step,
            smoothness=0.0,
        ).requests
        for model, column, low, high, step, load in columns
    ]
    first = problem.admissible(np.stack(singly, axis=1))
    angles = problem.exact_angles(first)
    state = State(first, problem.desired if angles is None else angles)
    best, least = minimise(problem, state, _longer(OPTIONS.stages))
    logging.getLogger(__name__).debug("foot: best cost %.4g", least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion of the foot", "no requests lead to a steady cycle")
    reached = problem.exact_angles(best.requests)
    assert reached is not None, "the search's error is finite"
    problem, best = with_stationary_joints(problem, best, reached, smoothness=smoothness)
    return problem, smoothed(problem, best.requests, best=reached, smoothness=smoothness)


def _longer(stages: Sequence[Stage]) -> list[Stage]:
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
    answer, error = minimise(held, begin, _longer(sharp))
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


def _scale(importance: Array, angles: Array, leg: Leg) -> Array:
    """Root of each axis' weight over how far a radian of a joint moves the foot [rad/m], (3,)."""
    moved = foot_motion(leg, angles, importance)
    if moved <= LEAST_FOOT_MOTION * float(np.max(np.abs(leg.chain.tip), initial=LEAST_FOOT_MOTION)):
        raise Infeasible(
            "leg: none of its joints moves the foot along an axis that counts; choose another foot "
            "frame, or give the axis along which it moves a weight"
        )
    return axis_scales(importance) / moved


def _checked_weights(weights: npt.ArrayLike) -> Array:
    try:
        importance = as_reals(weights)
    except (TypeError, ValueError):
        importance = np.empty(0)
    fit = importance.shape == (3,) and bool(np.all(np.isfinite(importance)))
    if not fit or np.any(importance < 0.0) or not np.any(importance > 0.0):
        raise InvalidInput(
            f"weights: got {shown(weights)}, expected three numbers, 0 or more and not all 0"
        )
    importance.setflags(write=False)
    return importance


def _checked_disturbance(disturbance: npt.ArrayLike | None, angles: Array) -> Array | None:
    """The disturbance [rad], a copy of the shape of the angles (n, k); None where there is none."""
    if disturbance is None:
        return None
    try:
        added = as_reals(disturbance)
    except (TypeError, ValueError):
        added = np.empty(0)
    if added.shape != angles.shape or not np.all(np.isfinite(added)):
        raise InvalidInput(
            f"disturbance: got {shown(disturbance)}, expected finite angles [rad] of shape "
            f"{angles.shape}, a column for each joint"
        )
    return added
