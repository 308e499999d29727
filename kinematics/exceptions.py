"""Exceptions of the package.

::

    KinematicsError
    └── InvalidInput (also a ValueError)   an argument is invalid; the message says why
        ├── UnsupportedLeg                 a valid robot, but no leg between the two frames, or a
        │                                  leg of which a joint never moves the foot
        └── UnreachableFoot                points out of the leg's reach; carries their distances
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kinematics.chain import Array, Indices

LONGEST = 1500
"""Characters of a message; of a longer one the middle is left out."""


class KinematicsError(Exception):
    """The root of the tree; its message is always one line."""

    def __str__(self) -> str:
        return printable(super().__str__())


class InvalidInput(KinematicsError, ValueError):
    """An argument is invalid; the message says what was expected and what to do."""


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


def printable(text: str) -> str:
    """Text on one line and of bounded length, for any content of files and arguments."""
    text = _shortened(text)
    return _shortened("".join(c if c.isprintable() else repr(c)[1:-1] for c in text))


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 300]} … {text[-300:]}"
