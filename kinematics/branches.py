"""Which of several poses to take at each point of a path."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array

SAME = 6
"""Decimals [rad] to which margins and moves are compared, so that rounding decides nothing."""


def wrap(angles: Array, lower: Array, upper: Array) -> Array:
    """The turn of each angle that lies nearest to the middle of the limits [rad]."""
    limited = np.isfinite(lower) & np.isfinite(upper)
    middle = np.where(
        limited, 0.5 * (np.where(limited, lower, 0.0) + np.where(limited, upper, 0.0)), 0.0
    )
    return np.asarray(middle + np.remainder(angles - middle + np.pi, 2 * np.pi) - np.pi)


def choose(poses: Array, allowed: npt.NDArray[np.bool_], lower: Array, upper: Array) -> Array:
    """One pose at each point: the first deep inside the limits, the others close to the last.

    At the first point the pose whose least distance to any limit is largest; of equal ones that with
    the larger angle of the last joint, then of the joint before it. At every later point the pose
    with the least move from the one before (root of the sum of squares); of equal ones the same order decides.
    Joints that can turn further than a full turn count whole turns as no move, and follow on.

    Args:
        poses: Angles [rad], shape (n, m, k), within the limits.
        allowed: Which of them may be chosen, at least one at each point, shape (n, m).
        lower: Lower joint limits [rad], may be -inf, shape (k,).
        upper: Upper joint limits [rad], may be inf, shape (k,).

    Returns:
        Angles [rad], shape (n, k).
    """
    margin = np.minimum(poses - lower, upper - poses).min(axis=-1)
    margin = np.where(allowed, margin, -np.inf)
    keys = [np.round(-poses[..., joint], SAME) for joint in range(poses.shape[-1])]
    order = np.lexsort([*keys, -np.round(margin, SAME)], axis=-1)  # best first
    poses = np.take_along_axis(poses, order[..., None], axis=1)
    allowed = np.take_along_axis(allowed, order, axis=1)

    turning = upper - lower >= 2 * np.pi
    following = []
    for branch in range(poses.shape[1]):
        move = poses[1:] - poses[:-1, branch, None]
        move = np.where(turning, np.remainder(move + np.pi, 2 * np.pi) - np.pi, move)
        cost = np.where(allowed[1:], np.round(np.sqrt((move**2).sum(axis=-1)), SAME), np.inf)
        following.append(cost.argmin(axis=-1).tolist())
    branches = np.zeros(len(poses), dtype=np.intp)
    branch = 0
    for point in range(1, len(poses)):
        branch = branches[point] = following[branch][point - 1]
    chosen = poses[np.arange(len(poses)), branches]
    for joint in np.flatnonzero(turning):
        chosen[:, joint] = _followed(chosen[:, joint], float(lower[joint]), float(upper[joint]))
    return chosen


def _followed(angles: Array, lower: float, upper: float) -> list[float]:
    """The same angles with whole turns added so that each is near the last, within the limits."""
    followed: list[float] = []
    for angle in angles.tolist():
        if followed:
            angle += 2 * np.pi * round((followed[-1] - angle) / (2 * np.pi))
        while angle < lower:
            angle += 2 * np.pi
        while angle > upper:
            angle -= 2 * np.pi
        followed.append(angle)
    return followed
