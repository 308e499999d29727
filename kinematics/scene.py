"""A robot to look at: what it looks like, and where its links are as one leg moves."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from kinematics.chain import Array, read_only
from kinematics.robot import Robot, find_frame, joints_between, read_robot
from kinematics.shapes import Shape, read_shapes

THICKNESS = 0.05
"""Radius of the bones of a leg without shapes, to its length."""


@dataclass(frozen=True, eq=False)
class Body:
    """A link of the robot.

    Attributes:
        name: Its name.
        moves: Whether the leg's joints move it.
        shapes: What it looks like, in its own frame.
    """

    name: str
    moves: bool
    shapes: tuple[Shape, ...]


@dataclass(frozen=True, eq=False)
class Scene:
    """The robot around a leg; :meth:`from_urdf` makes it.

    Attributes:
        bodies: The links that can be seen.
        joint_names: The joints of the leg, from the base to the foot.
    """

    bodies: tuple[Body, ...]
    joint_names: tuple[str, ...]
    _robot: Robot
    _joints: list[int]
    _base: Any
    _frames: tuple[Any, ...]

    @classmethod
    def from_urdf(
        cls,
        path: str | os.PathLike[str],
        *,
        base: str,
        foot: str,
        locked: Mapping[str, float] | None = None,
    ) -> Self:
        """The scene of the leg between two frames of the robot that a URDF describes.

        Where no link of the leg has a shape that can be drawn, bones from joint to joint stand for
        them. Takes what :meth:`kinematics.Leg.from_urdf` takes, and raises what that raises.
        """
        path = Path(path)
        robot = read_robot(path, locked=locked)
        model = robot.model
        start, end = find_frame(model, base, role="base"), find_frame(model, foot, role="foot")
        between = joints_between(model, start, end)
        joints = [joint for joint in between if joint not in robot.locked]
        bodies, frames = [], []
        for name, shapes in read_shapes(path).items():
            frame = find_frame(model, name, role="link")
            moves = any(joint in joints for joint in model.supports[frame.parentJoint])
            if shapes:
                bodies.append(Body(name, moves, shapes))
                frames.append(frame)
        if not any(body.moves for body in bodies):
            for body, frame in _bones(model, between, end):
                bodies.append(body)
                frames.append(frame)
        names = tuple(str(model.names[joint]) for joint in joints)
        return cls(tuple(bodies), names, robot, joints, start, tuple(frames))

    def placements(self, angles: Array) -> Array:
        """Where every body is along a path of the leg's joints, the other joints at rest.

        Args:
            angles: Angles of the leg's joints [rad], shape (n, k).

        Returns:
            From each body's frame to the base frame, shape (n, bodies, 4, 4), read-only.
        """
        import pinocchio

        model = self._robot.model
        data = model.createData()
        placements = np.empty((len(angles), len(self.bodies), 4, 4))
        for pose, row in zip(placements, angles, strict=True):
            coordinates = self._robot.configuration(self._joints, row)
            pinocchio.forwardKinematics(model, data, coordinates)
            to_base = (data.oMi[self._base.parentJoint] * self._base.placement).inverse()
            for place, frame in zip(pose, self._frames, strict=True):
                place[:] = (to_base * data.oMi[frame.parentJoint] * frame.placement).homogeneous
        return read_only(placements)


def _bones(model: Any, joints: list[int], end: Any) -> list[tuple[Body, Any]]:
    """A bone from every joint of the leg to the next one, and from the last to the foot."""
    tips = [np.array(model.jointPlacements[joint].translation) for joint in joints[1:]]
    tips.append(np.array(end.placement.translation))
    radius = THICKNESS * sum(float(np.linalg.norm(tip)) for tip in tips)
    bones = []
    for joint, tip in zip(joints, tips, strict=True):
        frame = next(frame for frame in model.frames if frame.name == model.names[joint])
        ball = Shape("sphere", (1.4 * radius,), read_only(np.eye(4)))
        bone = Shape("cylinder", (radius, float(np.linalg.norm(tip))), read_only(_along(tip)))
        bones.append((Body(f"{frame.name} bone", True, (ball, bone)), frame))
    return bones


def _along(tip: Array) -> Array:
    """The frame half way to ``tip``, its z axis in that direction."""
    length = float(np.linalg.norm(tip))
    placement = np.eye(4)
    placement[:3, 3] = tip / 2.0
    if length > 0.0:
        z = tip / length
        side = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
        x = side / np.linalg.norm(side)
        placement[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return placement
