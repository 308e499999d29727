"""Errors of a leg, in the tree of :mod:`planner.exceptions`.

::

    InvalidInput (also a ValueError)   an argument is invalid; the message says why
    ├── UnsupportedLeg                 a valid robot, but no leg between the two frames, or a leg of
    │                                  which a joint never moves the foot
    └── UnreachableFoot                points out of the leg's reach; carries their distances
"""

from __future__ import annotations

from planner.exceptions import InvalidInput as InvalidInput
from planner.exceptions import PlannerError as KinematicsError
from planner.trajectory import Array, Indices

__all__ = ["InvalidInput", "KinematicsError", "UnreachableFoot", "UnsupportedLeg"]


class UnsupportedLeg(InvalidInput):
    """The joints between the two frames form no leg, or none with an inverse."""


class UnreachableFoot(InvalidInput):
    """The leg cannot reach some of the points within its joint limits.

    Attributes:
        indices: Which points, read-only, shape (m,).
        distances: How far each lies from the nearest point that can be reached [m], read-only,
            shape (m,).
    """

    def __init__(self, indices: Indices, distances: Array, *, of: int) -> None:
        """Name the points, as far as they fit on a line, and the worst of them."""
        self.indices = indices
        self.distances = distances
        listed = ", ".join(str(index) for index in indices[:10])
        more = ", ..." if len(indices) > 10 else ""
        worst = int(distances.argmax())
        super().__init__(
            f"{len(indices)} of {of} foot positions are out of reach, the worst by "
            f"{distances[worst]:.3g} m (index {indices[worst]}); indices: {listed}{more}; move "
            "them (are they in metres, in the base frame?), or ask for unreachable='nearest'"
        )
