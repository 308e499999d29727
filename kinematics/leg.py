"""A leg of a robot: forward kinematics, Jacobians, inverse kinematics and load torques."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from kinematics.chain import Chain, Limits
from kinematics.inverse import (
    ClosedForm,
    InverseSolution,
    Unreachable,
    find_closed_form,
    jumps,
    solve_inverse,
)
from kinematics.robot import TO_LIMIT, Robot, named, read_robot
from planner.arrays import (
    Array,
    Indices,
    Summarised,
    Summary,
    as_path,
    as_positive,
    read_only,
    shown,
)
from planner.exceptions import InvalidInput, InvalidTrajectory, UnsupportedLeg, angle_text

GRAVITY = (0.0, 0.0, -9.80665)
"""Standard gravity [m/s^2] in the frame of the URDF's root link, whose z axis points up."""

FARTHEST = 1e6
"""A position or angle beyond this [m, rad] is a mistake, and its square would lose all digits."""


@dataclass(frozen=True, eq=False, repr=False)
class Leg(Summarised):
    """The joints between two frames of a robot, read from its URDF with :meth:`from_urdf`.

    A foot position is the origin of the foot frame in the base frame. Only the joints between the
    two frames count; the pose of the rest of the robot has no effect. All returned arrays are
    copies. Methods raise InvalidInput for paths that are not finite arrays of their shape.

    Attributes:
        base: Name of the frame of positions.
        foot: Name of the frame that is the foot.
        joint_names: Names of the joints, from the base to the foot.
        limits: Their limits.
        chain: Their constants, from Pinocchio.
        speeds: Their top speeds by the URDF [rad/s], NaN where it has none, shape (k,); or None.
        near: A pose [rad] near which paths start, shape (k,); None to start deep inside the limits.
        robot: The robot with the masses of its links; None where it was not read from a URDF.
    """

    base: str
    foot: str
    joint_names: tuple[str, ...]
    limits: Limits
    chain: Chain
    speeds: Array | None = None
    near: Array | None = None
    robot: Robot | None = None

    def _summarised(self) -> Summary:
        """The joints and their limits."""
        ends = zip(self.joint_names, *np.degrees(self.limits), strict=True)
        return Summary(
            f"Leg from {self.base} to {self.foot}",
            ("", "lower [deg]", "upper [deg]"),
            [(name, f"{lower:.4g}", f"{upper:.4g}") for name, lower, upper in ends],
        )

    @classmethod
    def from_urdf(
        cls,
        path: str | os.PathLike[str],
        *,
        base: str,
        foot: str,
        locked: Mapping[str, float] | None = None,
        near: Mapping[str, float] | None = None,
    ) -> Self:
        """The leg between two frames of the robot that a URDF describes.

        Args:
            path: The URDF; :func:`kinematics.urdf_path` finds the shipped ones. Meshes are not
                needed.
            base: Frame (link or joint) on the way to the foot; the frame of positions.
            foot: Frame whose origin is the foot.
            locked: Positions of locked joints [rad; m for a prismatic one], so that three remain
                of a longer chain.
            near: Angles of joints [rad]: of several poses that bring the foot to the first point of
                a path the nearest to them is chosen. Joints that are not named count as at 0, or at
                the nearer end of their range.

        Raises:
            InvalidInput: The file cannot be read, does not describe a robot or has no such frame,
                or a joint cannot be locked at its position, or is not on the leg.
            UnsupportedLeg: The base is not above the foot, no joint lies between them, or a joint
                that is neither revolute nor continuous, or mimics another joint.
        """
        if not isinstance(path, str | os.PathLike):
            raise InvalidInput(f"path: got {type(path).__name__}, expected that of a URDF file")
        path = Path(path)
        robot = read_robot(path, base=base, foot=foot, locked=locked)
        model, names = robot.model, robot.joint_names
        axes = [_axis(model, joint) for joint in robot.joints]
        placements = [model.jointPlacements[joint] for joint in robot.joints]
        placements[0] = robot.base.placement.inverse() * placements[0]
        limits = _read_limits(path, robot)
        chain = Chain(
            rotations=np.array([placement.rotation for placement in placements]),
            translations=np.array([placement.translation for placement in placements]),
            axes=np.array(axes),
            tip=np.array(robot.foot.placement.translation),
        )
        if not np.all(np.isfinite(np.concatenate([chain.translations.ravel(), chain.tip]))):
            raise InvalidInput(f"{path}: an origin between {base!r} and {foot!r} is not finite")
        _check_against_pinocchio(robot, chain)
        pose = None if near is None else _pose(near, names, limits)
        places = [model.joints[joint].idx_v for joint in robot.joints]
        speeds = np.array(model.velocityLimit)[places]
        speeds[~((speeds > 0.0) & (speeds <= 100.0))] = np.nan  # [rad/s]
        return cls(base, foot, names, limits, chain, read_only(speeds), pose, robot)

    @cached_property
    def closed_form(self) -> ClosedForm | None:
        """The closed form of the inverse, or None where the geometry has none."""
        return find_closed_form(self.chain)

    def foot_positions(self, angles: npt.ArrayLike) -> Array:
        """Foot positions along a path of the joints: forward kinematics.

        Args:
            angles: Joint angles [rad], shape (n, k); limits are not enforced.

        Returns:
            Foot positions in the base frame [m], shape (n, 3), read-only.
        """
        return read_only(np.ascontiguousarray(self.chain.feet(self._angles(angles))))

    def joint_positions(self, angles: npt.ArrayLike) -> Array:
        """Positions of the joints and the foot along a path: the leg as a line to draw.

        Args:
            angles: Joint angles [rad], shape (n, k); limits are not enforced.

        Returns:
            Origins of the joints, from the base, and last the foot, in the base frame [m], shape
            (n, k + 1, 3), read-only.
        """
        points, _ = self.chain.points_and_axes(self._angles(angles))
        return read_only(np.stack(np.broadcast_arrays(*points)).transpose(2, 0, 1).copy())

    def jacobians(self, angles: npt.ArrayLike) -> Array:
        """Derivatives of :meth:`foot_positions` by the joint angles.

        Args:
            angles: Joint angles [rad], shape (n, k); limits are not enforced.

        Returns:
            Derivatives of the position in the base frame [m/rad], shape (n, 3, k), read-only.
        """
        return read_only(self.chain.jacobians(self._angles(angles)))

    def load_torques(
        self,
        angles: npt.ArrayLike,
        *,
        dynamics: bool = False,
        period: float | None = None,
        cyclic: bool = True,
        gravity: Sequence[float] = GRAVITY,
    ) -> Array:
        """Torques of the robot's own links on the joints: ``load`` of :mod:`planner`.

        The torque tau on a joint acts in the direction of positive angles: it is minus the torque
        that holds the pose, or with ``dynamics`` follows the path,

        ``tau = -(M(q) a + C(q, v) v + g(q))``,

        by Pinocchio's recursive Newton-Euler algorithm, with v and a by central differences along
        the path, ``(q_{k+1} - q_{k-1}) / 2T`` and ``(q_{k+1} - 2 q_k + q_{k-1}) / T^2``. All links
        that the joints carry count, also links beyond the foot and beside the leg. The robot's root
        link is at rest, and the joints outside the leg are at their locked positions or else at 0.

        Args:
            angles: Joint angles q [rad], shape (n, k); limits are not enforced.
            dynamics: Whether speeds v and accelerations a count, or gravity alone.
            period: Time between samples [s]; needed with ``dynamics``.
            cyclic: With ``dynamics``: whether the path repeats for ever, or rests before its first
                and after its last sample.
            gravity: Acceleration of falling bodies in the frame of the root link [m/s^2]; by
                default its z axis points up. ``(0, 0, 9.80665)`` is a robot that hangs.

        Returns:
            Torques [N m], shape (n, k), read-only.

        Raises:
            UnsupportedLeg: The URDF has no masses, or the leg was not read from one.
            InvalidInput: ``gravity`` or ``period`` cannot be used.
        """
        import pinocchio

        path = self._angles(angles)
        if self.robot is None:
            raise UnsupportedLeg("the leg has no masses: make it with Leg.from_urdf")
        model = pinocchio.Model(self.robot.model)
        carried = (int(joint) for joint in model.subtrees[self.robot.joints[0]])
        if not any(model.inertias[joint].mass > 0.0 for joint in carried):
            raise UnsupportedLeg(
                f"no link beyond joint {self.joint_names[0]!r} has a mass in the URDF, so the "
                "torques of gravity are unknown; add <inertial> elements to its links, or give the "
                "torques as numbers"
            )
        speeds = accelerations = np.zeros_like(path)
        if dynamics:
            expected = "the time between samples, more than 0 s; speeds and accelerations need it"
            step = as_positive("period", period, expected)
            beside = ((1, 1), (0, 0))
            padded = np.pad(path, beside, mode="wrap" if cyclic else "edge")
            before, after = padded[:-2], padded[2:]
            speeds = (after - before) / (2.0 * step)
            accelerations = (after - 2.0 * path + before) / step**2
        try:
            model.gravity.linear = as_path([gravity], name="", columns=3, unit="")[0]
        except InvalidTrajectory as error:
            raise InvalidInput(
                f"gravity: got {shown(gravity)}, expected three numbers [m/s^2], such as {GRAVITY}"
            ) from error
        data = model.createData()
        places = [model.joints[joint].idx_v for joint in self.robot.joints]
        moving = np.zeros((2, model.nv))
        torques = np.empty_like(path)
        for sample, pose in enumerate(path):
            moving[:, places] = speeds[sample], accelerations[sample]
            coordinates = self.robot.configuration(pose)
            torques[sample] = -pinocchio.rnea(model, data, coordinates, *moving)[places]
        return read_only(torques + 0.0)  # no negative zero

    def load_of_pose(
        self, names: Sequence[str], poses: Array, *, dynamics: bool, period: float, cyclic: bool
    ) -> Callable[[Array], Array]:
        """A load of the pose, as :func:`planner.plan` takes it: torques on joints by their angles.

        Gravity acts in the pose of the angles. Inertia acts along ``poses``: differences of
        predicted angles would not settle. Joints of the leg without a name here follow ``poses``.

        Args:
            names: The joints, in the order of the angles and torques.
            poses: Angles of the leg's joints along the path [rad], shape (n, k).
            dynamics: Whether speeds and accelerations count, or gravity alone.
            period: Time between samples [s].
            cyclic: Whether the path repeats for ever.
        """
        inside = [j for j, name in enumerate(names) if name in self.joint_names]
        places = [self.joint_names.index(names[j]) for j in inside]
        of_path = self.load_torques(poses, dynamics=dynamics, period=period, cyclic=cyclic)
        inertia = of_path - self.load_torques(poses)

        def torques(angles: Array) -> Array:
            pose, loads = poses.copy(), np.zeros(angles.shape)
            pose[:, places] = angles[:, inside]
            loads[:, inside] = (self.load_torques(pose) + inertia)[:, places]
            return loads

        return torques

    def joint_angles(self, foot: npt.ArrayLike, *, unreachable: Unreachable = "raise") -> Array:
        """Joint angles that put the foot at each point of a path: inverse kinematics.

        Args:
            foot: Points in the base frame [m], shape (n, 3).
            unreachable: What to do with points out of reach; see :meth:`inverse`.

        Returns:
            Joint angles within the limits [rad], shape (n, 3), read-only.

        Raises:
            UnreachableFoot: As :meth:`inverse`, and UnsupportedLeg.
        """
        return self.inverse(foot, unreachable=unreachable).angles

    def inverse(
        self, foot: npt.ArrayLike, *, unreachable: Unreachable = "raise"
    ) -> InverseSolution:
        """Joint angles that put the foot at each point of a path, and the remaining distances.

        Where two neighbouring axes of the leg intersect or are parallel the poses are enumerated in
        closed form (10,000 points take some 30 ms); otherwise they are searched for numerically
        from 27 starts (1 ms a point). Each is judged by forward kinematics. If several poses reach
        a point, the pose deepest inside the limits, or nearest to ``near``, is chosen at the first
        point, unless the path jumps from there; at every later point the pose closest to the one
        before. A joint that can turn by a full turn or more starts within half a turn of 0, or of
        ``near``, as far as its limits allow, and takes the short way round from point to point
        (:func:`kinematics.inverse.choose`). :meth:`jumps` returns the remaining jumps.

        Args:
            foot: Points in the base frame [m], shape (n, 3).
            unreachable: What to do with points that the leg cannot reach within its limits:
                "raise" an error that lists them; take the "nearest" point that it can reach; or
                "clamp" the argument of each inverse function, then the angles to the limits, which
                brings the foot somewhere near.

        Returns:
            Angles, which points they reach, and the remaining distances.

        Raises:
            UnreachableFoot: Some points are out of reach, and ``unreachable`` is "raise".
            UnsupportedLeg: The leg has more than three joints, or no closed form to clamp, or a
                joint that never moves the foot.
        """
        points = as_path(foot, name="foot", columns=3, unit="m", largest=FARTHEST)
        return solve_inverse(self, points, unreachable)

    def jumps(self, angles: npt.ArrayLike) -> Indices:
        """Where a path of the joints changes to another pose: :func:`kinematics.inverse.jumps`.

        Args:
            angles: Joint angles [rad], shape (n, k).

        Returns:
            Samples from which the leg would have to leap to the next one.
        """
        return read_only(jumps(self.chain, self._angles(angles)))

    def _angles(self, angles: npt.ArrayLike) -> Array:
        columns = len(self.joint_names)
        return as_path(angles, name="angles", columns=columns, unit="rad", largest=FARTHEST)


