"""A robot in Pinocchio: its model, frames, and the joints between two frames."""

from __future__ import annotations

import math
import os
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array, read_only, shown
from planner.exceptions import InvalidInput, UnsupportedLeg, angle_text

TO_LIMIT = (
    'write <limit lower="..." upper="..." effort="..." velocity="..."/> [rad] for each into the '
    'file, or type="continuous" where nothing stops the joint'
)
"""What to do about revolute joints without limits."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot and a leg of it, created by :func:`read_robot`."""

    model: Any  # Pinocchio's model of it, with the locked joints fixed
    base: Any  # Pinocchio's frame at the upper end of the leg
    foot: Any  # its frame at the lower end
    joints: tuple[int, ...]  # the joints that move the foot in the base frame, from the base
    joint_names: tuple[str, ...]
    between: tuple[str, ...]  # names of the joints between the frames, also of locked ones
    # Pinocchio's coordinates with all joints at rest: at 0, or where 0 is out of the range at its
    # nearer end
    rest: Any

    def configuration(self, angles: Array) -> Any:
        """Pinocchio's coordinates with the leg at these angles, all other joints at rest."""
        coordinates = self.rest.copy()
        for joint, angle in zip(self.joints, angles, strict=True):
            _set(self.model, coordinates, joint, float(angle))
        return coordinates


