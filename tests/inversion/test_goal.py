"""Costs of errors to second order, and the errors of angles and of feet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinematics import Leg
from planner.inversion.foot.invert import FollowFoot
from planner.inversion.goal import LEAST_WEIGHT, Errors, FollowAngles, quadratic
from tests.kinematics.made_up_robots import Joint, ers210a_leg, made_up_leg

STEP = 1e-6
"""Step of the central differences [rad]."""

SLOPES = 1e-7
"""Central differences of a cost of about one are right to this, relative to the cost."""

CURVATURES = 1e-5
"""The same for differences of gradients."""

ROUNDING = 1e-13
"""Two routes through the same few products agree to this [relative]."""


class Lines:
    """Errors that are linear in the angles: ``offsets + jacobians angles``."""

    def __init__(self, rng, samples, errors, joints):
        self.jacobians = rng.normal(size=(samples, errors, joints))
        self.offsets = rng.normal(size=(samples, errors))
        self.angles = rng.normal(size=(samples, joints))

    def at(self, angles):
        values = self.offsets + np.einsum("kmi,ki->km", self.jacobians, angles)
        return Errors(values, self.jacobians)

    def scale_to(self, unit):
        """Bring every error between half a unit and one, where no weight is at its least."""
        lengths = np.linalg.norm(self.at(self.angles).values, axis=1)
        scale = unit * np.linspace(0.5, 1.0, len(lengths)) / lengths
        self.offsets *= scale[:, np.newaxis]
        self.jacobians *= scale[:, np.newaxis, np.newaxis]


def pushes(angles):
    """Every angle, pushed up and down by the step."""
    for index in np.ndindex(angles.shape):
        push = np.zeros_like(angles)
        push[index] = STEP
        yield index, angles + push, angles - push


@pytest.mark.parametrize("power", [2.0, 4.0, 16.0])
@pytest.mark.parametrize(("errors", "joints"), [(1, 1), (1, 3), (3, 3), (3, 2), (2, 3)])
def test_the_gradient_is_half_the_slope_of_the_value(errors, joints, power):
    lines = Lines(np.random.default_rng([errors, joints]), 5, errors, joints)
    lines.scale_to(2.0)
    options = {"power": power, "unit": 2.0, "ridge": 0.0}
    here = quadratic(lines.at(lines.angles), **options)
    for index, above, below in pushes(lines.angles):
        high, low = (quadratic(lines.at(angles), **options).value for angles in (above, below))
        slope = (high - low) / (2.0 * STEP)
        assert 2.0 * here.gradient[index] == pytest.approx(slope, abs=SLOPES * here.value)


@pytest.mark.parametrize("power", [2.0, 4.0, 16.0])
@pytest.mark.parametrize(("errors", "joints"), [(1, 1), (1, 3), (3, 3), (3, 2)])
def test_the_curvature_of_linear_errors_is_half_the_hessian(errors, joints, power):
    lines = Lines(np.random.default_rng([errors, joints]), 5, errors, joints)
    lines.scale_to(1.5)
    options = {"power": power, "unit": 1.5, "ridge": 0.0}
    here = quadratic(lines.at(lines.angles), **options)
    scale = float(np.max(np.abs(here.curvature)))
    for (sample, joint), above, below in pushes(lines.angles):
        rise = (
            quadratic(lines.at(above), **options).gradient
            - quadratic(lines.at(below), **options).gradient
        ) / (2.0 * STEP)
        np.testing.assert_allclose(
            here.curvature[sample, :, joint], rise[sample], rtol=0.0, atol=CURVATURES * scale
        )
        others = np.arange(len(rise)) != sample
        np.testing.assert_array_equal(rise[others], 0.0)


@pytest.mark.parametrize("power", [2.0, 4.0, 64.0])
def test_the_value_is_the_sum_of_powers_in_units(power):
    errors = Errors(np.array([[3.0, 4.0], [0.0, 0.0], [0.0, -10.0]]), np.zeros((3, 2, 1)))
    value = quadratic(errors, power=power, unit=10.0, ridge=0.0).value
    assert value == pytest.approx(100.0 * (0.5**power + 1.0), rel=ROUNDING)


def test_for_least_squares_the_unit_makes_no_difference():
    lines = Lines(np.random.default_rng(1), 4, 3, 2)
    errors = lines.at(lines.angles)
    one = quadratic(errors, power=2.0, unit=1.0, ridge=0.0)
    other = quadratic(errors, power=2.0, unit=7.0, ridge=0.0)
    assert one.value == pytest.approx(other.value, rel=ROUNDING)
    np.testing.assert_array_equal(one.gradient, other.gradient)
    np.testing.assert_array_equal(one.curvature, other.curvature)


@pytest.mark.parametrize("power", [2.0, 16.0])
def test_the_ridge_is_added_to_every_joint_and_to_nothing_else(power):
    lines = Lines(np.random.default_rng(2), 6, 1, 3)
    errors = lines.at(lines.angles)
    without = quadratic(errors, power=power, unit=1.0, ridge=0.0)
    ridged = quadratic(errors, power=power, unit=1.0, ridge=0.25)
    assert ridged.value == without.value
    np.testing.assert_array_equal(ridged.gradient, without.gradient)
    for with_it, plain in zip(ridged.curvature, without.curvature, strict=True):
        np.testing.assert_array_equal(with_it, plain + 0.25 * np.eye(3))
    assert np.all(np.linalg.matrix_rank(without.curvature) == 1)
    assert np.all(np.linalg.eigvalsh(ridged.curvature) > 0.2)


@pytest.mark.parametrize("power", [4.0, 64.0])
def test_an_error_of_nothing_still_has_a_curvature_and_no_gradient(power):
    jacobians = np.random.default_rng(3).normal(size=(2, 3, 3))
    errors = Errors(np.array([[0.0, 0.0, 0.0], [0.3, 0.0, -0.4]]), jacobians)
    cost = quadratic(errors, power=power, unit=0.5, ridge=0.0)
    np.testing.assert_array_equal(cost.gradient[0], 0.0)
    least = power / 2.0 * LEAST_WEIGHT * jacobians[0].T @ jacobians[0]
    np.testing.assert_allclose(cost.curvature[0], least, rtol=ROUNDING)


def test_angles_miss_desired_ones_by_their_difference():
    goal = FollowAngles(np.array([0.5, -1.0, 2.0]))
    angles = np.array([[0.0], [-1.0], [2.5]])
    errors = goal.errors(angles)
    np.testing.assert_array_equal(errors.values, [[-0.5], [0.0], [0.5]])
    np.testing.assert_array_equal(errors.jacobians, np.ones((3, 1, 1)))
    np.testing.assert_array_equal(goal.distances(angles), [0.5, 0.0, 0.5])


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
