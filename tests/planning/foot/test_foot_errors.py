"""Errors of a foot and their derivatives, joint by joint."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinematics import Leg
from planner.model.joint import JointModel
from planner.planning.problem import FootGoal, Problem
from tests.kinematics.made_up_robots import Joint, made_up_leg

ROUNDING = 1e-13
"""Two routes through the same few products agree to this, relative."""


@pytest.fixture(params=[1, 2, 3, 6])
def leg(request, tmp_path):
    """A leg of so many joints, none like another."""
    rng = np.random.default_rng(request.param)
    numbers = rng.uniform(-0.4, 0.4, (request.param, 3, 3)).tolist()
    joints = [Joint(xyz, axis, rpy=rpy) for xyz, axis, rpy in numbers]
    return made_up_leg(tmp_path, joints, (0.1, 0.2, -0.3))


def following(leg: Leg, desired, scale, added=0.0):
    """The problem of a foot that should follow a path."""
    joints, samples = len(leg.joint_names), len(desired)
    model = JointModel.ers210a()
    disturbance = np.broadcast_to(added, (samples, joints)).copy()
    return Problem(
        models=(model,) * joints,
        desired=np.zeros((samples, joints)),
        lower=np.full(joints, -np.inf),
        upper=np.full(joints, np.inf),
        max_step=np.full(joints, np.inf),
        loads=(None,) * joints,
        foot=FootGoal(leg, desired, scale, disturbance),
    )


@pytest.mark.parametrize("samples", [1, 2, 3, 7])
def test_errors_of_the_foot_are_scaled_differences_joint_by_joint(samples, leg: Leg):
    rng = np.random.default_rng(samples)
    joints = len(leg.joint_names)
    angles, added = rng.uniform(-1.0, 1.0, (2, samples, joints))
    wanted, scale = rng.normal(size=(samples, 3)), np.array([2.0, 0.0, 0.5])
    problem = following(leg, wanted, scale, added)
    (values,), (jacobians,) = (each.swapaxes(0, 1) for each in problem.errors(angles))
    difference = scale * (leg.foot_positions(angles + added) - wanted)
    np.testing.assert_allclose(values, difference, rtol=0.0, atol=ROUNDING)
    derivatives = scale[:, np.newaxis] * leg.jacobians(angles + added)
    assert jacobians.shape == (samples, 3, joints)
    np.testing.assert_allclose(jacobians, derivatives, rtol=0.0, atol=ROUNDING)
    mean = np.sqrt(np.mean([math.hypot(*row) ** 2 for row in difference]))
    assert problem.error(angles) == pytest.approx(mean, rel=ROUNDING)
