"""The robots that are shipped: Sony's numbers, signs, mirror symmetry, consistent inertias."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Leg, urdf_path
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


@pytest.mark.parametrize(
    ("name", "paw"), [("front_left", (53.42, 59.7, -130.0)), ("hind_left", (-42.94, 59.7, -134.88))]
)
def test_the_paw_is_where_the_drawing_has_it(name, paw):
    found = ers210a_leg(name, "paw").foot_positions([[0.0, 0.0, 0.0]])
    np.testing.assert_allclose(found, [1e-3 * np.array(paw)], atol=1e-12)


@pytest.mark.parametrize("name", LEGS)
def test_joints_and_limits_are_sonys(name):
    leg = ers210a_leg(name)
    assert leg.joint_names == (f"{name}_rotator", f"{name}_abductor", f"{name}_knee")
    np.testing.assert_allclose(np.degrees(leg.limits.lower), [-117, -11, -27], atol=1e-12)
    np.testing.assert_allclose(np.degrees(leg.limits.upper), [117, 89, 147], atol=1e-12)


def test_every_driven_joint_may_turn_as_fast_as_the_papers_joint():
    for leg in (*map(ers210a_leg, LEGS), reference_leg()):
        np.testing.assert_allclose(np.degrees(leg.speeds), [312.5] * 3, rtol=1e-12)


@pytest.mark.parametrize("point", ["ball", "paw"])
@pytest.mark.parametrize("end", ["front", "hind"])
@given(angles=ANGLES)
@settings(deadline=None, max_examples=25)
def test_equal_angles_left_and_right_give_mirror_poses(end, point, angles):
    left = ers210a_leg(f"{end}_left", point).foot_positions([angles])
    right = ers210a_leg(f"{end}_right", point).foot_positions([angles])
    np.testing.assert_allclose(right, left * [1.0, -1.0, 1.0], atol=1e-15)


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
