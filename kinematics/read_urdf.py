"""Read the chain between two frames of a robot from its URDF, with Pinocchio."""

from __future__ import annotations

import os
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kinematics.chain import Array, Chain, read_only
from kinematics.exceptions import InvalidUrdf, UnknownFrame, UnsupportedLeg
from kinematics.limits import Limits

AGREEMENT = 1e-12
"""The chain's foot must agree with Pinocchio's to this [m], relative to its size beyond 1 m."""

UNLIMITED = 1e6
"""Limits beyond this [rad] are a way of writing that there is none."""


class ChainInRobot(NamedTuple):
    """A chain with what the robot says about its joints.

    Attributes:
        chain: The constants.
        joint_names: Names of the joints, from the base to the foot.
        limits: Their limits.
    """

    chain: Chain
    joint_names: tuple[str, ...]
    limits: Limits


def read_chain(path: str | os.PathLike[str], *, base: str, foot: str) -> ChainInRobot:
    """The joints between two frames of the robot that a URDF describes.

    Args:
        path: The URDF; meshes are not needed.
        base: Frame (link or joint) on the chain that leads to the foot.
        foot: Frame whose origin is the foot.

    Returns:
        The chain, checked against Pinocchio's own forward kinematics at three poses.

    Raises:
        InvalidUrdf: The file cannot be read or does not describe a robot.
        UnknownFrame: The robot has no such frame.
        UnsupportedLeg: The base is not above the foot, no joint lies between them, or one that is
            neither revolute nor continuous, or one that mimics another.
    """
    path = Path(path)
    model, mimics = read_model(path)
    start = find_frame(model, base, role="base")
    end = find_frame(model, foot, role="foot")
    joints = joints_between(model, start, end)
    names = tuple(str(model.names[joint]) for joint in joints)
    if copies := [name for name in names if name in mimics]:
        raise UnsupportedLeg(
            f"joint {copies[0]!r} between {base!r} and {foot!r} mimics another; every joint of a "
            "leg must be driven: remove its <mimic> element, or choose a foot above it"
        )
    axes = [_axis(model, joint) for joint in joints]
    placements = [start.placement.inverse() * model.jointPlacements[joints[0]]]
    placements += [model.jointPlacements[joint] for joint in joints[1:]]
    limits = _limits(path, model, joints)
    chain = Chain(
        rotations=np.array([placement.rotation for placement in placements]),
        translations=np.array([placement.translation for placement in placements]),
        axes=np.array(axes),
        tip=np.array(end.placement.translation),
    )
    if not np.all(np.isfinite(np.concatenate([chain.translations.ravel(), chain.tip]))):
        raise InvalidUrdf(path, f"an origin between {base!r} and {foot!r} is not finite")
    _check_against_pinocchio(model, chain, start, end, joints)
    return ChainInRobot(chain, names, limits)


def read_model(path: Path) -> tuple[Any, set[str]]:
    """Pinocchio's model, and the names of the joints that mimic others."""
    import pinocchio

    try:
        text = path.read_bytes()
    except OSError as error:
        raise InvalidUrdf(
            path, f"cannot be read ({error.strerror}); expected a URDF file"
        ) from error
    try:
        root = ElementTree.parse(BytesIO(text)).getroot()
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise InvalidUrdf(path, f"is not XML ({error}); expected a URDF file") from error
    if root.tag != "robot":
        hint = (
            "; expand xacro files first" if "xacro" in text[:2000].decode(errors="replace") else ""
        )
        raise InvalidUrdf(path, f"the root element is <{root.tag}>, expected <robot>{hint}")
    mimics = {
        joint.get("name", "") for joint in root.iter("joint") if joint.find("mimic") is not None
    }
    with _captured_stderr() as complaints:
        try:
            model = pinocchio.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            complaint = next(iter(complaints()), str(error))
            raise InvalidUrdf(path, f"is not a valid URDF: {complaint}") from error
    return model, mimics


@contextmanager
def _captured_stderr() -> Iterator[Any]:
    """Catch what the C++ parser writes to standard error: the reason belongs into our exception.

    Yields:
        A function that returns the complaints so far, one string each.
    """
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


