"""The leg in CasADi against Pinocchio itself, against the numeric leg and against differences."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_robots import (
    LEGS,
    SHAPES,
    Joint,
    ers210a_leg,
    made_up_leg,
    reference_leg,
    urdf_text,
)

from kinematics import urdf_path
from kinematics.symbolic import foot_function

ROUNDING = 1e-12
"""Two routes through the same kinematics agree to this [m, m/rad]."""

DIFFERENCES = 1e-8
"""Central differences with a step of 1e-5 rad are right to this [m/rad]."""

SHIPPED_LEGS = [("reference_leg.urdf", "hip", "foot")] + [
    ("ers210a.urdf", "body", f"{name}_ball") for name in LEGS
]

coordinates = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
axes = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1)
joints = st.builds(
    Joint,
    coordinates,
    axes,
    rpy=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    kind=st.sampled_from(["revolute", "continuous"]),
)
chains = st.lists(joints, min_size=1, max_size=6)


def shipped_leg(foot):
    return reference_leg() if foot == "foot" else ers210a_leg(foot.removesuffix("_ball"))


def pinocchio_foot(model, base, foot, names, pose):
    """Position and Jacobian in the base frame, by Pinocchio alone."""
    data = model.createData()
    configuration = pinocchio.neutral(model)
    ids = [model.getJointId(name) for name in names]
    for joint, angle in zip(ids, pose, strict=True):
        both = [angle] if model.nqs[joint] == 1 else [np.cos(angle), np.sin(angle)]
        configuration[model.idx_qs[joint] :][: len(both)] = both
    pinocchio.computeJointJacobians(model, data, configuration)
    pinocchio.updateFramePlacements(model, data)
    from_base = data.oMf[model.getFrameId(base)].inverse()
    jacobian = pinocchio.getFrameJacobian(
        model, data, model.getFrameId(foot), pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )[:3, [model.idx_vs[joint] for joint in ids]]
    position = from_base.act(data.oMf[model.getFrameId(foot)].translation)
    return position, from_base.rotation @ jacobian


@pytest.mark.parametrize(("robot", "base", "foot"), SHIPPED_LEGS, ids=lambda name: name)
def test_the_symbolic_leg_is_the_one_that_pinocchio_reads(robot, base, foot):
    leg = shipped_leg(foot)
    function = foot_function(leg)
    model = pinocchio.buildModelFromUrdf(str(urdf_path(robot)))
    for pose in np.random.default_rng(1).uniform(*leg.limits, (10, 3)):
        position, jacobian = pinocchio_foot(model, base, foot, leg.joint_names, pose)
        symbolic_position, symbolic_jacobian = function(pose)
        np.testing.assert_allclose(symbolic_position.full()[:, 0], position, atol=ROUNDING)
        np.testing.assert_allclose(symbolic_jacobian.full(), jacobian, atol=ROUNDING)


@given(chain=chains, tip=coordinates, seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_any_symbolic_leg_agrees_with_pinocchio(chain, tip, seed, tmp_path_factory):
    leg = made_up_leg(tmp_path_factory.mktemp("robot"), chain, tip)
    function = foot_function(leg)
    model = pinocchio.buildModelFromXML(urdf_text(chain, tip))
    for pose in np.random.default_rng(seed).uniform(-3.0, 3.0, (3, len(chain))):
        position, jacobian = pinocchio_foot(model, "link_0", "tip", leg.joint_names, pose)
        symbolic_position, symbolic_jacobian = function(pose)
        np.testing.assert_allclose(symbolic_position.full()[:, 0], position, atol=ROUNDING)
        np.testing.assert_allclose(symbolic_jacobian.full(), jacobian, atol=ROUNDING)


@pytest.mark.parametrize("foot", [foot for _, _, foot in SHIPPED_LEGS])
def test_casadis_derivatives_are_those_written_by_hand(foot):
    leg = shipped_leg(foot)
    angles = np.random.default_rng(2).uniform(*leg.limits, (20, 3))
    positions, jacobians = foot_function(leg).map(20)(angles.T)
    np.testing.assert_allclose(positions.full().T, leg.foot_positions(angles), atol=ROUNDING)
    side_by_side = np.concatenate(list(leg.jacobians(angles)), axis=1)
    np.testing.assert_allclose(jacobians.full(), side_by_side, atol=ROUNDING)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_symbolic_jacobian_is_the_derivative_of_the_symbolic_position(shape, tmp_path):
    function = foot_function(made_up_leg(tmp_path, *SHAPES[shape]))
    for pose in np.random.default_rng(3).uniform(-2.0, 2.0, (5, 3)):
        jacobian = function(pose)[1].full()
        for joint in range(3):
            step = 1e-5 * np.eye(3)[joint]
            rise = function(pose + step)[0].full() - function(pose - step)[0].full()
            np.testing.assert_allclose(jacobian[:, joint], rise[:, 0] / 2e-5, atol=DIFFERENCES)


@pytest.mark.parametrize("count", [1, 2, 6])
def test_a_leg_has_a_column_for_each_joint(count, tmp_path):
    chain = [Joint((0.1, 0.0, 0.0), (0.0, 1.0, 0.0)) for _ in range(count)]
    function = foot_function(made_up_leg(tmp_path, chain, (0.1, 0.0, 0.0)))
    assert (function.name_in(), function.name_out()) == (["angles"], ["foot", "jacobian"])
    assert function.size_in(0) == (count, 1)
    assert function.size_out(0) == (3, 1)
    assert function.size_out(1) == (3, count)
    # All axes are parallel: the foot stays in their plane, and every column says so.
    foot, jacobian = function(np.zeros(count))
    np.testing.assert_allclose(foot.full()[:, 0], [0.1 * (count + 1), 0.0, 0.0], atol=ROUNDING)
    arms = -0.1 * np.arange(count, 0, -1)
    np.testing.assert_allclose(jacobian.full()[2], arms, atol=ROUNDING)
