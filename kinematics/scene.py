"""A robot to draw: the shapes of its URDF in Pinocchio, with the shapes of one leg apart."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np

from kinematics.robot import Robot, captured_stderr, read_robot
from planner.arrays import Array, read_only
from planner.exceptions import InvalidInput

MOST_BYTES = 32 * 2**20  # largest readable mesh [bytes]


@dataclass(frozen=True, eq=False)
class Scene:
    """The robot around a leg, created by :meth:`from_urdf`."""

    robot: Robot
    still: Any  # Pinocchio's geometry model of the shapes that the leg's joints do not move
    moving: Any  # geometry model of the shapes that they move
    to_base: Array  # from Pinocchio's world to the base frame, shape (4, 4), read-only

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

        If no link of the leg has a shape that can be drawn, bones from joint to joint replace
        them. Missing or unreadable meshes are omitted: they are sought beside the URDF, and
        ``package://a/b`` as ``a/b`` above it or in a folder of ROS packages. Arguments and errors
        are those of :meth:`kinematics.Leg.from_urdf`.
        """
        import pinocchio

        path = Path(path)
        robot = read_robot(path, base=base, foot=foot, locked=locked)
        model = robot.model
        still, moving = pinocchio.GeometryModel(), pinocchio.GeometryModel()
        for shape in _read_shapes(path, model).geometryObjects:
            shape.meshPath, shape.meshScale = "", np.ones(3)  # it has been read, and scaled
            moves = any(joint in robot.joints for joint in model.supports[shape.parentJoint])
            (moving if moves else still).addGeometryObject(shape)
        if not moving.ngeoms:
            for bone in _bones(robot):
                moving.addGeometryObject(bone)
        data = model.createData()
        pinocchio.forwardKinematics(model, data, robot.rest)
        to_world = data.oMi[robot.base.parentJoint] * robot.base.placement
        return cls(robot, still, moving, read_only(to_world.inverse().homogeneous))

    def places(self, angles: Array) -> Array:
        """Middles of all shapes, the moving ones last, in the base frame [m], at angles (k,)."""
        import pinocchio

        data = self.robot.model.createData()
        pinocchio.forwardKinematics(self.robot.model, data, self.robot.configuration(angles))
        to_world = [
            (data.oMi[shape.parentJoint] * shape.placement).translation
            for shapes in (self.still, self.moving)
            for shape in shapes.geometryObjects
        ]
        return read_only(np.array(to_world) @ self.to_base[:3, :3].T + self.to_base[:3, 3])


def _read_shapes(path: Path, model: Any) -> Any:
    """Pinocchio's geometry model of the shapes that can be drawn."""
    import coal
    import pinocchio

    root = ElementTree.parse(BytesIO(path.read_bytes())).getroot()
    meshes = coal.CachedMeshLoader()
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            solid = next(iter(visual.find("geometry") or ()), None)
            drawn = solid is not None and solid.tag in ("box", "cylinder", "sphere")
            if solid is not None and solid.tag == "mesh":
                file = _find_mesh(path, solid.get("filename", ""))
                with suppress(ValueError, RuntimeError):  # of a file that Pinocchio cannot read
                    drawn = file is not None and bool(meshes.load(str(file), np.ones(3)).num_tris)
                solid.set("filename", str(file))
            if not drawn:
                link.remove(visual)
    for colour in root.iter("color"):  # the parser omits shapes with other values
        with suppress(ValueError):
            parts = np.array(colour.get("rgba", "").split(), dtype=float)
            colour.set("rgba", " ".join(map(str, np.clip(parts, 0.0, 1.0))))
    text = ElementTree.tostring(root, encoding="unicode")
    with captured_stderr() as complaints:
        shapes = pinocchio.buildGeomFromUrdfString(
            model, text, pinocchio.GeometryType.VISUAL, None, None, meshes
        )
        if wrong := complaints():
            raise InvalidInput(f"{path}: a shape cannot be drawn: {wrong[0]}")
    return shapes


def _find_mesh(path: Path, name: str) -> Path | None:
    """The file of a mesh, or None where none has a readable format and size."""
    relative, folders = name.removeprefix("file://"), [path.resolve().parent]
    if name.startswith("package://"):
        relative = name.removeprefix("package://")
        named, prefixes = (
            [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]
            for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
        )
        folders = [*path.resolve().parents, *named, *(each / "share" for each in prefixes)]
    for folder in folders:
        file = folder / relative
        fits = file.suffix.lower() in (".stl", ".obj", ".dae") and file.is_file()
        if fits and file.stat().st_size <= MOST_BYTES:
            return file
    return None


def _bones(robot: Robot) -> list[Any]:
    """A bone from every joint of the leg to the next one, and from the last to the foot."""
    import coal
    import pinocchio

    model = robot.model
    kinds = (pinocchio.FrameType.JOINT, pinocchio.FrameType.FIXED_JOINT)
    ends = [
        *(each for each in model.frames if each.name in robot.between and each.type in kinds),
        robot.foot,
    ]
    pieces = []
    for start, end in pairwise(ends):
        joint = start.parentJoint
        place = (
            end.placement if end.parentJoint == joint else model.jointPlacements[end.parentJoint]
        )
        pieces.append((start, np.array(place.translation - start.placement.translation)))
    radius = 0.05 * sum(float(np.linalg.norm(tip)) for _, tip in pieces)
    bones = []
    for start, tip in pieces:
        turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), tip).matrix()
        middle = start.placement.translation + tip / 2.0
        half_way = pinocchio.SE3(turn if tip.any() else np.eye(3), middle)
        ball, bone = coal.Sphere(1.4 * radius), coal.Cylinder(radius, float(np.linalg.norm(tip)))
        for name, solid, placement in (("ball", ball, start.placement), ("bone", bone, half_way)):
            shape = pinocchio.GeometryObject(
                f"{start.name} {name}", start.parentJoint, placement, solid
            )
            shape.meshColor = np.array([0.7, 0.72, 0.75, 1.0])
            bones.append(shape)
    return bones
