"""Joint angles that put the foot at the points of a path: enumerate, check, choose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from kinematics.branches import choose
from kinematics.chain import Array, Chain, read_only
from kinematics.closed_form import ClosedForm
from kinematics.exceptions import InvalidInput, SingularLeg, UnreachableFoot, UnsupportedLeg
from kinematics.limits import Limits
from kinematics.nearest import nearest_poses

Unreachable = Literal["raise", "nearest", "clamp"]

MOST_JOINTS = 3
"""Joints that the position of a foot can determine."""

REACHED = 1e-9
"""A pose reaches a point when its foot is within this of it [m]."""

UNMOVED = 1e-9
"""Movement of the foot below this is rounding [m/rad]."""

TRIED = np.array([[0.3, -0.7, 1.1], [-1.3, 0.5, 0.8], [2.1, 1.7, -0.4], [0.9, -2.3, 2.6]])
"""Poses at which Jacobians are evaluated [rad], without a symmetry that could hide a movement."""


class InverseSolution(NamedTuple):
    """Joint angles for a path of the foot, and their distances from it.

    Attributes:
        angles: Joint angles within the limits [rad], read-only, shape (n, k).
        reachable: Whether the foot is at the point, to 1e-9 m, read-only, shape (n,).
        distance: Distance between the foot at ``angles`` and the point [m], read-only, shape (n,).
    """

    angles: Array
    reachable: npt.NDArray[np.bool_]
    distance: Array


def solve_inverse(
    chain: Chain,
    limits: Limits,
    closed_form: ClosedForm | None,
    foot: Array,
    *,
    names: Sequence[str],
    unreachable: Unreachable = "raise",
    near: Array | None = None,
) -> InverseSolution:
    """Joint angles that put the foot at each point of a path; see :meth:`kinematics.Leg.inverse`.

    Args:
        chain: The leg, with three joints at most.
        limits: Its joint limits.
        closed_form: Its closed form, or None to search numerically.
        foot: Points in the base frame [m], finite, shape (n, 3).
        names: Names of the joints, for messages.
        unreachable: What to do with points out of reach.
        near: A pose near which to start [rad], shape (k,); by default deep inside the limits.

    Returns:
        The angles, each judged by the chain's forward kinematics.

    Raises:
        UnreachableFoot: Some points are out of reach, and ``unreachable`` is "raise".
        UnsupportedLeg: The leg has more than three joints, or no closed form to clamp.
        SingularLeg: One of its joints never moves the foot.
        InvalidInput: ``unreachable`` is none of the three.
    """
    _check(chain, closed_form, unreachable)
    check_joints(chain, names)
    if closed_form is None:
        poses = nearest_poses(chain, limits, foot)
    else:
        poses = limits.clip(limits.wrap(closed_form.poses(foot)))
    distances = _distances(chain, poses, foot)
    missed = distances.min(axis=1) > REACHED
    if closed_form is not None and missed.any() and unreachable != "clamp":
        nearest = nearest_poses(chain, limits, foot[missed])
        poses, distances = _widened(poses, distances, nearest.shape[1])
        poses[missed], distances[missed] = nearest, _distances(chain, nearest, foot[missed])
    if unreachable == "raise" and missed.any():
        indices, least = np.flatnonzero(missed), distances[missed].min(axis=1)
        raise UnreachableFoot(read_only(indices), read_only(least), of=len(foot))
    allowed = distances <= distances.min(axis=1, keepdims=True) + REACHED
    angles = choose(poses, allowed, limits, near=near, chain=chain)
    distance = _distances(chain, angles[:, None], foot)[:, 0]
    return InverseSolution(read_only(angles), read_only(distance <= REACHED), read_only(distance))


def check_joints(chain: Chain, names: Sequence[str]) -> None:
    """Raise an error where a joint of a leg of at most three never moves the foot.

    Args:
        chain: The leg.
        names: Names of the joints, for the message.

    Raises:
        SingularLeg: The foot lies on the axis of a joint in every pose.
    """
    moved = np.linalg.norm(chain.jacobians(TRIED[:, : len(chain.axes)]), axis=1).max(axis=0)
    unmoving = tuple(name for name, most in zip(names, moved, strict=True) if most <= UNMOVED)
    if unmoving:
        raise SingularLeg(
            f"leg: singular in every pose, as joint {unmoving[0]!r} does not move the foot, which "
            "lies on its axis; choose a foot frame further out, or lock the joint",
            joints=unmoving,
        )


def _check(chain: Chain, closed_form: ClosedForm | None, unreachable: str) -> None:
    """Raise an error for a leg or an option without an inverse."""
    if not isinstance(unreachable, str):
        raise InvalidInput(f"unreachable: got {type(unreachable).__name__}, expected a name")
    if unreachable not in get_args(Unreachable):
        raise InvalidInput(
            f"unreachable: got {unreachable!r}, expected one of {', '.join(get_args(Unreachable))}"
        )
    if len(chain.axes) > MOST_JOINTS:
        raise UnsupportedLeg(
            f"the inverse needs a leg of {MOST_JOINTS} joints at most, this one has "
            f"{len(chain.axes)}: lock the others, or choose the base and foot frames so that three "
            "joints lie between them"
        )
    if unreachable == "clamp" and closed_form is None:
        raise UnsupportedLeg(
            "unreachable='clamp' needs a leg with a closed form, whose arguments it clamps, and "
            "this leg has none: use 'nearest'"
        )


def _distances(chain: Chain, poses: Array, foot: Array) -> Array:
    """Distance between the foot at each pose (n, m, k) and its point (n, 3) [m], shape (n, m)."""
    flat = poses.reshape(-1, poses.shape[-1]).T
    reached = chain.foot(np.cos(flat), np.sin(flat)).T.reshape(*poses.shape[:2], 3)
    return np.asarray(np.linalg.norm(reached - foot[:, None], axis=-1))


def _widened(poses: Array, distances: Array, count: int) -> tuple[Array, Array]:
    """Room for ``count`` poses at each point; the new ones count as infinitely far."""
    missing = count - poses.shape[1]
    return (
        np.concatenate([poses, np.repeat(poses[:, :1], missing, axis=1)], axis=1),
        np.pad(distances, ((0, 0), (0, missing)), constant_values=np.inf),
    )
