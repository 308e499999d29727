"""The torques that gravity and inertia put on the joints of a leg, by Pinocchio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array, read_only
from kinematics.exceptions import InvalidInput, UnsupportedLeg
from kinematics.robot import Robot

GRAVITY = (0.0, 0.0, -9.80665)
"""Standard gravity [m/s^2] in the frame of the URDF's root link, whose z axis points up."""


@dataclass(frozen=True, eq=False)
class Masses:
    """A robot's links with their masses, and the joints of a leg that carry them.

    Attributes:
        robot: The robot; joints outside the leg stay at rest.
        joints: Pinocchio's numbers of the leg's joints, from the base to the foot.
    """

    robot: Robot
    joints: tuple[int, ...]

    def load_torques(
        self,
        angles: Array,
        speeds: Array | None = None,
        accelerations: Array | None = None,
        *,
        gravity: Sequence[float] = GRAVITY,
    ) -> Array:
        """Torques on the joints: minus the inverse dynamics (recursive Newton-Euler).

        ``tau = -(M(q) a + C(q, v) v + g(q))``

        Args:
            angles: Joint angles q [rad], shape (n, k).
            speeds: v [rad/s], shape (n, k); None for 0.
            accelerations: a [rad/s^2], shape (n, k); None for 0.
            gravity: Acceleration of falling bodies in the frame of the root link [m/s^2].

        Returns:
            Torques of the links on each joint in the direction of positive angles [N m], (n, k).

        Raises:
            UnsupportedLeg: No link that the joints move has a mass.
            InvalidInput: Gravity is not three finite numbers.
        """
        import pinocchio

        model = pinocchio.Model(self.robot.model)
        self._check_masses(model)
        model.gravity.linear = _vector(gravity)
        data = model.createData()
        places = [model.joints[joint].idx_v for joint in self.joints]
        moving = np.zeros((2, model.nv))
        torques = np.empty_like(angles)
        for sample, pose in enumerate(angles):
            for row, motion in zip(moving, (speeds, accelerations), strict=True):
                if motion is not None:
                    row[places] = motion[sample]
            coordinates = self.robot.configuration(self.joints, pose)
            torques[sample] = -pinocchio.rnea(model, data, coordinates, *moving)[places]
        return read_only(torques + 0.0)  # no negative zero

    def _check_masses(self, model: Any) -> None:
        """Raise an error where no link that the leg carries has a mass."""
        carried = (int(joint) for joint in model.subtrees[self.joints[0]])
        if not any(model.inertias[joint].mass > 0.0 for joint in carried):
            raise UnsupportedLeg(
                f"no link beyond joint {model.names[self.joints[0]]!r} has a mass in the URDF, so "
                "the torques of gravity are unknown; add <inertial> elements to its links, or give "
                "the torques as numbers"
            )


def central_differences(angles: Array, period: float, *, cyclic: bool) -> tuple[Array, Array]:
    """Speeds and accelerations along a path by central differences.

    ``v_k = (q_{k+1} - q_{k-1}) / 2T`` and ``a_k = (q_{k+1} - 2 q_k + q_{k-1}) / T^2``. A path that
    is no cycle rests before its first and after its last sample.

    Args:
        angles: Joint angles [rad], shape (n, k).
        period: Time T between samples [s].
        cyclic: Whether the path repeats for ever.

    Returns:
        Speeds [rad/s] and accelerations [rad/s^2], shape (n, k) each.
    """
    beside = ((1, 1), (0, 0))
    padded = np.pad(angles, beside, mode="wrap" if cyclic else "edge")
    before, after = padded[:-2], padded[2:]
    return (after - before) / (2.0 * period), (after - 2.0 * angles + before) / period**2


def checked_period(period: object) -> float:
    """The time between samples [s], or InvalidInput."""
    number = period if isinstance(period, int | float | np.number) else math.nan
    if not (math.isfinite(number) and number > 0.0):
        raise InvalidInput(
            f"period: got {period!r}, expected the time between samples, more than 0 s; speeds and "
            "accelerations need it"
        )
    return float(number)


def _vector(gravity: npt.ArrayLike) -> Array:
    """Gravity as an array of three [m/s^2]."""
    try:
        vector = np.asarray(gravity, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise InvalidInput(
            f"gravity: got {gravity!r}, expected three numbers [m/s^2], such as {GRAVITY}"
        )
    return vector