def _pose(near: Mapping[str, float], names: tuple[str, ...], limits: Limits) -> Array:
    """The pose with these angles, and all other joints at rest."""
    if not isinstance(near, Mapping):
        raise InvalidInput(f"near: got {type(near).__name__}, expected joints and angles")
    pose = limits.clip(np.zeros(len(names)))
    for name, angle in near.items():
        if name not in names:
            raise InvalidInput(
                f"near: joint {name!r} is not on the leg; its joints: {', '.join(names)}"
            )
        if not abs(angle) <= FARTHEST:
            raise InvalidInput(
                f"near: joint {name!r} at {angle_text(angle)}, expected an angle within "
                f"±{angle_text(FARTHEST)}"
            )
        pose[names.index(name)] = angle
    return read_only(pose)


def _axis(model: Any, joint: int) -> Array:
    """The unit axis of a revolute joint in its own frame; other joints are refused."""
    import pinocchio

    kind = model.joints[joint]
    if kind.nv == 1:
        data = kind.createData()
        kind.calc(data, pinocchio.neutral(model))
        motion = np.array(data.S).ravel()
        length = np.linalg.norm(motion[3:])
        if abs(length - 1.0) < 1e-6:
            return np.asarray(motion[3:] / length, dtype=np.float64)
    raise UnsupportedLeg(
        f"joint {model.names[joint]!r} has no axis to turn about (Pinocchio: {kind.shortname()}); "
        "a leg has revolute and continuous joints only: lock it where it is to stay"
    )


