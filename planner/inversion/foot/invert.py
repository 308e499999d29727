"""The optimised inversion in the foot's space: all joints of a leg at once."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from kinematics.symbolic import foot_function
from planner.exceptions import Infeasible, InvalidInput, SolverFailed
from planner.given import as_flag, as_reals, freeze, shown
from planner.inversion.descent import SEARCH, WIDE_SEARCH, improve
from planner.inversion.foot.result import FootInversion
from planner.inversion.goal import Errors
from planner.inversion.iterate import State
from planner.inversion.leg_joints import checked_leg, joints_of, limits_of, model_of_each
from planner.inversion.norm import Norm, check_norm
from planner.inversion.optimal import invert_optimal
from planner.inversion.quiet import quieten
from planner.inversion.still import without_idle_motion
from planner.inversion.tracking import Tracking
from planner.model.joint import JointModel
from planner.trajectory import Array

RIDGE = 1e-4
"""Curvature where the foot does not see a joint, relative to the squared length of the leg."""

UNMOVED = 1e-9
"""Movement of the foot per radian, relative to the last link's length, that is none."""

FOOT_SEARCH = tuple(stage._replace(steps=16) for stage in (*WIDE_SEARCH[:2], *SEARCH))
"""Wide corners first: the joints must leave the plans that were best for each alone. Where joints
can stand in for one another, it takes many steps until they have settled it."""


CALMING_ROUNDS = 3
"""Rounds of calming: their cost is small beside that of the searches."""


class FollowFoot:
    """A foot that should follow a path; its errors count in radians of a typical joint's turn."""

    def __init__(self, leg: Leg, wanted: Array, scale: Array) -> None:
        """Compile the leg for a path as long as the wanted one, (n, 3) [m].

        ``scale`` turns metres along each axis into errors [rad/m], (3,).
        """
        self.wanted = wanted
        self._scale = scale
        self._foot = foot_function(leg).map(len(wanted))
        self._joints = len(leg.joint_names)

    def distances(self, angles: Array) -> Array:
        """Scaled distances [rad], (n,)."""
        distances: Array = np.linalg.norm(self.errors(angles).values, axis=1)
        return distances

    def errors(self, angles: Array) -> Errors:
        """Foot minus wanted, each axis times its scale [rad]."""
        foot, jacobian = self._foot(angles.T)
        values = (np.asarray(foot).T - self.wanted) * self._scale
        # CasADi lays the Jacobians (3, k) side by side.
        stacked = np.asarray(jacobian).reshape(3, len(angles), self._joints).transpose(1, 0, 2)
        return Errors(values, stacked * self._scale[:, np.newaxis])


def invert_foot(
    models: JointModel | Sequence[JointModel],
    leg: Leg,
    foot: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    norm: Norm = "rms",
    weights: npt.ArrayLike = (1.0, 1.0, 1.0),
    unreachable: Literal["nearest", "raise"] = "nearest",
) -> FootInversion:
    """Requests to all joints of a leg that keep its foot as close to a path as the search can.

    The joints err together: an error of one can make up for that of another. The search is that of
    :func:`planner.invert_optimal` with the joints stacked, from their own plans on; the leg's
    kinematics come from CasADi. From rest the joints rest at the first point, or nearest to it.

    Args:
        models: One joint model for all joints of the leg, or one for each.
        leg: A leg of up to three joints.
        foot: Wanted positions in the leg's base frame [m], shape (n, 3), one every model's period.
        cyclic: Whether the path repeats for ever.
        limits: Smallest and largest requests [rad], numbers or shape (k,); by default the leg's.
        norm: "rms" to minimise the root mean square distance, "max" the largest one.
        weights: How much each axis of the base frame counts, shape (3,).
        unreachable: Points out of reach are followed as closely as the leg can ("nearest"; the
            plan's ``reachable`` says which), or are an error that lists them ("raise").

    Returns:
        The plan.

    Raises:
        InvalidInput: The models do not fit the leg or each other, or the weights are none.
        Infeasible: The limits exclude each other, or no joint moves the foot where it counts.
        kinematics.KinematicsError: The path is none, or the leg has no inverse.
        SolverFailed: No requests were found under which every joint finds a cycle.
    """
    check_norm(norm)
    cyclic = as_flag("cyclic", cyclic)
    leg = checked_leg(leg)
    joints = model_of_each(models, len(leg.joint_names), given_as="models", joints=joints_of(leg))
    importance = _checked_weights(weights)
    lower, upper = limits_of(limits, leg)
    solution = leg.inverse(foot, unreachable=unreachable)
    wanted = _long_enough(foot)
    problem = _problem(
        joints,
        leg,
        wanted,
        solution.angles,
        weights=importance,
        limits=(lower, upper),
        cyclic=cyclic,
        norm=norm,
    )
    requests = _search(problem)
    freeze(requests, wanted, lower, upper, problem.start)
    return FootInversion(
        models=joints,
        leg=leg,
        wanted=wanted,
        requests=requests,
        cyclic=cyclic,
        norm=norm,
        weights=importance,
        limits=(lower, upper),
        start=problem.start,
        reachable=solution.reachable,
    )


