"""The moving robot as one HTML page that needs no server: Meshcat's viewer and what it shows."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from planner.report.draw_scene import Motion, draw_scene, import_meshcat
from planner.report.page import environment

if TYPE_CHECKING:
    from kinematics.scene import Scene


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
