"""Which of several poses to take at each point of a path."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array
from kinematics.limits import TURN, Limits, half_turned

SAME = 6
"""Decimals [rad] to which margins and moves are compared, so that rounding decides nothing."""


def choose(poses: Array, allowed: npt.NDArray[np.bool_], limits: Limits) -> Array:
    """One pose at each point: the first deep inside the limits, the others close to the last.

    At the first point the pose whose least distance to any limit is largest; of equal ones that
    with the larger angle of the last joint, then of the joint before it. At every later point the
    pose with the least move from the one before (root of the sum of squares); of equal ones the
    same order decides. For joints that can turn further than a full turn whole turns are no move.

    Args:
        poses: Angles [rad], shape (n, m, k), within the limits.
        allowed: Which of them may be chosen, at least one at each point, shape (n, m).
        limits: The joint limits.

    Returns:
        Angles [rad], shape (n, k).
    """
    margin = np.where(allowed, limits.margin(poses), -np.inf)
    keys = np.concatenate([-np.moveaxis(poses, -1, 0), -margin[None]])
    order = np.lexsort(np.round(keys, SAME), axis=-1)  # best first
    order = order[:, : allowed.sum(axis=1).max(initial=1)]  # those not allowed come last
    poses = np.take_along_axis(poses, order[..., None], axis=1)
    allowed = np.take_along_axis(allowed, order, axis=1)

    following = []  # for each branch: the branch to take at the next point, shape (n - 1,)
    for branch in range(poses.shape[1]):
        move = poses[1:] - poses[:-1, branch, None]
        move = np.where(limits.turning, half_turned(move), move)
        length = np.round(np.sqrt((move**2).sum(axis=-1)), SAME)
        following.append(np.where(allowed[1:], length, np.inf).argmin(axis=-1).tolist())
    branches = np.zeros(len(poses), dtype=np.intp)
    branch = 0
    for point in range(1, len(poses)):
        branch = branches[point] = following[branch][point - 1]
    chosen = np.asarray(poses[np.arange(len(poses)), branches])
    for joint in np.flatnonzero(limits.turning):
        lower, upper = float(limits.lower[joint]), float(limits.upper[joint])
        chosen[:, joint] = _followed(chosen[:, joint].tolist(), lower, upper)
    return chosen


def _followed(angles: list[float], lower: float, upper: float) -> list[float]:
    """The same directions with whole turns added so that each is near the last, within limits."""
    followed: list[float] = []
    for angle in angles:
        near = angle + TURN * round((followed[-1] - angle) / TURN) if followed else angle
        near -= TURN * (near > upper)
        followed.append(near + TURN * (near < lower))
    return followed
