"""Legs cut out of longer chains, legs of fewer joints, and paths on which legs must not leap."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics import InvalidInput, Leg, Limits, UnsupportedLeg
from kinematics.inverse import jumps
from planner.gait.stride import dexterity, standing_pose
from tests.kinematics.made_up_robots import Joint, X, Y, made_up_leg, reference_leg, urdf_text

REACHED = 1e-9  # largest distance to the foot that the inverse leaves [m]


def test_a_foot_on_the_axis_of_a_joint_is_singular(tmp_path):
    leg = made_up_leg(tmp_path, [Joint((0, 0, 0), X), Joint((0, 0, -0.1), Y)] * 2, (0, 0.1, 0))
    leg = replace(leg, joint_names=leg.joint_names)
    three = made_up_leg(
        tmp_path, [Joint((0, 0, 0), X), Joint((0, 0, 0), Y), Joint((0, 0, -0.1), Y)], (0, 0.1, 0)
    )
    with pytest.raises(UnsupportedLeg, match="joint 'joint_3' does not move the foot"):
        three.inverse([[0.0, 0.1, -0.1]], unreachable="nearest")
    with pytest.raises(UnsupportedLeg):
        standing_pose(three)
    with pytest.raises(UnsupportedLeg, match="this leg has 4: lock the others"):
        standing_pose(leg)


def test_joints_that_a_pose_does_not_name_are_at_the_end_of_their_range_nearest_to_0(tmp_path):
    hip, knee = Joint((0, 0, 0), Y, lower=0.4), Joint((0, 0, -0.1), Y, upper=-0.2)
    joints = [Joint((0, 0, 0), X), hip, knee]
    path = tmp_path / "bent.urdf"
    path.write_text(urdf_text(joints, (0, 0, -0.1)))
    leg = Leg.from_urdf(path, base="link_0", foot="tip", near={"joint_1": 0.1})
    np.testing.assert_array_equal(leg.near, [0.1, 0.4, -0.2])
    with pytest.raises(InvalidInput, match=r"^near: joint 'joint_1' at 2e\+06 rad, expected an an"):
        Leg.from_urdf(path, base="link_0", foot="tip", near={"joint_1": 2e6})


def test_a_smooth_path_does_not_jump_and_one_between_poses_does():
    """In steps that are nearly as long as half way between the poses is wide."""
    leg = reference_leg()
    free = replace(leg, limits=Limits(np.full(3, -2.5), np.full(3, 2.5)))
    smooth = np.linspace([0.2, 0.1, 0.6], [0.6, 0.3, 1.2], 12)
    assert not jumps(free.chain, smooth).size
    foot = free.foot_positions(smooth)
    mirrored = replace(free, near=np.array([1.0, 0.1, -0.8])).joint_angles(foot)
    assert not jumps(free.chain, mirrored).size
    spliced = np.vstack([smooth[:4], mirrored[4:]])
    np.testing.assert_array_equal(free.jumps(spliced), [3])


def test_the_first_pose_is_one_from_which_the_path_need_not_jump():
    limits = Limits(np.array([-0.5, -1.0, -1.0]), np.array([0.5, 1.0, 1.0]))
    leg = replace(reference_leg(), limits=limits)
    angles = np.linspace([-0.45, 0.1, 0.6], [0.45, 0.1, 0.6], 60)
    foot = leg.foot_positions(angles)
    poses = limits.wrap(leg.closed_form.poses(foot))
    feet = leg.foot_positions(poses.reshape(-1, 3)).reshape(60, 4, 3)
    allowed = np.linalg.norm(feet - foot[:, None], axis=2) <= REACHED
    deepest = poses[0, np.argmax(np.where(allowed[0], limits.margin(poses[0]), -np.inf))]
    assert deepest[2] < 0.0  # the other knee, which is soon out of its limits
    assert leg.jumps(replace(leg, near=deepest).joint_angles(foot[:30])).size == 0
    np.testing.assert_allclose(leg.joint_angles(foot), angles, atol=1e-6)


@given(scale=st.floats(0.5, 2.0), ratio=st.floats(0.6, 1.6))
def test_the_standing_pose_is_dexterous_and_within_the_limits(scale, ratio, tmp_path_factory):
    joints = [
        Joint((0.2, 0.1, 0), X, lower=-0.8, upper=0.8),
        Joint((0, 0.03, 0), Y, lower=-3.0, upper=3.0),
        Joint((0, 0, -0.2 * scale), Y, lower=-2.7, upper=2.7),
    ]
    leg = made_up_leg(tmp_path_factory.mktemp("leg"), joints, (0, 0, -0.2 * ratio))
    pose = standing_pose(leg)
    assert (pose >= leg.limits.lower).all()
    assert (pose <= leg.limits.upper).all()
    tried = np.random.default_rng(1).uniform(*leg.limits, (2000, 3))
    degree = 0.03  # the pose is rounded to a degree
    best = dexterity(leg.chain, tried).max()
    assert dexterity(leg.chain, pose[None])[0] >= (0.9 - degree) * best * 0.98
    assert leg.foot_positions(pose[None])[0, 2] < -0.5 * (0.2 * scale + 0.2 * ratio) * 0.5


def test_of_two_poses_that_are_as_good_a_leg_stands_with_its_knee_at_a_positive_angle(tmp_path):
    hip = Joint((0, 0, 0), Y, lower=-2.0, upper=2.0)
    knee = Joint((0, 0, -0.2), Y, lower=-2.5, upper=2.5)
    leg = made_up_leg(tmp_path, [Joint((0, 0, 0), X), hip, knee], (0, 0, -0.2))
    assert standing_pose(leg)[2] > 0.5
