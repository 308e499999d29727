"""Errors of a foot and their derivatives, joint by joint."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinematics import Leg
from planner.planning.foot.invert import FollowFoot
from tests.kinematics.made_up_robots import Joint, ers210a_leg, made_up_leg

ROUNDING = 1e-13
"""Two routes through the same few products agree to this, relative."""


@pytest.fixture(params=[1, 2, 3, 6])
def leg(request, tmp_path):
    """A leg of so many joints, none like another."""
    rng = np.random.default_rng(request.param)
    numbers = rng.uniform(-0.4, 0.4, (request.param, 3, 3)).tolist()
    joints = [Joint(xyz, axis, rpy=rpy) for xyz, axis, rpy in numbers]
    return made_up_leg(tmp_path, joints, (0.1, 0.2, -0.3))


@pytest.mark.parametrize("samples", [1, 2, 3, 7])
def test_errors_of_the_foot_are_scaled_differences_joint_by_joint(samples, leg: Leg):
    rng = np.random.default_rng(samples)
    angles = rng.uniform(-1.0, 1.0, (samples, len(leg.joint_names)))
    wanted, scale = rng.normal(size=(samples, 3)), np.array([2.0, 0.0, 0.5])
    goal = FollowFoot(leg, wanted, scale)
    errors = goal.errors(angles)
    difference = scale * (leg.foot_positions(angles) - wanted)
    np.testing.assert_allclose(errors.values, difference, rtol=0.0, atol=ROUNDING)
    derivatives = scale[:, np.newaxis] * leg.jacobians(angles)
    assert errors.jacobians.shape == (samples, 3, len(leg.joint_names))
    np.testing.assert_allclose(errors.jacobians, derivatives, rtol=0.0, atol=ROUNDING)
    lengths = [math.hypot(*row) for row in difference]
    np.testing.assert_allclose(goal.distances(angles), lengths, rtol=0.0, atol=ROUNDING)


def test_a_foot_goal_keeps_its_answers_when_asked_again():
    leg = ers210a_leg("front_left")
    angles = np.random.default_rng(4).uniform(*leg.limits, (5, 3))
    goal = FollowFoot(leg, np.zeros((5, 3)), np.ones(3))
    first = goal.errors(angles)
    kept = [array.copy() for array in first]
    goal.errors(angles + 0.1)
    for array, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(array, copy)