def _long_enough(foot: npt.ArrayLike) -> Array:
    """A copy of a path that the leg's inverse has accepted, if it has three points."""
    wanted = np.array(foot, dtype=np.float64)
    if len(wanted) < 3:
        raise InvalidInput(f"foot: got {len(wanted)} points, expected at least 3")
    return wanted


def _problem(
    joints: tuple[JointModel, ...],
    leg: Leg,
    wanted: Array,
    angles: Array,
    *,
    weights: Array,
    limits: tuple[Array, Array],
    cyclic: bool,
    norm: Norm,
) -> Tracking:
    """What the joints should do together, if these angles (n, k) bring the foot nearest [rad]."""
    lower, upper = limits
    offsets = np.array([model.offset for model in joints])
    nearest = np.clip(angles, lower + offsets, upper + offsets)
    return Tracking(
        joints,
        FollowFoot(leg, wanted, _scale(weights, leg.jacobians(nearest), leg)),
        nearest - offsets,
        cyclic=cyclic,
        norm=norm,
        limits=limits,
        start=None if cyclic else nearest[0].copy(),
        ridge=RIDGE,
    )


def _search(problem: Tracking) -> Array:
    """The best requests found for the foot, from the plans for its joints one by one: (n, k)."""
    nearest = problem.resting + problem.offsets
    singly = [
        invert_optimal(model, column, cyclic=problem.cyclic, limits=(low, high)).requests
        for model, column, low, high in zip(
            problem.models, nearest.T, problem.lower, problem.upper, strict=True
        )
    ]
    first = problem.admissible(np.stack(singly, axis=1))
    angles = problem.exact_angles(first)
    state = State(first, nearest if angles is None else angles)
    at_most = problem.exact_error(first)
    best, least = improve(problem, state, FOOT_SEARCH)
    logging.getLogger(__name__).debug("foot: best cost %.4g", least)
    if not math.isfinite(least):
        raise SolverFailed("optimised inversion of the foot", "no requests lead to a steady cycle")
    problem, best = without_idle_motion(problem, best, nearest, at_most=at_most)
    return quieten(problem, best.requests, at_most=at_most, rounds=CALMING_ROUNDS)


def _scale(importance: Array, jacobians: Array, leg: Leg) -> Array:
    """Root of each axis' weight over how far a radian of a joint moves the foot [rad/m], (3,)."""
    roots: Array = np.sqrt(importance / np.max(importance))
    moved = float(np.sqrt(np.mean((jacobians * roots[:, np.newaxis]) ** 2)))
    if moved <= UNMOVED * float(np.max(np.abs(leg.chain.tip), initial=UNMOVED)):
        raise Infeasible(
            "leg: none of its joints moves the foot along an axis that counts; choose another foot "
            "frame, or give the axis along which it moves a weight"
        )
    return roots / moved


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
