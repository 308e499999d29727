"""Positions and Jacobians against Pinocchio, against differences and against themselves."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_robots import LEGS, Joint, ers210a_leg, made_up_leg, reference_leg, urdf_text

from kinematics import Leg

ROUNDING = 1e-12
"""Two routes through the same kinematics agree to this [m, m/rad]."""

DIFFERENCES = 1e-8
"""Central differences with a step of 1e-5 rad are right to this [m/rad]."""

coordinates = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
axes = st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)]) | st.tuples(
    *[st.floats(-1.0, 1.0)] * 3
).filter(lambda axis: np.linalg.norm(axis) > 0.1)
joints = st.builds(
    Joint, coordinates, axes, rpy=turns, kind=st.sampled_from(["revolute", "continuous"])
)
chains = st.lists(joints, min_size=1, max_size=6)


@given(chain=chains, tip=coordinates, seed=st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_any_leg_agrees_with_pinocchio(chain, tip, seed, tmp_path_factory):
    leg = made_up_leg(tmp_path_factory.mktemp("robot"), chain, tip)
    angles = np.random.default_rng(seed).uniform(-3.0, 3.0, (4, len(chain)))
    positions, jacobians = leg.foot_positions(angles), leg.jacobians(angles)
    origins = leg.joint_positions(angles)
    assert positions.shape == (4, 3)
    assert origins.shape == (4, len(chain) + 1, 3)
    assert jacobians.shape == (4, 3, len(chain))
    model = pinocchio.buildModelFromXML(urdf_text(chain, tip))
    data, tip_id = model.createData(), model.getFrameId("tip")
    ids = [model.getJointId(f"joint_{number}") for number in range(1, len(chain) + 1)]
    for pose, position, jacobian, points in zip(angles, positions, jacobians, origins, strict=True):
        configuration = pinocchio.neutral(model)
        for joint, angle in zip(ids, pose, strict=True):
            both = [angle] if model.nqs[joint] == 1 else [np.cos(angle), np.sin(angle)]
            configuration[model.idx_qs[joint] :][: len(both)] = both
        pinocchio.computeJointJacobians(model, data, configuration)
        pinocchio.updateFramePlacements(model, data)
        expected = pinocchio.getFrameJacobian(
            model, data, tip_id, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )[:3, [model.idx_vs[joint] for joint in ids]]
        np.testing.assert_allclose(position, data.oMf[tip_id].translation, atol=ROUNDING)
        for joint, point in zip(ids, points[:-1], strict=True):
            np.testing.assert_allclose(point, data.oMi[joint].translation, atol=ROUNDING)
        np.testing.assert_array_equal(points[-1], position)
        np.testing.assert_allclose(jacobian, expected, atol=ROUNDING)


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


def test_a_symbolic_position_is_made_from_the_same_constants():
    import casadi

    leg = ers210a_leg("front_right")
    angles = np.random.default_rng(4).uniform(*leg.limits, (5, 3))
    symbols = casadi.SX.sym("angles", 3)
    parts = [symbols[joint] for joint in range(3)]
    foot, columns = leg.chain.foot_and_jacobian(
        [casadi.cos(part) for part in parts], [casadi.sin(part) for part in parts]
    )
    function = casadi.Function("leg", [symbols], [foot, casadi.horzcat(*columns)])
    for pose, position, jacobian in zip(
        angles, leg.foot_positions(angles), leg.jacobians(angles), strict=True
    ):
        symbolic_position, symbolic_jacobian = function(pose)
        np.testing.assert_allclose(symbolic_position.full()[:, 0], position, atol=ROUNDING)
        np.testing.assert_allclose(symbolic_jacobian.full(), jacobian, atol=ROUNDING)


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