def _read_limits(path: Path, robot: Robot) -> Limits:
    """Joint limits; a continuous joint has none."""
    model, names = robot.model, robot.joint_names
    lower, upper = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for k, joint in enumerate(robot.joints):
        if model.joints[joint].nq == 1:  # a continuous joint is stored as cosine and sine
            index = model.joints[joint].idx_q
            lower[k], upper[k] = model.lowerPositionLimit[index], model.upperPositionLimit[index]
        if not lower[k] <= upper[k]:
            raise InvalidInput(
                f"{path}: joint {names[k]!r} has the limits {lower[k]:g} and "
                f"{upper[k]:g}, expected lower <= upper [rad]"
            )
    if fixed := [names[k] for k in np.flatnonzero(lower == upper)]:
        raise InvalidInput(
            f"{path}: {named(fixed)} cannot turn: lower and upper limit are equal (one left out "
            f"counts as 0); {TO_LIMIT}; lock a joint that is to stay where it is"
        )
    for limit in (lower, upper):
        beyond = np.abs(limit) > 1e6  # [rad]
        limit[beyond] = np.copysign(np.inf, limit[beyond])
    return Limits(read_only(lower), read_only(upper))


def _check_against_pinocchio(robot: Robot, chain: Chain) -> None:
    """Raise an error where the chain's foot disagrees with Pinocchio's at one of three poses."""
    import pinocchio

    data = robot.model.createData()
    for pose in (0.0, 0.7, -1.9):
        angles = pose * np.arange(1.0, len(robot.joints) + 1.0)
        pinocchio.forwardKinematics(robot.model, data, robot.configuration(angles))
        base, end = (
            data.oMi[frame.parentJoint] * frame.placement for frame in (robot.base, robot.foot)
        )
        foot, expected = chain.feet(angles[None])[0], base.actInv(end).translation
        if not np.allclose(foot, expected, rtol=1e-12, atol=1e-12):  # rounding [m]
            raise UnsupportedLeg(
                f"the chain from {robot.base.name!r} to {robot.foot.name!r} disagrees with "
                f"Pinocchio by {np.linalg.norm(foot - expected):.3g} m; please report this robot"
            )


