"""A robot in Meshcat whose leg moves as desired, without a plan, and as planned; and its page."""

from __future__ import annotations

import base64
import re
import uuid
import warnings
from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from planner.arrays import Array
from planner.exceptions import importing
from planner.report.figure import DESIRED, FOOT_OPTIMAL, GRID
from planner.report.plan_page import DIRECT
from planner.report.wording import environment

if TYPE_CHECKING:
    from kinematics.scene import Scene

LOOKS = ((DESIRED, 0.55), (DIRECT, 0.45), (FOOT_OPTIMAL._replace(label="planned"), 1.0))
"""Looks and opacities of the desired motion, that without a plan and the planned one.

An opacity of 1 hides what is behind the leg.
"""

SIDES = 8
"""Sides of a foot's trace, which is a tube: browsers draw lines one pixel wide."""


def import_meshcat() -> Any:
    """The package; its deprecation warnings are ignored."""
    with importing("the view in Meshcat", "meshcat"), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import meshcat
        import meshcat.animation
        import meshcat.geometry
    return meshcat


class Recording:
    """A window for a ``meshcat.Visualizer`` that records commands, with random names numbered."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.commands: list[bytes] = []
        self._names: dict[bytes, bytes] = {}

    def send(self, command: Any) -> None:
        """Keep a command."""
        import umsgpack

        def numbered(name: re.Match[bytes]) -> bytes:
            number = uuid.UUID(int=len(self._names))
            return self._names.setdefault(name[0], str(number).encode())  # of the same length

        name = rb"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}"
        self.commands.append(re.sub(name, numbered, umsgpack.packb(command.lower())))


def scene_page(
    scene: Scene,
    angles: Sequence[Array],
    feet: Sequence[Array],
    *,
    period: float,
    cyclic: bool,
    title: str,
) -> str:
    """The page with the robot and its leg's motions, played for ever in real time.

    For each of :data:`LOOKS` the angles [rad], (n, k), and the foot in the base frame [m], (n, 3).
    Meshcat's own ``static_html`` needs a server, and has no certain order of commands.
    """
    meshcat, recording = import_meshcat(), Recording()
    viewer = meshcat.Visualizer(window=recording)
    stride = -(-len(angles[0]) // 1000)  # of longer motions every second sample is shown
    places = scene.places(angles[0][0])
    thickness = 0.008 * (float(np.linalg.norm(np.ptp(places, axis=0))) or 1.0)  # of the traces
    rest = scene.robot.configuration(angles[0][0])
    _show(viewer, "robot", scene, scene.still, None).display(rest)
    animation = meshcat.animation.Animation(default_framerate=1.0 / (stride * period))
    for (role, opacity), own, foot in zip(LOOKS, angles, feet, strict=True):
        colour = int(role.light.removeprefix("#"), 16)
        parts = [part / 255.0 for part in colour.to_bytes(3)]  # red, green, blue
        leg = _show(viewer, role.label, scene, scene.moving, [*parts, opacity])
        poses = [*map(scene.robot.configuration, own[::stride])]
        if cyclic:
            poses.append(poses[0])
        leg.display(poses[0])
        for number, pose in enumerate(poses):
            leg.viewer = animation.at_frame(viewer, number)
            leg.display(pose)
        vertices, faces = tube(foot, thickness, closed=cyclic)
        if len(faces):
            mesh = meshcat.geometry.TriangularMeshGeometry(vertices, faces)
            material = meshcat.geometry.MeshLambertMaterial(color=colour)
            viewer[f"{role.label} trace"].set_object(meshcat.geometry.Mesh(mesh, material))
    _draw_ground(viewer["ground"], np.concatenate(feet), thickness)
    _look(viewer, np.concatenate([places, *feet]))
    viewer.set_animation(animation, play=True, repetitions=float("inf"))
    script = files("meshcat").joinpath("viewer", "dist", "main.min.js").read_text("utf-8")
    commands = [base64.b64encode(command).decode() for command in recording.commands]
    page = environment().get_template("scene.html")
    return page.render(title=title, looks=LOOKS, viewer=script, commands=commands)


def _show(viewer: Any, name: str, scene: Scene, shapes: Any, colour: list[float] | None) -> Any:
    """Pinocchio's visualiser of some shapes, in their own colours or in one."""
    from pinocchio.visualize import MeshcatVisualizer

    if colour is not None:
        shapes = shapes.copy()
        for shape in shapes.geometryObjects:
            # Where legs coincide, the solid one is seen: a transparent one is thinner.
            shape.meshScale = np.full(3, 1.0 - 0.05 * (1.0 - colour[3]))
    visualiser = MeshcatVisualizer(scene.robot.model, visual_model=shapes)
    visualiser.initViewer(viewer)
    visualiser.loadViewerModel(name, visual_color=colour)
    viewer[name].set_transform(scene.to_base)
    return visualiser


def _draw_ground(node: Any, feet: Array, thickness: float) -> None:
    """A plate below the lowest position of the feet [m], shape (n, 3)."""
    geometry = import_meshcat().geometry
    size = 1.3 * max(float(np.ptp(feet[:, :2], axis=0).max()), 10.0 * thickness)
    colour = int(GRID.light.removeprefix("#"), 16)
    material = geometry.MeshLambertMaterial(color=colour, opacity=0.7)
    node.set_object(geometry.Mesh(geometry.Box([size, size, thickness]), material))
    place = np.eye(4)
    place[:2, 3] = 0.5 * (feet[:, :2].min(axis=0) + feet[:, :2].max(axis=0))
    place[2, 3] = feet[:, 2].min() - 1.5 * thickness
    node.set_transform(place)


def _look(viewer: Any, points: Array) -> None:
    """Place the points before the camera, against a plain background."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    viewer["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    viewer["/Background"].set_property("bottom_color", [0.93, 0.94, 0.95])
    viewer["/Grid"].set_property("visible", False)
    viewer["/Axes"].set_property("visible", False)
    centred = np.eye(4)
    centred[:3, 3] = -middle  # the camera turns about the origin
    viewer.set_transform(centred)
    x, y, z = np.array([0.5, 1.0, 0.3]) * size  # forward, sideways, up
    # Inside the node of the camera y points up: Meshcat turns it.
    viewer["/Cameras/default/rotated/<object>"].set_property("position", [x, z, -y])


def tube(points: Array, radius: float, *, closed: bool) -> tuple[Array, npt.NDArray[np.uint32]]:
    """Prisms around the steps of a path (n, 3) [m]: vertices, (v, 3), and triangles, (f, 3)."""
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    starts = points if closed else points[:-1]
    moving = np.any(ends != starts, axis=1)
    starts, ends = starts[moving], ends[moving]
    _, _, axes = np.linalg.svd((ends - starts)[:, np.newaxis])  # along each step, and across it
    across, third = axes[:, 1, np.newaxis], axes[:, 2, np.newaxis]
    turns = 2.0 * np.pi * np.arange(SIDES)[:, np.newaxis] / SIDES
    ring = radius * (np.cos(turns) * across + np.sin(turns) * third)  # (steps, SIDES, 3)
    vertices = np.concatenate([starts[:, np.newaxis] + ring, ends[:, np.newaxis] + ring], axis=1)
    side = np.arange(SIDES)
    beside = (side + 1) % SIDES
    halves = [(side, beside, side + SIDES), (beside, beside + SIDES, side + SIDES)]
    prism = np.concatenate([np.column_stack(half) for half in halves])
    faces = prism + 2 * SIDES * np.arange(len(starts))[:, np.newaxis, np.newaxis]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.uint32)
