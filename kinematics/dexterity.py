"""Which joints of a leg move its foot at all, and how well they do in a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.chain import Array, Chain
from kinematics.exceptions import SingularLeg

STILL = 1e-9
"""Movement of the foot per radian below this, to the length of the leg, is rounding."""

TRIED = np.array([[0.3, -0.7, 1.1], [-1.3, 0.5, 0.8], [2.1, 1.7, -0.4], [0.9, -2.3, 2.6]])
"""Poses in which a leg is looked at [rad], without a symmetry that could hide a movement."""


def check_joints(chain: Chain, names: Sequence[str]) -> None:
    """Refuse a leg of three joints at most of which one does not move the foot in any pose.

    Args:
        chain: The leg.
        names: Names of the joints, for the message.

    Raises:
        SingularLeg: The foot lies on the axis of a joint, whatever the others do.
    """
    moved = np.linalg.norm(_jacobians(chain, TRIED[:, : len(chain.axes)]), axis=1).max(axis=0)
    idle = tuple(
        name for name, most in zip(names, moved, strict=True) if most <= STILL * chain.size
    )
    if idle:
        raise SingularLeg(
            f"leg: singular in every pose, as joint {idle[0]!r} does not move the foot, which lies "
            "on its axis; choose a foot frame further out, or lock the joint",
            joints=idle,
        )


def dexterity(chain: Chain, angles: Array) -> Array:
    """How well the joints move the foot: Yoshikawa's manipulability, the product of the singular
    values of the Jacobian, over the length of the leg to that power.

    Args:
        chain: The leg.
        angles: Joint angles [rad], shape (n, k).

    Returns:
        Shape (n,); 0 in a singular pose, such as a stretched leg.
    """  # noqa: D205
    strengths = np.linalg.svd(_jacobians(chain, angles), compute_uv=False)
    return np.asarray(np.prod(strengths / chain.size, axis=-1))


def _jacobians(chain: Chain, angles: Array) -> Array:
    """Derivatives of the foot [m/rad], shape (n, 3, k)."""
    _, columns = chain.foot_and_jacobian(np.cos(angles.T), np.sin(angles.T))
    return np.stack(columns).transpose(2, 1, 0)
