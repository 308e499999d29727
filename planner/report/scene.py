"""A robot in Meshcat whose leg moves as desired, without a plan, and as planned; and its page."""

from __future__ import annotations

import base64
import uuid
import warnings
from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import MissingExtra
from planner.report.page import environment
from planner.report.style import DESIRED, DIRECT, FOOT_OPTIMAL, GRID, Role
from planner.trajectory import Array

if TYPE_CHECKING:
    from kinematics.scene import Body, Scene
    from kinematics.shapes import Shape

PLANNED = FOOT_OPTIMAL._replace(label="planned")

MOST_FRAMES = 1000
"""Moments of a motion that are shown; of longer ones every second is, or every third."""

TRACE = 0.008
"""Radius of a foot's trace, to the size of the leg."""

VIEWPOINT = np.array([0.5, 1.0, 0.3])
"""Where the camera is, from the middle of what is shown and to its size: forward, sideways, up."""

NAMESPACE = uuid.UUID("8c5a1a53-40c1-4f0b-8c3c-5a6e5c1b7f10")
"""Of the names by which Meshcat knows objects: the same scene is the same file."""

SIDES = 8
"""Of a trace, which is a tube: browsers draw lines one pixel wide."""

SOIL = 1.3
"""Extent of the ground, to that of the feet on it."""


class Motion(NamedTuple):
    """How a leg moves.

    Attributes:
        role: What it stands for, with its colour.
        angles: Its joints' angles [rad], shape (n, k).
        foot: Where its foot is in the base frame [m], shape (n, 3).
        opacity: Of its links: 1 hides what is behind them.
    """

    role: Role
    angles: Array
    foot: Array
    opacity: float


def motions(
    desired: tuple[Array, Array], direct: tuple[Array, Array], planned: tuple[Array, Array]
) -> tuple[Motion, ...]:
    """The three motions as they are shown, each from its angles [rad] and foot positions [m]."""
    return (
        Motion(DESIRED, *desired, 0.55),
        Motion(DIRECT, *direct, 0.45),
        Motion(PLANNED, *planned, 1.0),
    )


def import_meshcat() -> Any:
    """The package; silent about what it uses that is deprecated.

    Raises:
        MissingExtra: It is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            import meshcat
            import meshcat.animation
            import meshcat.geometry
    except ImportError as error:
        raise MissingExtra("the view in Meshcat", "meshcat") from error
    return meshcat


class Recording:
    """Stands for the window of a ``meshcat.Visualizer``, and keeps what is sent there.

    Attributes:
        commands: What was sent, packed as the viewer takes it.
    """

    def __init__(self) -> None:
        """Begin with nothing."""
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep a command."""
        import umsgpack

        self.commands.append(umsgpack.packb(command.lower()))


def scene_page(
    scene: Scene, shown: Sequence[Motion], *, period: float, cyclic: bool, title: str
) -> str:
    """The whole page; the same scene makes the same page.

    Meshcat's own ``static_html`` needs a server process and two ports, and gives the viewer its
    commands in no certain order; here it takes them one after another.

    Args:
        scene: The robot.
        shown: The motions of its leg, as for :func:`draw_scene`.
        period: Time between their samples [s].
        cyclic: Whether they repeat.
        title: What is shown, in words.

    Raises:
        MissingExtra: Meshcat is not installed.
    """
    meshcat = import_meshcat()
    recording = Recording()
    draw_scene(meshcat.Visualizer(window=recording), scene, shown, period=period, cyclic=cyclic)
    viewer = files("meshcat").joinpath("viewer", "dist", "main.min.js").read_text("utf-8")
    return (
        environment()
        .get_template("scene.html")
        .render(
            title=title,
            motions=shown,
            viewer=viewer,
            commands=[base64.b64encode(command).decode() for command in recording.commands],
        )
    )


