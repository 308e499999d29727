"""A leg of a robot: where its foot is, how it moves, and which angles put it where it should be."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array, Chain, read_only
from kinematics.closed_form import ClosedForm, find_closed_form
from kinematics.exceptions import InvalidPath
from kinematics.inverse import InverseSolution, Unreachable, solve_inverse
from kinematics.limits import Limits
from kinematics.read_urdf import read_chain

FARTHEST = 1e6
"""A position or angle beyond this [m, rad] is a mistake, and its square would lose all digits."""


@dataclass(frozen=True, eq=False)
class Leg:
    """The joints between two frames of a robot, taken from its URDF with :meth:`from_urdf`.

    Foot positions are those of the foot frame's origin in the base frame. Only the joints between
    the two frames count; where the rest of the robot is makes no difference. All arrays that come
    back are copies of their own.

    Attributes:
        base: Name of the frame that positions are given in.
        foot: Name of the frame that is the foot.
        joint_names: Names of the joints, from the base to the foot.
        limits: Their limits.
        chain: Their constants, checked against Pinocchio.
    """

    base: str
    foot: str
    joint_names: tuple[str, ...]
    limits: Limits
    chain: Chain

    @classmethod
    def from_urdf(cls, path: str | os.PathLike[str], *, base: str, foot: str) -> Self:
        """The leg between two frames of the robot that a URDF describes.

        Args:
            path: The URDF; :func:`kinematics.urdf_path` finds those that are shipped. Meshes are
                not needed.
            base: Frame (link or joint) on the way to the foot; positions are given in it.
            foot: Frame whose origin is the foot.

        Raises:
            InvalidUrdf: The file cannot be read or does not describe a robot.
            UnknownFrame: The robot has no such frame.
            UnsupportedLeg: The base is not above the foot, no joint lies between them, or one that
                is neither revolute nor continuous, or one that mimics another.
        """
        chain, names, limits = read_chain(path, base=base, foot=foot)
        return cls(base, foot, names, limits, chain)

    @cached_property
    def closed_form(self) -> ClosedForm | None:
        """The closed form of the inverse, or None where the geometry has none."""
        return find_closed_form(self.chain)

    def foot_positions(self, angles: npt.ArrayLike) -> Array:
        """Where the foot is along a path of the joints: forward kinematics.

        Args:
            angles: Joint angles [rad], shape (n, k); limits are not enforced.

        Returns:
            Foot positions in the base frame [m], shape (n, 3), read-only.

        Raises:
            InvalidPath: ``angles`` is not a finite array of shape (n, k).
        """
        turned = self._angles(angles).T
        return read_only(np.ascontiguousarray(self.chain.foot(np.cos(turned), np.sin(turned)).T))

    def jacobians(self, angles: npt.ArrayLike) -> Array:
        """How the foot moves when the joints do: derivatives of :meth:`foot_positions`.

        Args:
            angles: Joint angles [rad], shape (n, k); limits are not enforced.

        Returns:
            Derivatives of the position in the base frame [m/rad], shape (n, 3, k), read-only.

        Raises:
            InvalidPath: ``angles`` is not a finite array of shape (n, k).
        """
        turned = self._angles(angles).T
        _, columns = self.chain.foot_and_jacobian(np.cos(turned), np.sin(turned))
        return read_only(np.ascontiguousarray(np.stack(columns).transpose(2, 1, 0)))

    def joint_angles(self, foot: npt.ArrayLike, *, unreachable: Unreachable = "raise") -> Array:
        """Joint angles that put the foot at each point of a path: inverse kinematics.

        Args:
            foot: Points in the base frame [m], shape (n, 3).
            unreachable: What to do with points out of reach; see :meth:`inverse`.

        Returns:
            Joint angles within the limits [rad], shape (n, 3), read-only.

        Raises:
            InvalidPath: ``foot`` is not a finite array of shape (n, 3).
            UnreachableFoot: Some points are out of reach, and ``unreachable`` is "raise".
            UnsupportedLeg: The leg has not three joints, or no closed form to clamp.
        """
        return self.inverse(foot, unreachable=unreachable).angles

    def inverse(
        self, foot: npt.ArrayLike, *, unreachable: Unreachable = "raise"
    ) -> InverseSolution:
        """Joint angles that put the foot at each point of a path, and how near they bring it.

        Where two neighbouring axes of the leg intersect or are parallel the poses are enumerated in
        closed form (10,000 points take some 30 ms); otherwise they are searched for numerically
        (1 ms a point). Each is judged by forward kinematics. Several poses may reach a point: at
        the first point the one deepest inside the limits is taken, at every later point the one
        closest to the pose before it (:func:`kinematics.branches.choose`).

        Args:
            foot: Points in the base frame [m], shape (n, 3).
            unreachable: What to do with points that the leg cannot reach within its limits:
                "raise" an error that lists them; take the "nearest" point that it can reach; or
                "clamp" the argument of each inverse function, then the angles to the limits, which
                brings the foot somewhere near.

        Returns:
            Angles, which points they reach, and the distance that is left.

        Raises:
            InvalidPath: ``foot`` is not a finite array of shape (n, 3).
            UnreachableFoot: Some points are out of reach, and ``unreachable`` is "raise".
            UnsupportedLeg: The leg has not three joints, or no closed form to clamp.
        """
        points = _as_path(foot, name="foot", columns=3, unit="m")
        return solve_inverse(
            self.chain, self.limits, self.closed_form, points, unreachable=unreachable
        )

    def _angles(self, angles: npt.ArrayLike) -> Array:
        return _as_path(angles, name="angles", columns=len(self.joint_names), unit="rad")


def _as_path(values: npt.ArrayLike, *, name: str, columns: int, unit: str) -> Array:
    """Copy ``values`` into a finite (n, columns) array, or say why they are none."""
    try:
        given = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise InvalidPath(f"{name}: {error}; expected shape (n, {columns}) [{unit}]") from error
    if given.dtype.kind not in "iuf":
        raise InvalidPath(f"{name}: got an array of {given.dtype}, expected real numbers [{unit}]")
    if given.ndim != 2 or given.shape[1] != columns:
        hint = f"; for a single row pass [{name}]" if given.shape == (columns,) else ""
        raise InvalidPath(
            f"{name}: got shape {given.shape}, expected (n, {columns}) [{unit}]{hint}"
        )
    bad = np.flatnonzero(~np.all(np.abs(given) <= FARTHEST, axis=1))
    if bad.size:
        raise InvalidPath(
            f"{name}: {bad.size} of {len(given)} rows are not finite or beyond {FARTHEST:g} "
            f"{unit}: first index {bad[0]} ({given[bad[0]]}); mend or remove them first"
        )
    return np.array(given, dtype=np.float64)
