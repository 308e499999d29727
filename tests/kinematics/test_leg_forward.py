"""Positions and Jacobians against differences and against themselves."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_robots import LEGS, Joint, ers210a_leg, reference_leg, urdf_text

from kinematics import Leg

ROUNDING = 1e-12
"""Two routes through the same kinematics agree to this [m, m/rad]."""

DIFFERENCES = 1e-8
"""Central differences with a step of 1e-5 rad are right to this [m/rad]."""


@pytest.mark.parametrize("name", LEGS)
def test_jacobians_are_the_derivatives_of_positions(name):
    leg = ers210a_leg(name)
    angles = np.random.default_rng(2).uniform(*leg.limits, (20, 3))
    jacobians = leg.jacobians(angles)
    for joint in range(3):
        step = 1e-5 * np.eye(3)[joint]
        rise = leg.foot_positions(angles + step) - leg.foot_positions(angles - step)
        np.testing.assert_allclose(jacobians[:, :, joint], rise / 2e-5, atol=DIFFERENCES)


def test_turned_axes_are_those_that_the_jacobian_turns_about():
    chain = ers210a_leg("hind_right").chain
    angles = np.random.default_rng(3).uniform(-2.0, 2.0, (3, 10))
    cosines, sines = np.cos(angles), np.sin(angles)
    _, columns = chain.foot_and_jacobian(cosines, sines)
    for axis, column in zip(chain.turned_axes(cosines, sines), columns, strict=True):
        np.testing.assert_allclose((axis * axis).sum(axis=0), 1.0, atol=ROUNDING)
        np.testing.assert_allclose((axis * column).sum(axis=0), 0.0, atol=ROUNDING)


def test_the_pose_of_the_rest_of_the_robot_makes_no_difference(tmp_path):
    # The base is a frame on the leg itself: what is above it does not count.
    chain = [Joint((0.1, 0.2, 0.3), (0, 0, 1)), Joint((0.3, 0, 0), (0, 1, 0))]
    path = tmp_path / "robot.urdf"
    path.write_text(urdf_text(chain, (0.2, 0.0, 0.0)), encoding="utf-8")
    leg = Leg.from_urdf(path, base="link_1", foot="tip")
    assert leg.joint_names == ("joint_2",)
    np.testing.assert_allclose(leg.foot_positions([[0.0]]), [[0.5, 0.0, 0.0]], atol=ROUNDING)


def test_a_path_of_no_points_is_fine():
    leg = reference_leg()
    assert leg.foot_positions(np.empty((0, 3))).shape == (0, 3)
    assert leg.jacobians(np.empty((0, 3))).shape == (0, 3, 3)
    for mode in ("raise", "nearest", "clamp"):
        assert leg.joint_angles(np.empty((0, 3)), unreachable=mode).shape == (0, 3)


def test_answers_are_copies_that_later_calls_do_not_change():
    leg = reference_leg()
    angles = np.zeros((2, 3))
    first = leg.foot_positions(angles)
    kept = first.copy()
    angles += 1.0
    leg.foot_positions(angles)
    np.testing.assert_array_equal(first, kept)
