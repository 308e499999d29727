"""Derivatives of the angles against central differences; of periods: ``test_friction.py``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.exceptions import NoSteadyCycle
from planner.model.joint import JointModel, request_ages
from planner.model.response import sensitivities, simulate
from tests.instances import random_model_outside_equation_13
from tests.model.rounded_periods import rounded_periods

ERS210A = JointModel.ers210a()

SAME = 1e-13
"""Two routes through one period [rad]."""

HALF_STEP = 1e-6
"""Half the distance of the central differences of angles [rad]."""

AGREEMENT = 1e-5
"""What is left of a cycle's 1e-12 rad after division by HALF_STEP, and room for amplification."""


def test_smoothing_is_measured_in_each_joints_own_errors():
    small = replace(ERS210A, v_max=ERS210A.v_max / 4.0, theta_0=ERS210A.theta_0 / 4.0)
    rng = np.random.default_rng(4)
    column, windows = rng.normal(size=30), rng.normal(size=(30, request_ages(ERS210A).width))
    whole = rounded_periods(ERS210A, column, windows, 0.5).states
    quarter = rounded_periods(small, column / 4.0, windows / 4.0, 0.5).states
    np.testing.assert_allclose(quarter, whole / 4.0, rtol=0.0, atol=SAME)


def differences(model, requests, **options):
    """Central differences of the angles, shape (n, n)."""
    columns = []
    for j in range(len(requests)):
        ahead, behind = requests.copy(), requests.copy()
        ahead[j] += HALF_STEP
        behind[j] -= HALF_STEP
        change = simulate(model, ahead, **options) - simulate(model, behind, **options)
        columns.append(change / (2.0 * HALF_STEP))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("cyclic", [True, False])
def test_sensitivities_hold_for_joints_outside_equation_13(cyclic, seed):
    rng = np.random.default_rng(seed)
    model = random_model_outside_equation_13(rng)
    requests = rng.uniform(-1.0, 1.0, size=20) * model.theta_0
    np.testing.assert_allclose(
        sensitivities(model, requests, cyclic=cyclic),
        differences(model, requests, cyclic=cyclic),
        rtol=0.0,
        atol=AGREEMENT,
    )


@pytest.mark.parametrize("error", [0.015, 0.04, 0.072, 0.076, 0.09])
def test_the_first_speed_from_rest_is_limited_by_the_drive_and_not_by_the_steady_speed(error):
    model = JointModel(
        v_max=5.0,
        theta_0=0.1,
        lag=0.016,
        acceleration_time=0.024,
        dead_band=0.01,
        max_acceleration=400.0,  # of a drive whose error is 0.064 rad beyond the dead band
    )
    options = {"cyclic": False, "start": 0.0}
    requests = np.full(6, error)
    np.testing.assert_allclose(
        sensitivities(model, requests, **options),
        differences(model, requests, **options),
        rtol=0.0,
        atol=AGREEMENT,
    )


@pytest.mark.parametrize("cyclic", [True, False])
def test_raising_every_request_raises_every_angle_by_as_much(cyclic):
    rng = np.random.default_rng(11)
    requests = rng.uniform(-0.3, 0.3, size=30)
    derivatives = sensitivities(JointModel.ers210a(), requests, cyclic=cyclic)
    np.testing.assert_allclose(derivatives.sum(axis=1), 1.0, rtol=0.0, atol=1e-12)
    assert not derivatives.flags.writeable


def test_at_a_corner_the_derivative_is_the_mean_of_both_sides():
    model = JointModel(v_max=3.125, theta_0=0.125, lag=0.0, acceleration_time=0.008, tick=0.008)
    inside = model.v_max_per_tick / model.theta_0  # slope of f below the corner; 0 above it
    # The second request acts on the third sample from exactly theta_0 away.
    requests = np.array([0.0, 0.125, 0.0])
    derivatives = sensitivities(model, requests, cyclic=False)
    assert derivatives[2, 1] == pytest.approx(inside / 2.0, rel=1e-12)


def test_a_cycle_without_a_derivative_is_an_error(monkeypatch):
    # Between saturated requests the joint may rest anywhere in a range; put it in its middle.
    monkeypatch.setattr(
        "planner.model.response.motion_under", lambda *_arguments, **_options: np.zeros((3, 2))
    )
    with pytest.raises(NoSteadyCycle):
        sensitivities(JointModel.ers210a(), [5.0, -5.0])
