"""Robots of the extra ``robots``: legs and three joints of arms, against Pinocchio itself."""

from __future__ import annotations

import math
from typing import NamedTuple

import coal
import numpy as np
import pytest

from kinematics import Leg
from kinematics.scene import Scene
from planner.gait.stride import standing_pose

QUARTER = 0.5 * math.pi


class Chosen(NamedTuple):
    """A leg of a public robot."""

    urdf: str
    base: str
    foot: str
    locked: dict[str, float]
    joints: int = 3


LEGS = {
    "Solo12": Chosen("solo_description/robots/solo12.urdf", "base_link", "FL_FOOT", {}),
    "Solo8": Chosen("solo_description/robots/solo.urdf", "base_link", "HR_FOOT", {}, joints=2),
    "ANYmal B": Chosen("anymal_b_simple_description/robots/anymal.urdf", "base", "LF_FOOT", {}),
    "UR5": Chosen(
        "ur_description/urdf/ur5_robot.urdf",
        "base_link",
        "ee_link",
        {"wrist_1_joint": -QUARTER, "wrist_2_joint": 0.3, "wrist_3_joint": 0.0},
    ),
    "Panda": Chosen(
        "panda_description/urdf/panda.urdf",
        "panda_link0",
        "panda_hand",
        {"panda_joint3": 0.1, "panda_joint5": 0.2, "panda_joint6": QUARTER, "panda_joint7": 0.0},
    ),
    "SO-101": Chosen(
        "so_arm_description/urdf/so101.urdf",
        "base_link",
        "gripper_frame_link",
        {"wrist_flex": 0.5, "wrist_roll": 0.0},
    ),
}


@pytest.mark.parametrize("chosen", LEGS.values(), ids=LEGS)
def test_the_leg_has_the_joints_that_are_left(chosen, robots):
    urdf, base, foot, locked, _ = chosen
    leg = Leg.from_urdf(robots / urdf, base=base, foot=foot, locked=locked)
    assert len(leg.joint_names) == chosen.joints
    assert not set(leg.joint_names) & set(chosen.locked)


def test_the_robot_can_be_seen(robots):
    urdf, base, foot, locked, _ = LEGS["Solo12"]
    scene = Scene.from_urdf(robots / urdf, base=base, foot=foot, locked=locked)
    assert scene.moving.ngeoms
    shapes = [*scene.still.geometryObjects, *scene.moving.geometryObjects]
    assert any(isinstance(shape.geometry, coal.BVHModelBase) for shape in shapes)
    leg = Leg.from_urdf(robots / urdf, base=base, foot=foot, locked=locked)
    assert np.isfinite(scene.places(np.mean(leg.limits.central, axis=0))).all()
    assert scene.robot.joint_names == leg.joint_names


@pytest.mark.parametrize("name", ["Solo12", "ANYmal B"])
def test_a_leg_without_hints_stands_bent_with_its_foot_below_its_hip(robots, name):
    """To a degree, to which the pose is rounded: 0.02 of the leg's length."""
    chosen = LEGS[name]
    leg = Leg.from_urdf(robots / chosen.urdf, base=chosen.base, foot=chosen.foot)
    pose = standing_pose(leg)
    *_, hip, _, foot = leg.joint_positions(pose[None])[0]
    assert np.linalg.norm((foot - hip)[:2]) < 0.02 * leg.chain.size
    assert foot[2] < hip[2] - 0.5 * leg.chain.size
    assert 50.0 < abs(math.degrees(pose[2])) < 110.0
    assert np.all((leg.limits.central[0] <= pose) & (pose <= leg.limits.central[1]))