def read_robot(
    path: Path, *, base: str, foot: str, locked: Mapping[str, float] | None = None
) -> Robot:
    """The robot of a URDF with the leg between two frames: see ``Leg.from_urdf``."""
    import pinocchio

    if not isinstance(locked, Mapping | None):
        raise InvalidInput(f"locked: got {type(locked).__name__}, expected joints and positions")
    try:
        text = path.read_bytes()
    except (OSError, ValueError) as error:  # a null byte in the name
        reason = getattr(error, "strerror", error)
        raise InvalidInput(f"{path}: cannot be read ({reason}); expected a URDF file") from error
    try:
        root = ElementTree.parse(BytesIO(text)).getroot()
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise InvalidInput(f"{path}: is not XML ({error}); expected a URDF file") from error
    if root.tag != "robot":
        hint = (
            "; expand xacro files first" if "xacro" in text[:2000].decode(errors="replace") else ""
        )
        raise InvalidInput(f"{path}: the root element is <{root.tag}>, expected <robot>{hint}")
    elements = list(root.iter("joint"))
    mimics = {each.get("name", "") for each in elements if each.find("mimic") is not None}
    unlimited = [
        each.get("name", "")
        for each in elements
        if each.get("type") in ("revolute", "prismatic") and each.find("limit") is None
    ]
    if unlimited:
        raise InvalidInput(f"{path}: {named(unlimited)} without <limit>; {TO_LIMIT}")
    with captured_stderr() as complaints:
        try:
            model = pinocchio.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"))
        except (ValueError, RuntimeError) as error:  # too deep an element among them
            complaint = next(iter(complaints()), str(error))
            raise InvalidInput(f"{path}: is not a valid URDF: {complaint}") from error
    rest = np.clip(pinocchio.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
    held = [_lock_joint(model, rest, *each) for each in (locked or {}).items()]
    start, end = _frame(model, base, role="base"), _frame(model, foot, role="foot")
    above = [int(joint) for joint in model.supports[end.parentJoint]]
    if start.parentJoint not in above:
        raise UnsupportedLeg(
            f"base {base!r} is not above foot {foot!r} in the robot's tree; are they "
            "swapped, or on different limbs?"
        )
    between = above[above.index(start.parentJoint) + 1 :]
    if not between:
        raise UnsupportedLeg(
            f"no joint lies between base {base!r} and foot {foot!r}: the foot cannot "
            "move; choose a base further up or a foot further down"
        )
    every = tuple(str(model.names[joint]) for joint in between)
    names = tuple(str(model.names[joint]) for joint in between if joint not in held)
    if not names:
        raise UnsupportedLeg(f"every joint between {base!r} and {foot!r} is locked; leave one out")
    if copies := [name for name in names if name in mimics]:
        raise UnsupportedLeg(
            f"joint {copies[0]!r} between {base!r} and {foot!r} mimics another; every joint of a "
            "leg must be driven: lock it, remove its <mimic> element, or choose a foot above it"
        )
    if held:
        model = pinocchio.buildReducedModel(model, held, rest)
        rest = np.clip(pinocchio.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
        start, end = _frame(model, base, role="base"), _frame(model, foot, role="foot")
    joints = tuple(int(model.getJointId(name)) for name in names)
    return Robot(model, start, end, joints, names, every, read_only(rest))


def named(joints: Sequence[str]) -> str:
    """Names of joints for a message, as many as fit on a line."""
    listed = ", ".join(repr(name) for name in joints[:6])
    more = f" and {len(joints) - 6} more" if len(joints) > 6 else ""
    return f"joint{'' if len(joints) == 1 else 's'} {listed}{more}"


def _lock_joint(model: Any, coordinates: Any, name: str, position: float) -> int:
    """Set the position of a locked joint; its index."""
    names = [str(each) for each in model.names]
    if name not in names[1:]:  # the first is the world
        raise InvalidInput(
            f"locked: no joint {name!r} that moves in the URDF; joints: "
            f"{', '.join(names[1:]) or 'none'}"
        )
    joint = names.index(name)
    kind = model.joints[joint]
    if kind.nv != 1:
        raise InvalidInput(f"locked: joint {name!r} has {kind.nv} ways to move, expected one")
    low, high = -math.inf, math.inf
    if kind.nq == 1:
        low = float(model.lowerPositionLimit[kind.idx_q])
        high = float(model.upperPositionLimit[kind.idx_q])
    if not (math.isfinite(position) and low - 1e-9 <= position <= high + 1e-9):
        slides = kind.shortname().startswith("JointModelP")
        at, its_range = (
            (f"{position:g} m", f"{low:g} to {high:g} m")
            if slides
            else (angle_text(position), angle_text(low, high))
        )
        raise InvalidInput(f"locked: joint {name!r} at {at}, expected {its_range}, its range")
    _set(model, coordinates, joint, float(position))
    return joint


def _set(model: Any, coordinates: Any, joint: int, position: float) -> None:
    """Set a joint's position; Pinocchio stores a continuous one as its cosine and sine."""
    kind = model.joints[joint]
    both = [position] if kind.nq == 1 else [math.cos(position), math.sin(position)]
    coordinates[kind.idx_q :][: kind.nq] = both


@contextmanager
def captured_stderr() -> Iterator[Any]:
    """Capture the C++ parser's messages on standard error; yields what returns them, one by one."""
    sys.stderr.flush()
    try:
        terminal = os.dup(2)
    except OSError:  # a process without standard error has nothing to catch
        yield list
        return
    with tempfile.TemporaryFile() as caught:

        def complaints() -> list[str]:
            caught.seek(0)
            lines = caught.read().decode(errors="replace").splitlines()
            return [line.removeprefix("Error:").strip() for line in lines if "Error:" in line]

        os.dup2(caught.fileno(), 2)
        try:
            yield complaints
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)


def _frame(model: Any, name: str, *, role: str) -> Any:
    """The frame of that name; where a link and a joint share it, their frames coincide."""
    if not isinstance(name, str):
        raise InvalidInput(f"{role}: got {type(name).__name__}, expected the name of a frame")
    # getFrameId returns nframes for an unknown name, and rejects shared names.
    for frame in model.frames:
        if frame.name == name:
            return frame
    names = dict.fromkeys(str(frame.name) for frame in model.frames)
    raise InvalidInput(
        f"{role}: frame {name!r} is not in the URDF; frames: {', '.join(names) or 'none'}"
    )


def urdf_path(name: str) -> Path:
    """Path of a robot description that is shipped.

    They are in the folder ``urdf``, which lies beside this package in a checkout and in a wheel.

    Args:
        name: File name, such as ``"ers210a.urdf"``.

    Returns:
        Absolute path of the file.

    Raises:
        InvalidInput: No such file is shipped.

    Example:
        >>> urdf_path("ers210a.urdf").name
        'ers210a.urdf'
    """
    folder = Path(__file__).resolve().parent.parent / "urdf"
    names = sorted(each.name for each in folder.glob("*.urdf"))
    if not isinstance(name, str) or name not in names:
        raise InvalidInput(
            f"name: got {shown(name)}, expected a description that is shipped: {', '.join(names)}; "
            "a file of your own goes to Leg.from_urdf directly"
        )
    return folder / name
