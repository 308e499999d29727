"""What the paper reads off Figures 3 and 4 (Section 3), read off the model's answer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.identification.excitation import step_test
from planner.model.joint import JointModel
from planner.model.response import simulate

ERS210A = JointModel.ers210a()
LAG, ACCELERATION = 4, 6  # ticks, Table 1
ROUNDING = 1e-12
"""Rounding of speeds [rad/tick]."""

STARTS = 1e-4
"""A change of speed that one would see in the figure [v_max]."""


def speeds(amplitude_deg):
    """Speed of the joint, tick by tick from the upward step on [rad/tick]."""
    angles = simulate(ERS210A, step_test(math.radians(amplitude_deg)))
    return angles - np.roll(angles, 1)


def test_equation_1_is_the_amplitude_for_half_a_cycle_and_then_zero():
    requests = step_test(0.7)
    assert requests.tolist() == [0.7] * 44 + [0.0] * 44
    assert step_test(-1.0, samples=6).tolist() == [-1.0] * 3 + [0.0] * 3


def test_at_40_degrees_the_joint_rests_during_the_lag():
    # It came to rest in the half cycle before, but for the exponential tail of Equation 2.
    np.testing.assert_allclose(speeds(40.0)[: LAG + 1], 0.0, atol=STARTS * ERS210A.v_max_per_tick)


def test_at_110_degrees_the_joint_moves_on_at_top_speed_during_the_lag():
    np.testing.assert_allclose(
        speeds(110.0)[: LAG + 1], -ERS210A.v_max_per_tick, rtol=0.0, atol=ROUNDING
    )


@pytest.mark.parametrize("amplitude_deg", [40.0, 110.0])
def test_the_acceleration_takes_the_same_time_whatever_the_step(amplitude_deg):
    speed = speeds(amplitude_deg) / ERS210A.v_max_per_tick
    changing = np.flatnonzero(np.abs(np.diff(speed[: LAG + ACCELERATION + 5])) > STARTS) + 1
    assert changing.tolist() == list(range(LAG + 1, LAG + ACCELERATION + 1))
    assert speed[LAG + ACCELERATION] == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("amplitude_deg", [40.0, 110.0])
def test_the_speed_stays_at_v_max_until_the_joint_comes_near(amplitude_deg):
    angles = simulate(ERS210A, step_test(math.radians(amplitude_deg)))
    speed = angles - np.roll(angles, 1)
    far = angles[: 44 + LAG] < math.radians(amplitude_deg) - ERS210A.theta_0
    plateau = np.flatnonzero(far & (np.arange(44 + LAG) >= LAG + ACCELERATION))
    assert plateau.size >= 8
    np.testing.assert_allclose(speed[plateau], ERS210A.v_max_per_tick, atol=ROUNDING)
    assert np.max(np.abs(speed)) <= ERS210A.v_max_per_tick + ROUNDING


def test_a_joint_that_gets_there_does_not_overshoot():
    angles = simulate(ERS210A, step_test(math.radians(40.0)))
    assert np.max(angles) <= math.radians(40.0) + ROUNDING
    assert np.min(angles) >= -ROUNDING
