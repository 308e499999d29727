"""Derivatives of the angles against central differences; of periods: ``test_friction.py``."""

from __future__ import annotations

import numpy as np
import pytest

from planner.model.joint import JointModel
from planner.model.response import sensitivities, simulate
from tests.instances import random_model_outside_equation_13

HALF_STEP = 1e-6
"""Half the distance of the central differences of angles [rad]."""

AGREEMENT = 1e-5
"""What is left of a cycle's 1e-12 rad after division by HALF_STEP, and room for amplification."""


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