def find_frame(model: Any, name: str, *, role: str) -> Any:
    """The frame of that name; where a link and a joint share it, their frames coincide."""
    # getFrameId returns nframes for a name it does not know, and refuses shared names.
    for frame in model.frames:
        if frame.name == name:
            return frame
    known = dict.fromkeys(str(frame.name) for frame in model.frames)
    raise UnknownFrame(name, list(known), role=role)


def joints_between(model: Any, start: Any, end: Any) -> list[int]:
    """The joints that move ``end`` in ``start``, from the base to the foot."""
    above = [int(joint) for joint in model.supports[end.parentJoint]]
    if start.parentJoint not in above:
        raise UnsupportedLeg(
            f"base {start.name!r} is not above foot {end.name!r} in the robot's tree; are they "
            "swapped, or on different limbs?"
        )
    joints = above[above.index(start.parentJoint) + 1 :]
    if not joints:
        raise UnsupportedLeg(
            f"no joint lies between base {start.name!r} and foot {end.name!r}: the foot cannot "
            "move; choose a base further up or a foot further down"
        )
    return joints


def _axis(model: Any, joint: int) -> Array:
    """The unit axis of a revolute joint in its own frame; other joints are refused."""
    import pinocchio

    kind = model.joints[joint]
    if kind.nv == 1:
        data = kind.createData()
        kind.calc(data, pinocchio.neutral(model))
        motion = np.array(data.S).ravel()
        length = np.linalg.norm(motion[3:])
        if abs(length - 1.0) < 1e-6:
            return np.asarray(motion[3:] / length, dtype=np.float64)
    raise UnsupportedLeg(
        f"joint {model.names[joint]!r} has no axis to turn about (Pinocchio: {kind.shortname()}); "
        "a leg has revolute and continuous joints only"
    )


def _limits(path: Path, model: Any, joints: list[int]) -> Limits:
    """Joint limits; a continuous joint has none."""
    lower, upper = np.full(len(joints), -np.inf), np.full(len(joints), np.inf)
    for k, joint in enumerate(joints):
        if model.joints[joint].nq == 1:  # a continuous joint is stored as cosine and sine
            index = model.joints[joint].idx_q
            lower[k], upper[k] = model.lowerPositionLimit[index], model.upperPositionLimit[index]
        if not lower[k] <= upper[k]:
            raise InvalidUrdf(
                path,
                f"joint {model.names[joint]!r} has the limits {lower[k]:g} and {upper[k]:g}, "
                "expected lower <= upper [rad]",
            )
    for limit in (lower, upper):
        limit[np.abs(limit) > UNLIMITED] = np.copysign(np.inf, limit[np.abs(limit) > UNLIMITED])
    return Limits(read_only(lower), read_only(upper))


def configuration(model: Any, joints: list[int], angles: Array) -> Any:
    """Pinocchio's coordinates with these joints at these angles and the others at rest."""
    import pinocchio

    coordinates = pinocchio.neutral(model)
    for joint, angle in zip(joints, angles, strict=True):
        kind = model.joints[joint]
        both = [angle] if kind.nq == 1 else [np.cos(angle), np.sin(angle)]
        coordinates[kind.idx_q : kind.idx_q + kind.nq] = both
    return coordinates


def _check_against_pinocchio(
    model: Any, chain: Chain, start: Any, end: Any, joints: list[int]
) -> None:
    """Refuse a chain whose foot is not where Pinocchio has it."""
    import pinocchio

    data = model.createData()
    for pose in (0.0, 0.7, -1.9):
        angles = pose * np.arange(1.0, len(joints) + 1.0)
        pinocchio.forwardKinematics(model, data, configuration(model, joints, angles))
        from_base = (data.oMi[start.parentJoint] * start.placement).inverse()
        expected = (from_base * data.oMi[end.parentJoint] * end.placement).translation
        found = chain.foot(np.cos(angles), np.sin(angles))[:, 0]
        if not np.allclose(found, expected, rtol=AGREEMENT, atol=AGREEMENT):
            raise UnsupportedLeg(
                f"the chain from {start.name!r} to {end.name!r} disagrees with Pinocchio by "
                f"{np.linalg.norm(found - expected):.3g} m; please report this robot"
            )
