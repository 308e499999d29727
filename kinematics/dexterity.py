"""Dexterity of a leg in a pose, and a standing pose of high dexterity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.chain import Array, Chain, read_only
from kinematics.exceptions import UnsupportedLeg
from kinematics.inverse import check_joints
from kinematics.leg import Leg

STEPS = 25
"""Grid angles of each joint; an odd number, so that the middle of its range is among them."""

LEAST_DEXTERITY = 0.9
"""Least dexterity of an accepted pose, relative to the best one."""

BELOW = 0.3
"""Least distance of a standing leg's foot below its upper joints, relative to the leg's length.
The hand of an arm need not be below them and stays in its most dexterous pose."""

STILL_DEXTEROUS = 0.7
"""Least dexterity of a pose with the foot below the hip, relative to the best pose."""

MOST_GRID_JOINTS = 3
"""Most joints for a search over the whole grid: 25 angles to this power."""


def standing_pose(leg: Leg) -> Array:
    """A bent leg with its foot below the hip, z of the base frame pointing up.

    Of the poses with nearly the best dexterity the one nearest to the middle of the limits, with
    the foot then moved to below the joint before the last. Where that is impossible, as for an arm,
    the pose stays. If the leg has ``near``, a pose to start from, this is returned.

    Args:
        leg: A leg of three joints at most.

    Returns:
        Angles [rad], read-only, shape (k,); rounded to a degree where no limit is nearer.

    Raises:
        UnsupportedLeg: The leg has more joints and no ``near``.
        SingularLeg: One of its joints never moves the foot.
    """
    if leg.near is not None:
        return leg.near
    count = len(leg.joint_names)
    if count > MOST_GRID_JOINTS:
        raise UnsupportedLeg(
            f"a standing pose is sought for {MOST_GRID_JOINTS} joints at most, this leg has "
            f"{count}: lock the others, or give the angles that they are near"
        )
    lower, upper = leg.limits.central
    check_joints(leg.chain, leg.joint_names)
    steps = [np.linspace(*ends, STEPS) for ends in zip(lower, upper, strict=True)]
    poses = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, count)
    quality = dexterity(leg.chain, poses)
    away = np.linalg.norm(poses - 0.5 * (lower + upper), axis=1)
    well = quality >= LEAST_DEXTERITY * quality.max()
    keys = (*-poses.T, np.where(well, away, np.inf))
    best = poses[np.lexsort(np.round(keys, 6))[0]]
    best = _below_hip(leg, best, STILL_DEXTEROUS * float(quality.max()))
    return read_only(leg.limits.clip(np.radians(np.round(np.degrees(best)) + 0.0)))


def _below_hip(leg: Leg, pose: Array, least: float) -> Array:
    """The pose with the foot straight below the joint before the last, or else unchanged."""
    candidate = pose
    for _ in range(2):  # that joint moves with the joints above it
        points = leg.joint_positions(candidate[None])[0]
        hip, foot = points[max(len(pose) - 2, 0)], points[-1]
        if hip[2] - foot[2] < BELOW * leg.chain.size:
            return pose
        target = np.array([[hip[0], hip[1], foot[2]]])
        solution = replace(leg, near=candidate).inverse(target, unreachable="nearest")
        candidate = solution.angles[0]
        if dexterity(leg.chain, candidate[None])[0] < least:
            return pose
    return candidate


def dexterity(chain: Chain, angles: Array) -> Array:
    """Yoshikawa's manipulability, the product of the singular values of the Jacobian, over the
    length of the leg to the power of their number.

    Args:
        chain: The leg.
        angles: Joint angles [rad], shape (n, k).

    Returns:
        Shape (n,); 0 in a singular pose, such as a stretched leg.
    """  # noqa: D205
    jacobians = chain.jacobians(angles) / chain.size
    if jacobians.shape[-1] == jacobians.shape[-2]:
        return np.asarray(np.abs(np.linalg.det(jacobians)))  # a tenth of the time
    return np.asarray(np.prod(np.linalg.svd(jacobians, compute_uv=False), axis=-1))
