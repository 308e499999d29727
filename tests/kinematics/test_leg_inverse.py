"""Joint angles from foot positions: exact where reachable, else the nearest or clamped pose."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Leg, Limits, UnreachableFoot, UnsupportedLeg
from kinematics.chain import Chain
from kinematics.inverse import nearest_poses
from tests.kinematics.made_up_robots import (
    CLOSED,
    LEGS,
    SHAPES,
    Joint,
    X,
    Y,
    angles_within,
    ers210a_leg,
    made_up_leg,
    reference_leg,
)

EXACT = 1e-9  # an answer puts the foot within this of the point [m]
CLOSE = 1e-12  # the closed form is this exact away from singular poses [m]

SAME_POSE = 1e-6
"""Poses found by two routes agree to this [rad]; a singular pose is known to √eps only."""

STRAIGHT = 0.133  # length of the stretched reference leg [m]


@pytest.mark.parametrize("name", [*SHAPES, *LEGS])
@given(data=st.data())
@settings(max_examples=20)
def test_the_inverse_undoes_the_forward_kinematics_on_every_kind_of_leg(
    name, data, tmp_path_factory
):
    made_up = name in SHAPES and made_up_leg(tmp_path_factory.mktemp("robot"), *SHAPES[name])
    leg = made_up or ers210a_leg(name)
    foot = leg.foot_positions(data.draw(angles_within(leg)))
    found = leg.joint_angles(foot)
    assert np.linalg.norm(leg.foot_positions(found) - foot, axis=1).max() < EXACT
    assert (found >= leg.limits.lower).all()
    assert (found <= leg.limits.upper).all()


def test_legs_with_neighbouring_axes_that_meet_have_a_closed_form_which_clamping_needs(tmp_path):
    for name, (joints, tip) in SHAPES.items():
        leg = made_up_leg(tmp_path, joints, tip)
        assert (leg.closed_form is not None) == (name in CLOSED)
    assert all(ers210a_leg(name).closed_form is not None for name in LEGS)
    assert reference_leg().closed_form is not None
    leg = made_up_leg(tmp_path, *SHAPES["no two axes meet"])
    with pytest.raises(UnsupportedLeg, match=r"clamp.*use 'nearest'"):
        leg.joint_angles([[0.0, 0.0, 0.0]], unreachable="clamp")


@pytest.mark.parametrize(
    ("joints", "tip"),
    [
        ([Joint((0, 0, 0), Y), Joint((0, 0, -0.1), Y), Joint((0, 0, -0.1), Y)], (0, 0, -0.1)),
        ([Joint((0, 0, 0), Y), Joint((0, 0, 0), X), Joint((0, 0, 0), Y)], (0, 0, -0.1)),
        ([Joint((0, 0, 0), X), Joint((0, 0, 0), X), Joint((0, 0, -0.1), Y)], (0, 0, -0.1)),
    ],
    ids=["three parallel axes", "a wrist", "one axis twice"],
)
def test_a_leg_that_cannot_move_its_foot_in_three_directions_is_searched(joints, tip, tmp_path):
    leg = made_up_leg(tmp_path, joints, tip)
    assert leg.closed_form is None
    foot = leg.foot_positions(np.random.default_rng(1).uniform(-1.0, 1.0, (5, 3)))
    np.testing.assert_allclose(leg.foot_positions(leg.joint_angles(foot)), foot, atol=EXACT)
    with pytest.raises(UnreachableFoot):
        leg.joint_angles(foot + 0.3)


@pytest.mark.parametrize("name", CLOSED)
def test_the_closed_form_finds_every_pose_that_the_search_finds(name, tmp_path):
    leg = made_up_leg(tmp_path, *SHAPES[name])
    free = replace(leg, limits=Limits(np.full(3, -np.pi), np.full(3, np.pi)))
    foot = leg.foot_positions(np.random.default_rng(5).uniform(*leg.limits, (30, 3)))
    enumerated = free.closed_form.poses(foot)
    searched = nearest_poses(leg.chain, free.limits, foot)
    count = 0
    for point, poses, candidates in zip(foot, searched, enumerated, strict=True):
        reached = np.linalg.norm(leg.foot_positions(poses) - point, axis=1) < CLOSE
        for pose in poses[reached]:
            off = np.remainder(candidates - pose + np.pi, 2 * np.pi) - np.pi
            assert np.abs(off).max(axis=1).min() < SAME_POSE
            count += 1
    assert count > len(foot)  # several poses for most points, or the test shows little


@pytest.mark.parametrize("name", SHAPES)
def test_a_path_through_the_middle_of_the_range_comes_back_as_it_went_in(name, tmp_path):
    shape = made_up_leg(tmp_path, *SHAPES[name])
    phase = np.linspace(0.0, 2.0 * np.pi, 200)[:, None]
    angles = 0.4 * np.sin(phase + np.arange(3.0)) + [0.1, 0.2, 1.2]
    found = shape.joint_angles(shape.foot_positions(angles))
    assert np.abs(np.diff(found, axis=0)).max() < 0.1  # no jump between poses


def test_a_path_stays_on_its_pose_where_a_single_point_would_take_another():
    ends = np.array([0.5, 1.0, 1.0])
    leg = replace(reference_leg(), limits=Limits(-ends, ends))
    angles = np.linspace([0.0, 0.2, 0.6], [-0.45, 0.2, 0.6], 20)
    foot = leg.foot_positions(angles)
    np.testing.assert_allclose(leg.joint_angles(foot), angles, atol=SAME_POSE)
    alone = leg.joint_angles(foot[-1:])  # the rotator is near its limit: the other knee is deeper
    assert alone[0, 2] == pytest.approx(-0.6, abs=0.05)


def endless_leg(folder, name, *, end=np.inf):
    """A leg all of whose joints can turn by several turns, or for ever."""
    joints, tip = ENDLESS[name]
    kind = "continuous" if np.isinf(end) else "revolute"
    return made_up_leg(folder, [replace(j, kind=kind, lower=-end, upper=end) for j in joints], tip)


ENDLESS = {
    "closed form": SHAPES[CLOSED[0]],
    "searched": SHAPES["no two axes meet"],
    "two links": ([Joint((0, 0, 0), Y), Joint((0, 0, -0.1), Y)], (0.0, 0.0, -0.1)),
}


@pytest.mark.parametrize("end", [np.inf, 40.0])
@pytest.mark.parametrize("name", ENDLESS)
@given(data=st.data())
@settings(max_examples=4)
def test_a_path_of_endless_joints_starts_within_half_a_turn_and_goes_the_short_way_round(
    name, end, data, tmp_path_factory
):
    leg = endless_leg(tmp_path_factory.mktemp("leg"), name, end=end)
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    count = len(leg.joint_names)
    phase = np.linspace(0.0, 2.0 * np.pi, 30)[:, None] + rng.uniform(0.0, 6.0, count)
    foot = leg.foot_positions(rng.uniform(-9.0, 9.0, count) + rng.uniform(0, 4) * np.sin(phase))
    for mode, points in (("raise", foot), ("nearest", foot + 0.1 * rng.normal(size=3))):
        solution = leg.inverse(points, unreachable=mode)
        assert np.abs(solution.angles[0]).max() <= np.pi
        assert np.abs(np.diff(solution.angles, axis=0)).max() <= np.pi + SAME_POSE
        assert mode == "nearest" or solution.distance.max() < EXACT


def test_a_path_starts_on_the_turn_from_which_it_stays_within_the_limits(tmp_path):
    leg = endless_leg(tmp_path, "closed form", end=8.0)
    angles = np.linspace([-7.5, 0.3, 1.0], [7.5, 0.5, 1.3], 200)
    foot = leg.foot_positions(angles)
    found = leg.joint_angles(foot)
    assert np.abs(found[0, 0]) > np.pi
    assert np.abs(np.diff(found, axis=0)).max() < 0.1
    assert (np.abs(found) <= 8.0).all()
    np.testing.assert_allclose(leg.foot_positions(found), foot, atol=EXACT)


@pytest.mark.parametrize("name", ENDLESS)
def test_a_path_of_endless_joints_starts_within_half_a_turn_of_the_pose_asked_for(name, tmp_path):
    leg = endless_leg(tmp_path, name)
    pose = np.array([17.0, -9.0, 8.5])[: len(leg.joint_names)]
    found = replace(leg, near=pose).joint_angles(leg.foot_positions([pose]))
    np.testing.assert_allclose(found, [pose], atol=SAME_POSE)


@pytest.mark.parametrize("knee", [0.0, 1e-9, 1e-7, 1e-5, -1e-6])
def test_the_fully_stretched_leg_is_within_reach(knee):
    leg = reference_leg()
    foot = leg.foot_positions([[0.4, 0.3, knee]])
    solution = leg.inverse(foot)
    assert solution.distance.max() < EXACT
    assert abs(solution.angles[0, 2]) < 1e-4
    with pytest.raises(UnreachableFoot):
        leg.joint_angles(foot * (1.0 + 5e-8))


def test_a_foot_on_the_hips_own_axis_is_within_reach():
    leg = reference_leg()  # straight out to the side the rotator turns the foot on the spot
    wide = replace(leg, limits=Limits(np.full(3, -2.5), np.full(3, 2.5)))
    foot = wide.foot_positions([[0.7, 0.5 * np.pi, 0.0]])
    np.testing.assert_allclose(foot, [[0.0, 0.133, 0.0]], atol=CLOSE)
    assert wide.inverse(foot).distance.max() < EXACT


def around(leg, count, *, seed):
    """Points in and out of reach, some far away."""
    rng = np.random.default_rng(seed)
    foot = leg.foot_positions(rng.uniform(*leg.limits.central, (count, 3)))
    return foot + rng.normal(size=(count, 3)) * np.ptp(foot, axis=0) * rng.uniform(0, 1, (count, 1))


def test_random_legs_hide_no_nearer_pose_either():
    rng = np.random.default_rng(8)
    for _ in range(15):
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        turns, _ = np.linalg.qr(rng.normal(size=(3, 3, 3)))
        turns *= np.linalg.det(turns)[:, None, None]
        chain = Chain(turns, 0.1 * rng.normal(size=(3, 3)), axes, 0.1 * rng.normal(size=3))
        limits = Limits(-rng.uniform(0.3, 3.1, 3), rng.uniform(0.3, 3.1, 3))
        leg = Leg("base", "foot", ("a", "b", "c"), limits, chain)
        points = around(leg, 40, seed=9)
        found = leg.inverse(points, unreachable="nearest").distance
        grid = np.array(np.meshgrid(*np.linspace(*limits, 15).T)).reshape(3, -1).T
        least = np.linalg.norm(leg.foot_positions(grid) - points[:, None], axis=-1).min(axis=1)
        assert (found <= least + EXACT).all()


def test_beyond_a_stretched_leg_the_nearest_point_lies_on_the_way_to_the_hip():
    leg = reference_leg()
    directions = np.array([[0.3, 0.2, -1.0], [-0.5, 0.1, -0.8], [0.6, 0.5, -0.3]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for reach in (STRAIGHT + 1e-6, 0.2, 10.0):
        solution = leg.inverse(reach * directions, unreachable="nearest")
        np.testing.assert_allclose(solution.distance, reach - STRAIGHT, atol=EXACT)
        found = leg.foot_positions(solution.angles)
        np.testing.assert_allclose(found, STRAIGHT * directions, atol=1e-7)


@pytest.mark.parametrize("name", SHAPES)
def test_the_error_lists_which_points_are_out_of_reach_and_by_how_much(name, tmp_path):
    leg = made_up_leg(tmp_path, *SHAPES[name])
    foot = np.array(leg.foot_positions(np.tile([0.1, 0.2, 1.0], (30, 1))))
    foot[[4, 17]] += [[0.0, 0.0, 3.0], [2.0, 0.0, 0.0]]
    nearest = leg.inverse(foot, unreachable="nearest")
    with pytest.raises(UnreachableFoot, match=r"2 of 30 .* indices: 4, 17; .*'nearest'") as error:
        leg.joint_angles(foot)
    np.testing.assert_array_equal(error.value.indices, [4, 17])
    np.testing.assert_allclose(error.value.distances, nearest.distance[[4, 17]], atol=EXACT)
    assert not error.value.indices.flags.writeable
    assert not error.value.distances.flags.writeable
