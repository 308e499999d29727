"""Read the chain between two frames of a robot from its URDF, with Pinocchio."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kinematics.chain import Array, Chain, read_only
from kinematics.exceptions import InvalidInput, InvalidUrdf, UnsupportedLeg
from kinematics.limits import Limits
from kinematics.load import Masses
from kinematics.robot import TO_LIMIT, Robot, find_frame, joints_between, named, read_robot

AGREEMENT = 1e-12
"""The chain's foot must agree with Pinocchio's to this [m], relative to its size beyond 1 m."""

UNLIMITED = 1e6
"""A limit beyond this [rad] means no limit."""

FASTEST = 100.0
"""A speed beyond this [rad/s] means an unknown speed."""


class ChainInRobot(NamedTuple):
    """A chain, with the URDF's data of its joints.

    Attributes:
        chain: The constants.
        joint_names: Names of the joints, from the base to the foot.
        limits: Their limits.
        speeds: Their top speeds [rad/s], NaN where the URDF has none, shape (k,).
        masses: Links that the joints carry.
    """

    chain: Chain
    joint_names: tuple[str, ...]
    limits: Limits
    speeds: Array
    masses: Masses


def read_chain(
    path: str | os.PathLike[str],
    *,
    base: str,
    foot: str,
    locked: Mapping[str, float] | None = None,
) -> ChainInRobot:
    """The joints between two frames of the robot that a URDF describes.

    Args:
        path: The URDF; meshes are not needed.
        base: Frame (link or joint) on the chain that leads to the foot.
        foot: Frame whose origin is the foot.
        locked: Positions of locked joints [rad; m for a prismatic one].

    Returns:
        The chain, checked against Pinocchio's own forward kinematics at three poses.

    Raises:
        InvalidUrdf: The file cannot be read or does not describe a robot.
        UnknownFrame: The robot has no such frame.
        UnsupportedLeg: The base is not above the foot, no joint lies between them, or a joint that
            is neither revolute nor continuous, or mimics another joint.
        InvalidInput: A joint cannot be locked at its position.
    """
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise InvalidInput(f"path: got {type(path).__name__}, expected that of a URDF file")
    path = Path(path)
    robot = read_robot(path, locked=locked)
    model = robot.model
    start = find_frame(model, base, role="base")
    end = find_frame(model, foot, role="foot")
    between = joints_between(model, start, end)
    joints = [joint for joint in between if joint not in robot.locked]
    names = tuple(str(model.names[joint]) for joint in joints)
    if not names:
        raise UnsupportedLeg(f"every joint between {base!r} and {foot!r} is locked; leave one out")
    if copies := [name for name in names if name in robot.mimics]:
        raise UnsupportedLeg(
            f"joint {copies[0]!r} between {base!r} and {foot!r} mimics another; every joint of a "
            "leg must be driven: lock it, remove its <mimic> element, or choose a foot above it"
        )
    axes = [_axis(model, joint) for joint in joints]
    *placements, tip = _placements(robot, between, start, end)
    limits = _read_limits(path, model, joints)
    chain = Chain(
        rotations=np.array([placement.rotation for placement in placements]),
        translations=np.array([placement.translation for placement in placements]),
        axes=np.array(axes),
        tip=np.array(tip.translation),
    )
    if not np.all(np.isfinite(np.concatenate([chain.translations.ravel(), chain.tip]))):
        raise InvalidUrdf(path, f"an origin between {base!r} and {foot!r} is not finite")
    _check_against_pinocchio(robot, chain, start, end, joints)
    masses = Masses(robot, tuple(joints))
    return ChainInRobot(chain, names, limits, _read_speeds(model, joints), masses)


def _placements(robot: Robot, between: list[int], start: Any, end: Any) -> list[Any]:
    """Placements of the driven joints, each in the one before it, and of the foot in the last."""
    placements = []
    reached = start.placement.inverse()
    for joint in between:
        reached = reached * robot.model.jointPlacements[joint]
        if joint in robot.locked:
            kind = robot.model.joints[joint]
            data = kind.createData()
            kind.calc(data, robot.rest)
            reached = reached * data.M
        else:
            placements.append(reached)
            reached = type(reached).Identity()
    return [*placements, reached * end.placement]


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


def _read_limits(path: Path, model: Any, joints: list[int]) -> Limits:
    """Joint limits; a continuous joint has none."""
    lower, upper = np.full(len(joints), -np.inf), np.full(len(joints), np.inf)
    for k, joint in enumerate(joints):
        if model.joints[joint].nq == 1:  # a continuous joint is stored as cosine and sine
            index = model.joints[joint].idx_q
            lower[k], upper[k] = model.lowerPositionLimit[index], model.upperPositionLimit[index]
        if not lower[k] <= upper[k]:
            raise InvalidUrdf(
                path,
                f"joint {model.names[joint]!r} has the limits {lower[k]:g} and {upper[k]:g}, "
                "expected lower <= upper [rad]",
            )
    if fixed := [str(model.names[joints[k]]) for k in np.flatnonzero(lower == upper)]:
        raise InvalidUrdf(
            path,
            f"{named(fixed)} cannot turn: lower and upper limit are equal (one left out counts as "
            f"0); {TO_LIMIT}; lock a joint that is to stay where it is",
        )
    for limit in (lower, upper):
        limit[np.abs(limit) > UNLIMITED] = np.copysign(np.inf, limit[np.abs(limit) > UNLIMITED])
    return Limits(read_only(lower), read_only(upper))


def _read_speeds(model: Any, joints: list[int]) -> Array:
    """Top speeds [rad/s], read-only, shape (k,); NaN where the URDF has no plausible one."""
    speeds = np.array([model.velocityLimit[model.joints[joint].idx_v] for joint in joints])
    return read_only(np.where((speeds > 0.0) & (speeds <= FASTEST), speeds, np.nan))


def _check_against_pinocchio(
    robot: Robot, chain: Chain, start: Any, end: Any, joints: list[int]
) -> None:
    """Raise an error where the chain's foot disagrees with Pinocchio's."""
    import pinocchio

    model = robot.model
    data = model.createData()
    for pose in (0.0, 0.7, -1.9):
        angles = pose * np.arange(1.0, len(joints) + 1.0)
        pinocchio.forwardKinematics(model, data, robot.configuration(joints, angles))
        from_base = (data.oMi[start.parentJoint] * start.placement).inverse()
        expected = (from_base * data.oMi[end.parentJoint] * end.placement).translation
        foot = chain.foot(np.cos(angles), np.sin(angles))[:, 0]
        if not np.allclose(foot, expected, rtol=AGREEMENT, atol=AGREEMENT):
            raise UnsupportedLeg(
                f"the chain from {start.name!r} to {end.name!r} disagrees with Pinocchio by "
                f"{np.linalg.norm(foot - expected):.3g} m; please report this robot"
            )
