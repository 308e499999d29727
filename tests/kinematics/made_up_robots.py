"""Robots for the tests: serial legs from numbers, and legs whose geometry has a known shape."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from kinematics import Leg, urdf_path

LEGS = ("front_left", "front_right", "hind_left", "hind_right")
Vector = tuple[float, float, float]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Joint:
    """One joint of a made-up leg: where it sits, how it is tilted and what it turns about."""

    xyz: Vector
    axis: Vector
    rpy: Vector = (0.0, 0.0, 0.0)
    kind: str = "revolute"
    lower: float = -2.5
    upper: float = 2.5
    extra: str = ""

    def element(self, number: int) -> str:
        """The joint and its link as URDF."""
        limit = f'<limit lower="{self.lower!r}" upper="{self.upper!r}" effort="1" velocity="1"/>'
        return (
            f'<joint name="joint_{number}" type="{self.kind}">'
            f'<parent link="link_{number - 1}"/><child link="link_{number}"/>'
            f"<origin {_triple('xyz', self.xyz)} {_triple('rpy', self.rpy)}/>"
            f"<axis {_triple('xyz', self.axis)}/>"
            f"{'' if self.kind in ('continuous', 'floating') else limit}{self.extra}</joint>"
            f'<link name="link_{number}"/>'
        )


def urdf_text(joints: list[Joint], tip: Vector) -> str:
    """A robot from link_0 over its joints to the frame ``tip``, with a spare arm on link_0."""
    chain = "".join(joint.element(number) for number, joint in enumerate(joints, 1))
    return (
        f'<robot name="made_up"><link name="link_0"/>{chain}<link name="tip"/>'
        '<joint name="tip_mount" type="fixed"><origin '
        f'{_triple("xyz", tip)}/><parent link="link_{len(joints)}"/><child link="tip"/></joint>'
        '<link name="arm"/><joint name="arm_joint" type="continuous"><parent link="link_0"/>'
        '<child link="arm"/><axis xyz="0 0 1"/></joint></robot>'
    )


def made_up_leg(folder: Path, joints: list[Joint], tip: Vector) -> Leg:
    """The leg of :func:`urdf_text`, through a file as users have it."""
    path = folder / "made_up.urdf"
    path.write_text(urdf_text(joints, tip), encoding="utf-8")
    return Leg.from_urdf(path, base="link_0", foot="tip")


def ers210a_leg(name: str) -> Leg:
    """A leg of the ERS-210A, from the body."""
    return Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot=f"{name}_ball")


def reference_leg() -> Leg:
    return Leg.from_urdf(urdf_path("reference_leg.urdf"), base="hip", foot="foot")


SHAPES: dict[str, tuple[list[Joint], Vector]] = {
    "first two axes intersect": (
        [
            Joint((0.1, 0.2, 0.0), Y, rpy=(0.3, -0.2, 0.5)),
            Joint((0.0, 0.03, 0.0), X),
            Joint((0.02, 0.01, -0.2), Y, rpy=(0.1, 0.0, 0.0)),
        ],
        (0.03, 0.01, -0.22),
    ),
    "last two axes parallel, hip offset in every direction": (
        [
            Joint((0.1, 0.2, 0.0), X, rpy=(0.3, -0.2, 0.5)),
            Joint((0.05, 0.08, -0.06), Y),
            Joint((0.02, 0.01, -0.2), Y),
        ],
        (0.03, 0.02, -0.22),
    ),
    "last two axes intersect": (
        [
            Joint((0.1, 0.2, 0.0), Y, rpy=(0.3, -0.2, 0.5)),
            Joint((0.02, 0.01, -0.2), Y, rpy=(0.4, 0.0, 0.3)),
            Joint((0.0, 0.05, 0.0), X),
        ],
        (0.03, 0.01, -0.22),
    ),
    "first two axes parallel": (
        [
            Joint((0.1, 0.2, 0.0), Z, rpy=(0.3, -0.2, 0.5)),
            Joint((0.2, 0.0, 0.05), Z),
            Joint((0.15, 0.03, 0.02), Y, rpy=(0.2, 0.0, 0.1)),
        ],
        (0.03, 0.01, -0.12),
    ),
    "no two axes meet": (
        [
            Joint((0.1, 0.2, 0.0), Y, rpy=(0.3, -0.2, 0.5)),
            Joint((0.04, 0.03, 0.05), X, rpy=(0.2, 0.3, 0.0)),
            Joint((0.02, 0.01, -0.2), Y, rpy=(0.1, 0.2, 0.4)),
        ],
        (0.03, 0.01, -0.22),
    ),
}
CLOSED = [name for name in SHAPES if name != "no two axes meet"]


def angles_within(leg: Leg) -> st.SearchStrategy[np.ndarray]:
    """Poses within the limits, the limits themselves and the straight leg among them."""
    joints = []
    for lower, upper in zip(*leg.limits.central, strict=True):
        ends = st.sampled_from([float(lower), float(upper), float(np.clip(0.0, lower, upper))])
        joints.append(ends | st.floats(float(lower), float(upper)))
    return st.lists(st.tuples(*joints), min_size=1, max_size=8).map(np.array)


def _triple(name: str, values: Vector) -> str:
    return f'{name}="{" ".join(repr(value) for value in values)}"'
