"""Points out of reach: the error, the nearest pose, the clamped pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics import Leg, UnreachableFoot, UnsupportedLeg
from kinematics.chain import Chain, Limits
from tests.kinematics.made_up_robots import SHAPES, made_up_leg, reference_leg

EXACT = 1e-9  # distances are right to this [m]
STRAIGHT = 0.133  # length of the stretched reference leg [m]


def around(leg, count, *, seed):
    """Points in and out of reach, some far away."""
    rng = np.random.default_rng(seed)
    foot = leg.foot_positions(rng.uniform(*leg.limits.finite, (count, 3)))
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
        np.testing.assert_allclose(
            leg.foot_positions(solution.angles), STRAIGHT * directions, atol=1e-7
        )


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


def test_clamping_needs_a_closed_form(tmp_path):
    leg = made_up_leg(tmp_path, *SHAPES["no two axes meet"])
    with pytest.raises(UnsupportedLeg, match=r"clamp.*use 'nearest'"):
        leg.joint_angles([[0.0, 0.0, 0.0]], unreachable="clamp")


def test_limits_of_many_turns_hide_no_pose(tmp_path):
    joints, tip = SHAPES["no two axes meet"]
    narrow = made_up_leg(tmp_path, [replace(j, lower=-np.pi, upper=np.pi) for j in joints], tip)
    wide = made_up_leg(tmp_path, [replace(j, lower=-40.0, upper=40.0) for j in joints], tip)
    points = around(narrow, 50, seed=6)
    expected = narrow.inverse(points, unreachable="nearest").distance
    found = wide.inverse(points[:1], unreachable="nearest")
    assert np.abs(found.angles).max() < 2 * np.pi  # not wound up for nothing
    found = wide.inverse(points, unreachable="nearest")
    np.testing.assert_allclose(found.distance, expected, atol=EXACT)
