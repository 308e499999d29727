"""What a robot looks like: the visual shapes of its links, from its URDF."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array, read_only
from kinematics.exceptions import InvalidUrdf

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each from 0 to 1."""

PLAIN: Colour = (0.7, 0.72, 0.75, 1.0)
"""Colour of a shape without a material."""

MESHES = (".stl", ".obj", ".dae")
"""Formats of meshes that are taken up."""

MOST_BYTES = 32 * 2**20
"""Largest mesh that is taken up [bytes]."""


class Surface(NamedTuple):
    """Triangles in space.

    Attributes:
        vertices: Their corners [m], shape (v, 3), read-only.
        faces: The three corners of each, shape (f, 3), read-only.
    """

    vertices: Array
    faces: npt.NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid, fixed to a link.

    Attributes:
        kind: What it is.
        size: Edges of a box; radius and length, along z, of a cylinder; radius of a sphere [m];
            nothing for a mesh.
        placement: From its own frame to the link's, shape (4, 4), read-only.
        colour: Its colour.
        surface: Of a mesh; None for other kinds.
    """

    kind: Literal["box", "cylinder", "sphere", "mesh"]
    size: tuple[float, ...]
    placement: Array
    colour: Colour = PLAIN
    surface: Surface | None = None


def read_shapes(path: Path) -> dict[str, tuple[Shape, ...]]:
    """The visual shapes of every link of a robot; meshes that cannot be found are left out.

    Args:
        path: The URDF. Meshes are looked for below its folder and those above: ``package://a/b`` is
            ``a/b`` below one of them, or below a folder where ROS keeps its packages.

    Raises:
        InvalidUrdf: The file cannot be read, or a shape cannot be.
    """
    try:
        root = ElementTree.parse(BytesIO(path.read_bytes())).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise InvalidUrdf(path, f"cannot be read ({error}); expected a URDF file") from error
    materials = {
        material.get("name", ""): colour
        for material in root.findall("material")
        if (colour := _colour(path, material)) is not None
    }
    return {
        link.get("name", ""): tuple(
            shape
            for visual in link.findall("visual")
            if (shape := _shape(path, visual, materials)) is not None
        )
        for link in root.findall("link")
    }


@lru_cache(maxsize=64)
def read_mesh(file: Path) -> Surface | None:
    """The surface in a mesh's file, by the library that Pinocchio has for it; None if it cannot."""
    try:
        import coal

        solid = coal.MeshLoader().load(str(file), np.ones(3))
    except (ImportError, ValueError, RuntimeError):
        return None
    triangles = (solid.tri_indices(number) for number in range(solid.num_tris))
    faces = np.array([(face[0], face[1], face[2]) for face in triangles], dtype=np.uint32)
    if not len(faces):
        return None
    return Surface(read_only(np.array(solid.vertices(), dtype=np.float64)), read_only(faces))


def _shape(path: Path, visual: ElementTree.Element, materials: dict[str, Colour]) -> Shape | None:
    """The shape of a visual element; None where it is none that can be drawn."""
    geometry = visual.find("geometry")
    solid = next(iter(geometry), None) if geometry is not None else None
    if solid is None:
        return None
    placement = _placement(path, visual.find("origin"))
    material = visual.find("material")
    colour = PLAIN
    if material is not None:
        colour = _colour(path, material) or materials.get(material.get("name", ""), PLAIN)
    match solid.tag:
        case "box":
            return Shape("box", _numbers(path, solid, "size", 3), placement, colour)
        case "cylinder":
            radius, length = (_numbers(path, solid, name, 1)[0] for name in ("radius", "length"))
            return Shape("cylinder", (radius, length), placement, colour)
        case "sphere":
            return Shape("sphere", _numbers(path, solid, "radius", 1), placement, colour)
        case "mesh":
            file = _find_mesh(path, solid.get("filename", ""))
            surface = None if file is None else read_mesh(file)
            if surface is None:
                return None
            scale = np.array(_numbers(path, solid, "scale", 3, default="1 1 1"))
            surface = Surface(read_only(surface.vertices * scale), surface.faces)
            return Shape("mesh", (), placement, colour, surface)
    return None


def _find_mesh(path: Path, name: str) -> Path | None:
    """The file of a mesh, where there is one of a format and size that can be taken up."""
    package = name.startswith("package://")
    relative = name.removeprefix("package://").removeprefix("file://")
    folders = [*path.resolve().parents, *_package_folders()] if package else [path.resolve().parent]
    for folder in folders:
        file = folder / relative
        fits = file.suffix.lower() in MESHES and file.is_file()
        if fits and file.stat().st_size <= MOST_BYTES:
            return file
    return None


def _package_folders() -> list[Path]:
    """Where ROS keeps packages: ``ROS_PACKAGE_PATH``, and for ROS 2 ``AMENT_PREFIX_PATH``."""
    named, shared = (
        [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]
        for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
    )
    return [*named, *(each / "share" for each in shared)]


def _colour(path: Path, material: ElementTree.Element) -> Colour | None:
    colour = material.find("color")
    if colour is None:
        return None
    red, green, blue, opacity = _numbers(path, colour, "rgba", 4)
    return red, green, blue, opacity


def _placement(path: Path, origin: ElementTree.Element | None) -> Array:
    """The frame of an ``<origin>``: turned about x, y and z, in this order, and then moved."""
    placement = np.eye(4)
    if origin is not None:
        roll, pitch, yaw = _numbers(path, origin, "rpy", 3, default="0 0 0")
        turns = [_turn(axis, angle) for axis, angle in ((2, yaw), (1, pitch), (0, roll))]
        placement[:3, :3] = turns[0] @ turns[1] @ turns[2]
        placement[:3, 3] = _numbers(path, origin, "xyz", 3, default="0 0 0")
    return read_only(placement)


def _turn(axis: int, angle: float) -> Array:
    """The rotation about a coordinate axis."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[one, one] = turn[other, other] = math.cos(angle)
    turn[other, one] = math.sin(angle)
    turn[one, other] = -turn[other, one]
    return turn


def _numbers(
    path: Path, element: ElementTree.Element, name: str, count: int, *, default: str = ""
) -> tuple[float, ...]:
    text = element.get(name, default)
    try:
        numbers = tuple(float(part) for part in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise InvalidUrdf(
            path, f"<{element.tag} {name}={text!r}>: expected {count} numbers separated by spaces"
        )
    return numbers
