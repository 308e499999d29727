"""The moving leg: its motions as data for the script that draws them in the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.report.live_words import BOLDER, dashes, variable
from planner.report.style import Role

if TYPE_CHECKING:
    from planner.trajectory import Array

MOST_FRAMES = 1500
"""Moments of a motion that are shown; of longer ones every second is, or every third."""

DECIMALS = 2
"""Of positions [cm]: a tenth of a millimetre, less than a pixel."""


class Motion(NamedTuple):
    """How a leg moves.

    Attributes:
        role: What it stands for, with its looks.
        points: Where its joints and, last, its foot are [m], shape (n, joints + 1, 3).
        distances: How far the foot is from where it should be [m], shape (n,), or None.
        hidden: Whether it is drawn only when it is asked for.
    """

    role: Role
    points: Array
    distances: Array | None = None
    hidden: bool = False


def moving_leg(
    motions: Sequence[Motion], *, period: float, cyclic: bool, ground: bool = False
) -> dict[str, Any]:
    """What the page's script needs to draw a leg along its motions, with a time slider.

    Args:
        motions: The motions, each of n samples; later ones lie over earlier ones.
        period: Time between samples [s].
        cyclic: Whether they repeat.
        ground: Whether the lowest point of the first motion's foot is the ground.
    """
    stride = -(-len(motions[0].points) // MOST_FRAMES)
    return {
        "kind": "leg",
        "period": stride * period,
        "cyclic": cyclic,
        "ground": _rounded(motions[0].points[:, -1, 2].min()) if ground else None,
        "motions": [
            {
                "name": motion.role.label,
                "colour": variable(motion.role),
                "width": round(motion.role.width * BOLDER, 2),
                "dashes": dashes(motion.role).replace("solid", "none").replace("px", ""),
                "hidden": motion.hidden,
                "points": _rounded(motion.points[::stride]),
                "distances": None
                if motion.distances is None
                else _rounded(motion.distances[::stride]),
            }
            for motion in motions
        ],
    }


def _rounded(metres: Array) -> Any:
    """Lengths in centimetres, as lists."""
    return (np.round(100.0 * metres, DECIMALS) + 0.0).tolist()  # no minus before zero