def foot_function(leg: Leg) -> Any:
    """The foot's position and its derivatives as a CasADi function.

    The chain's constants are those of the leg, from Pinocchio; CasADi computes the
    derivatives itself, an independent check of :meth:`Leg.jacobians`.

    Args:
        leg: Any leg.

    Returns:
        ``casadi.Function``: angles (k,) [rad] to foot (3,) [m] and Jacobian (3, k) [m/rad], both in
        the base frame. Its ``map(n)`` takes a whole path, shape (k, n).

    Example:
        >>> from kinematics import Leg, urdf_path
        >>> leg = Leg.from_urdf(urdf_path("reference_leg.urdf"), base="hip", foot="foot")
        >>> foot, jacobian = foot_function(leg)([0.0, 0.2, 1.0])
        >>> foot.shape, jacobian.shape
        ((3, 1), (3, 3))
    """
    import casadi

    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {type(leg).__name__}, expected a kinematics.Leg")
    angles = casadi.SX.sym("angles", len(leg.joint_names))
    each = casadi.vertsplit(angles)
    foot = leg.chain.foot(map(casadi.cos, each), map(casadi.sin, each))
    return casadi.Function(
        "foot", [angles], [foot, casadi.jacobian(foot, angles)], ["angles"], ["foot", "jacobian"]
    )
