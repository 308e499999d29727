"""Costs of errors to second order."""

from __future__ import annotations

import numpy as np
import pytest

from planner.planning.gauss_newton import OPTIONS, power_cost
from planner.planning.tracking_problem import Errors

STEP = 1e-6
"""Step of the central differences [rad]."""

SLOPES = 1e-7
"""Central differences of a cost of about one are right to this, relative to the cost."""

CURVATURES = 1e-5
"""The same for differences of gradients."""

ROUNDING = 1e-13
"""Two routes through the same few products agree to this, relative."""


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


def displaced(angles):
    """Every angle, moved up and down by the step."""
    for index in np.ndindex(angles.shape):
        move = np.zeros_like(angles)
        move[index] = STEP
        yield index, angles + move, angles - move


@pytest.mark.parametrize("power", [2.0, 4.0, 16.0])
@pytest.mark.parametrize(("errors", "joints"), [(1, 1), (1, 3), (3, 3), (3, 2), (2, 3)])
def test_the_gradient_is_half_the_slope_of_the_value(errors, joints, power):
    lines = Lines(np.random.default_rng([errors, joints]), 5, errors, joints)
    lines.scale_to(2.0)
    options = {"power": power, "unit": 2.0, "ridge": 0.0}
    here = power_cost(lines.at(lines.angles), **options)
    for index, above, below in displaced(lines.angles):
        high, low = (power_cost(lines.at(angles), **options).value for angles in (above, below))
        slope = (high - low) / (2.0 * STEP)
        assert 2.0 * here.gradient[index] == pytest.approx(slope, abs=SLOPES * here.value)


@pytest.mark.parametrize("power", [2.0, 4.0, 16.0])
@pytest.mark.parametrize(("errors", "joints"), [(1, 1), (1, 3), (3, 3), (3, 2)])
def test_the_curvature_of_linear_errors_is_half_the_hessian(errors, joints, power):
    lines = Lines(np.random.default_rng([errors, joints]), 5, errors, joints)
    lines.scale_to(1.5)
    options = {"power": power, "unit": 1.5, "ridge": 0.0}
    here = power_cost(lines.at(lines.angles), **options)
    scale = float(np.max(np.abs(here.curvature)))
    for (sample, joint), above, below in displaced(lines.angles):
        rise = (
            power_cost(lines.at(above), **options).gradient
            - power_cost(lines.at(below), **options).gradient
        ) / (2.0 * STEP)
        np.testing.assert_allclose(
            here.curvature[sample, :, joint], rise[sample], rtol=0.0, atol=CURVATURES * scale
        )
        others = np.arange(len(rise)) != sample
        np.testing.assert_array_equal(rise[others], 0.0)


@pytest.mark.parametrize("power", [2.0, 4.0, 64.0])
def test_the_value_is_the_sum_of_powers_in_units(power):
    errors = Errors(np.array([[3.0, 4.0], [0.0, 0.0], [0.0, -10.0]]), np.zeros((3, 2, 1)))
    value = power_cost(errors, power=power, unit=10.0, ridge=0.0).value
    assert value == pytest.approx(100.0 * (0.5**power + 1.0), rel=ROUNDING)


def test_for_least_squares_the_unit_makes_no_difference():
    lines = Lines(np.random.default_rng(1), 4, 3, 2)
    errors = lines.at(lines.angles)
    one = power_cost(errors, power=2.0, unit=1.0, ridge=0.0)
    other = power_cost(errors, power=2.0, unit=7.0, ridge=0.0)
    assert one.value == pytest.approx(other.value, rel=ROUNDING)
    np.testing.assert_array_equal(one.gradient, other.gradient)
    np.testing.assert_array_equal(one.curvature, other.curvature)


@pytest.mark.parametrize("power", [2.0, 16.0])
def test_the_ridge_is_added_to_every_joint_and_to_nothing_else(power):
    lines = Lines(np.random.default_rng(2), 6, 1, 3)
    errors = lines.at(lines.angles)
    without = power_cost(errors, power=power, unit=1.0, ridge=0.0)
    ridged = power_cost(errors, power=power, unit=1.0, ridge=0.25)
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
    cost = power_cost(errors, power=power, unit=0.5, ridge=0.0)
    np.testing.assert_array_equal(cost.gradient[0], 0.0)
    least = power / 2.0 * OPTIONS.least_weight * jacobians[0].T @ jacobians[0]
    np.testing.assert_allclose(cost.curvature[0], least, rtol=ROUNDING)
