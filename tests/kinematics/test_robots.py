"""The robots that are shipped, by Sony's numbers, and public ones of the extra ``robots``."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Leg, urdf_path
from planner.gait.stride import standing_pose
from tests.kinematics.made_up_robots import LEGS, ers210a_leg, reference_leg

DRAWING = 5e-5  # Sony's vectors are rounded and their ball fitted: they hold to this [m]

VECTORS = {  # rotator, abductor, knee [deg]: ball of the left leg in the body [mm]
    "front_left": [
        ((0, 0, 0), (60.594, 59.700, -119.772)),
        ((0, 0, 35), (94.700, 59.700, -116.400)),
        ((30, 10, 60), (157.538, 77.409, -59.315)),
        ((-40, 5, 100), (70.803, 65.437, -95.053)),
        ((-20, 15, 40), (59.089, 89.253, -117.150)),
    ],
    "hind_left": [
        ((0, 0, 0), (-50.107, 59.700, -124.636)),
        ((0, 0, 35), (-88.900, 59.700, -126.400)),
        ((30, 10, 60), (-162.316, 79.408, -69.650)),
        ((-40, 5, 100), (-69.795, 66.263, -106.540)),
        ((-20, 15, 40), (-51.021, 91.962, -124.973)),
    ],
}
ANGLES = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@pytest.mark.parametrize("name", VECTORS)
def test_the_ball_is_where_the_published_vectors_have_it(name):
    degrees, millimetres = zip(*VECTORS[name], strict=True)
    found = ers210a_leg(name).foot_positions(np.radians(degrees))
    assert np.abs(found - 1e-3 * np.array(millimetres)).max() < DRAWING


@pytest.mark.parametrize("name", LEGS)
def test_joints_and_limits_are_sonys_and_speeds_the_papers(name):
    leg = ers210a_leg(name)
    assert leg.joint_names == (f"{name}_rotator", f"{name}_abductor", f"{name}_knee")
    np.testing.assert_allclose(np.degrees(leg.limits.lower), [-117, -11, -27], atol=1e-12)
    np.testing.assert_allclose(np.degrees(leg.limits.upper), [117, 89, 147], atol=1e-12)
    for each in (leg, reference_leg()):
        np.testing.assert_allclose(np.degrees(each.speeds), [312.5] * 3, rtol=1e-12)


@pytest.mark.parametrize("name", LEGS)
def test_positive_angles_swing_front_feet_forward_hind_feet_backward_and_all_outward(name):
    rotator, abductor, knee = ers210a_leg(name).jacobians([[0.0, 0.0, 0.0]])[0].T
    forward = 1.0 if name.startswith("front") else -1.0
    outward = 1.0 if name.endswith("left") else -1.0
    assert forward * rotator[0] > 0.0
    assert forward * knee[0] > 0.0
    assert outward * abductor[1] > 0.0


@given(angles=ANGLES)
@settings(deadline=None)
def test_the_reference_leg_is_its_formula(angles):
    upper, lower = 0.064, 0.069
    (c1, c2, c3), (s1, s2, s3) = np.cos(angles), np.sin(angles)
    reach = upper + lower * c3
    expected = [lower * c1 * s3 + reach * c2 * s1, reach * s2, lower * s1 * s3 - reach * c2 * c1]
    found = reference_leg().foot_positions([angles])
    np.testing.assert_allclose(found, [expected], atol=1e-15)


def test_a_leg_may_be_seen_from_any_frame_above_it():
    path, angles = urdf_path("ers210a.urdf"), [[0.3, 0.2, 1.0]]
    from_head = Leg.from_urdf(path, base="head", foot="hind_left_ball").foot_positions(angles)
    from_body = ers210a_leg("hind_left").foot_positions(angles)
    np.testing.assert_allclose(from_head, from_body - [0.075, 0.0, 0.098], atol=1e-15)


PUBLIC = {
    "Solo12": ("solo_description/robots/solo12.urdf", "base_link", "FL_FOOT", 3, ""),
    "Solo8": ("solo_description/robots/solo.urdf", "base_link", "HR_FOOT", 2, ""),
    "ANYmal B": ("anymal_b_simple_description/robots/anymal.urdf", "base", "LF_FOOT", 3, ""),
    "UR5": (
        *("ur_description/urdf/ur5_robot.urdf", "base_link", "ee_link", 3),
        "wrist_1_joint wrist_2_joint wrist_3_joint",
    ),
    "Panda": (
        *("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand", 3),
        "panda_joint3 panda_joint5 panda_joint6 panda_joint7",
    ),
    "SO-101": (
        *("so_arm_description/urdf/so101.urdf", "base_link", "gripper_frame_link", 3),
        "wrist_flex wrist_roll",
    ),
}
"""File, base, foot, number of joints, and further joints, which are locked."""


def public_leg(robots, name):
    urdf, base, foot, _, locked = PUBLIC[name]
    locked = dict.fromkeys(locked.split(), 0.1)
    return Leg.from_urdf(robots / urdf, base=base, foot=foot, locked=locked)


@pytest.mark.parametrize("name", PUBLIC)
def test_the_leg_has_the_joints_that_are_left(name, robots):
    *_, count, locked = PUBLIC[name]
    leg = public_leg(robots, name)
    assert len(leg.joint_names) == count
    assert not {*leg.joint_names} & {*locked.split()}


@pytest.mark.parametrize("name", ["Solo12", "ANYmal B"])
def test_a_leg_without_hints_stands_bent_with_its_foot_below_its_hip(robots, name):
    """To a degree, to which the pose is rounded: 0.02 of the leg's length."""
    leg = public_leg(robots, name)
    pose = standing_pose(leg)
    *_, hip, _, foot = leg.joint_positions(pose[None])[0]
    assert np.linalg.norm((foot - hip)[:2]) < 0.02 * leg.chain.size
    assert foot[2] < hip[2] - 0.5 * leg.chain.size
    assert 50.0 < abs(math.degrees(pose[2])) < 110.0
    assert np.all((leg.limits.central[0] <= pose) & (pose <= leg.limits.central[1]))