def draw_scene(
    viewer: Any, scene: Scene, shown: Sequence[Motion], *, period: float, cyclic: bool
) -> None:
    """Draw the robot and its leg's motions, and play them for ever in real time.

    Args:
        viewer: A ``meshcat.Visualizer``.
        scene: The robot; it stands still but for the leg.
        shown: The motions, each of the same length.
        period: Time between their samples [s].
        cyclic: Whether the motions repeat, so that their ends are joined.
    """
    stride = -(-len(shown[0].angles) // MOST_FRAMES)
    rest = scene.placements(shown[0].angles[:1])[0]
    for b, body in enumerate(scene.bodies):
        if not body.moves:
            _draw_body(viewer["robot"][body.name], body, None, 1.0)
            viewer["robot"][body.name].set_transform(rest[b])
    reach = float(np.linalg.norm(np.ptp(rest[:, :3, 3], axis=0))) or 1.0
    clips = {}
    for motion in shown:
        node = viewer[motion.role.label]
        places = scene.placements(motion.angles[::stride])
        if cyclic:
            places = np.concatenate([places, places[:1]])
        for b, body in enumerate(scene.bodies):
            if body.moves:
                _draw_body(node[body.name], body, motion.role.light, motion.opacity)
                node[body.name].set_transform(places[0, b])
                clips[node[body.name].path] = _clip(places[:, b], 1.0 / (stride * period))
        _draw_trace(node["trace"], motion, TRACE * reach, closed=cyclic)
    _draw_ground(viewer["ground"], np.concatenate([motion.foot for motion in shown]), TRACE * reach)
    _look(viewer, np.concatenate([rest[:, :3, 3], *(motion.foot for motion in shown)]))
    animation = import_meshcat().animation.Animation(clips=clips)
    viewer.set_animation(animation, play=True, repetitions=float("inf"))


def _draw_body(node: Any, body: Body, colour: str | None, opacity: float) -> None:
    """The shapes of a body in their own colours, or in one."""
    geometry = import_meshcat().geometry
    for number, shape in enumerate(body.shapes):
        red, green, blue, own = shape.colour
        ghost = colour is not None and opacity < 1.0
        material = geometry.MeshLambertMaterial(
            color=_hex(colour) if colour else _packed(red, green, blue),
            opacity=opacity if colour else own,
            polygonOffset=ghost,  # where legs coincide, the solid one is seen
            polygonOffsetFactor=1.0,
            polygonOffsetUnits=1.0,
        )
        solid, placement = _solid(geometry, shape)
        _draw(node[f"shape {number}"], geometry.Mesh(solid, material))
        node[f"shape {number}"].set_transform(placement)


def _solid(geometry: Any, shape: Shape) -> tuple[Any, Array]:
    """Meshcat's geometry of a shape, and where it belongs in the link."""
    if shape.kind == "box":
        return geometry.Box(list(shape.size)), shape.placement
    if shape.kind == "sphere":
        return geometry.Sphere(shape.size[0]), shape.placement
    if shape.kind == "cylinder":  # Meshcat's lie along y, those of a URDF along z
        upright = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
        radius, length = shape.size
        return geometry.Cylinder(length, radius), shape.placement @ upright
    assert shape.surface is not None, "only a mesh is left, and it has one"
    return geometry.TriangularMeshGeometry(*shape.surface), shape.placement


def _draw_trace(node: Any, motion: Motion, radius: float, *, closed: bool) -> None:
    geometry = import_meshcat().geometry
    vertices, faces = tube(motion.foot, radius, closed=closed)
    if len(faces):
        material = geometry.MeshLambertMaterial(color=_hex(motion.role.light))
        _draw(node, geometry.Mesh(geometry.TriangularMeshGeometry(vertices, faces), material))


def _draw_ground(node: Any, feet: Array, thickness: float) -> None:
    """A plate below the lowest position of the feet [m], shape (n, 3)."""
    geometry = import_meshcat().geometry
    size = SOIL * max(float(np.ptp(feet[:, :2], axis=0).max()), 10.0 * thickness)
    material = geometry.MeshLambertMaterial(color=_hex(GRID.light), opacity=0.7)
    _draw(node, geometry.Mesh(geometry.Box([size, size, thickness]), material))
    place = np.eye(4)
    place[:2, 3] = 0.5 * (feet[:, :2].min(axis=0) + feet[:, :2].max(axis=0))
    place[2, 3] = feet[:, 2].min() - 1.5 * thickness
    node.set_transform(place)


def _draw(node: Any, solid: Any) -> None:
    """Show a solid under names that depend on its place only."""
    for part, of in (("object", solid), ("geometry", solid.geometry), ("material", solid.material)):
        of.uuid = str(uuid.uuid5(NAMESPACE, f"{node.path.lower()} {part}"))
    node.set_object(solid)


def _clip(places: Array, rate: float) -> Any:
    """The way of a body through its placements, shape (n, 4, 4), so many a second."""
    from scipy.spatial.transform import Rotation

    animation = import_meshcat().animation
    frames = list(range(len(places)))
    turns = Rotation.from_matrix(places[:, :3, :3]).as_quat()
    tracks = {
        name: animation.AnimationTrack(name, kind, frames, values.tolist())
        for name, kind, values in (
            ("position", "vector3", places[:, :3, 3]),
            ("quaternion", "quaternion", turns),
        )
    }
    return animation.AnimationClip(tracks=tracks, fps=rate)


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
    x, y, z = VIEWPOINT * size
    # Inside the node of the camera y points up: Meshcat turns it.
    viewer["/Cameras/default/rotated/<object>"].set_property("position", [x, z, -y])


def _hex(colour: str) -> int:
    return int(colour.removeprefix("#"), 16)


def _packed(*colour: float) -> int:
    """Red, green and blue, each from 0 to 1, as one number."""
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in colour)
    return red << 16 | green << 8 | blue


def tube(points: Array, radius: float, *, closed: bool) -> tuple[Array, npt.NDArray[np.uint32]]:
    """A straight prism around every step of a path that goes anywhere.

    Args:
        points: The path [m], shape (n, 3).
        radius: Its radius [m].
        closed: Whether the last point is joined to the first.

    Returns:
        Vertices [m], shape (v, 3), and triangles as rows of three vertices, shape (f, 3).
    """
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    starts = points if closed else points[:-1]
    steps = ends - starts
    lengths = np.linalg.norm(steps, axis=1)
    moving = lengths > 0.0
    starts, ends = starts[moving], ends[moving]
    along = steps[moving] / lengths[moving, None]
    across = np.cross(np.eye(3)[np.argmin(np.abs(along), axis=1)], along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(along, across)
    turns = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = radius * (
        np.cos(turns)[:, None] * across[:, None, :] + np.sin(turns)[:, None] * third[:, None, :]
    )  # (steps, SIDES, 3)
    vertices = np.concatenate([starts[:, None, :] + ring, ends[:, None, :] + ring], axis=1)
    side = np.arange(SIDES)
    beside = (side + 1) % SIDES
    prism = np.concatenate(
        [
            np.column_stack([side, beside, side + SIDES]),
            np.column_stack([beside, beside + SIDES, side + SIDES]),
        ]
    )
    faces = prism[None] + 2 * SIDES * np.arange(len(starts))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.uint32)
