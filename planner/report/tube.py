"""A line in space as a thin tube of triangles, as browsers draw lines one pixel wide."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.trajectory import Array

SIDES = 8


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
