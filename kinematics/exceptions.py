"""Exceptions of the package.

::

    KinematicsError
    └── InvalidInput (also a ValueError)   an argument is invalid; the message says why
        ├── UnknownDescription             no such robot is shipped; carries the shipped ones
        ├── InvalidUrdf                    not a robot description; carries the path
        ├── UnknownFrame                   no such frame in the robot; carries its frames
        ├── UnsupportedLeg                 a valid robot, but no such leg between the two frames
        │   └── SingularLeg                some of its joints never move the foot
        ├── InvalidPath                    angles or foot positions with NaN or the wrong shape
        └── UnreachableFoot                points out of the leg's reach; carries their distances
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
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


class UnknownDescription(InvalidInput):
    """No robot description of that name is shipped.

    Attributes:
        name: The requested name.
        shipped: The shipped files.
    """

    def __init__(self, name: str, shipped: Sequence[str]) -> None:
        """List the shipped files."""
        self.name = name
        self.shipped = tuple(shipped)
        super().__init__(
            f"robot description {name!r} is not shipped; shipped: {', '.join(shipped)}; "
            "a file of your own goes to Leg.from_urdf directly"
        )


class InvalidUrdf(InvalidInput):
    """A file does not describe a robot.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path, problem: str) -> None:
        """Compose the message from the file and the problem."""
        self.path = path
        super().__init__(f"{path}: {problem}")


class UnknownFrame(InvalidInput):
    """The robot has no frame of that name.

    Attributes:
        name: The requested name.
        frames: Names of the robot's frames.
    """

    def __init__(self, name: str, frames: Sequence[str], *, role: str) -> None:
        """List the frames that the robot has; ``role`` says which argument was wrong."""
        self.name = name
        self.frames = tuple(frames)
        super().__init__(
            f"{role}: frame {name!r} is not in the URDF; frames: {', '.join(frames) or 'none'}"
        )


class UnsupportedLeg(InvalidInput):
    """The joints between the two frames form no leg, or none with an inverse."""


class SingularLeg(UnsupportedLeg):
    """The leg is singular in every pose: some of its joints never move the foot.

    Attributes:
        joints: Names of these joints.
    """

    def __init__(self, problem: str, *, joints: Sequence[str]) -> None:
        """Keep the names beside the message."""
        self.joints = tuple(joints)
        super().__init__(problem)


class InvalidPath(InvalidInput):
    """Angles or foot positions are not a finite array of the right shape."""


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
