"""The joint's answer against Equation 3 written out, and what must hold of any answer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import JointModel, NoSteadyCycle, simulate
from planner.model.response import path_speeds
from tests.independent import next_cycle, of_whole_ticks
from tests.instances import ERS210A
from tests.strategies import models, trajectories

SAME = 1e-12
"""Two ways to run the same recursion over a few hundred ticks agree to this [rad]."""


@given(models(whole=True, holds=(1, 1), offsets=False), trajectories(), st.floats(-1.0, 1.0))
def test_whole_ticks_are_equation_3_to_the_letter(model, requests, start):
    expected = of_whole_ticks(model, requests, start)
    angles = simulate(model, requests, cyclic=False, start=start)
    np.testing.assert_allclose(angles, expected, rtol=0.0, atol=SAME)


def test_a_cycle_that_only_drifts_settles_where_the_requests_balance():
    requests = np.repeat([50.0, -50.0], [45, 43])  # radians: 2 ticks of drift in every 88
    angles = simulate(ERS210A, requests)
    np.testing.assert_allclose(next_cycle(ERS210A, requests, angles[-1]), angles, atol=1e-9)
    assert np.max(angles) == pytest.approx(50.0, abs=1.0)


def test_requests_without_a_steady_cycle_in_reach_are_an_error_with_the_mismatch():
    """Its acceleration limit makes the joint ring for ever."""
    joint = JointModel(
        v_max=5.25, theta_0=0.247, lag=0.01, acceleration_time=0.02, tick=0.001, hold=20,
        dead_band=0.016, max_acceleration=22.0,
    )  # fmt: skip
    turns = 2.0 * np.pi * np.arange(11, 51) / 40
    requests = np.radians(
        18.0 * np.sin(turns) + 5.0 * np.sin(2.0 * turns + 1.0) + 3.0 * np.sin(3.0 * turns + 2.0)
    )
    with pytest.raises(NoSteadyCycle, match="no steady cycle after 200 cycles") as caught:
        simulate(joint, requests)
    assert caught.value.cycles == 200
    assert 1e-9 < caught.value.mismatch < 1.0


@pytest.mark.parametrize("ratio", [0.9, 1.1, 1.9375])  # of v_max per tick to theta_0
@pytest.mark.parametrize("hold", [1, 2, 3])
@pytest.mark.parametrize("requests", [[0.125, 0.0], [-1.0, -0.515625, -1.0], [0.0, 3.0, 3.0, 0.1]])
def test_a_joint_that_overshoots_has_a_steady_cycle_too(requests, hold, ratio):
    model = JointModel(
        v_max=ratio * 25.0, theta_0=0.25, lag=0.0, acceleration_time=0.01, tick=0.01, hold=hold
    )
    angles = simulate(model, requests)
    np.testing.assert_allclose(next_cycle(model, requests, angles[-1]), angles, atol=1e-11)


def test_a_path_is_too_fast_by_the_top_speed_of_its_direction_under_its_load():
    """1 rad/s faster up than down, and 0.5 rad/s faster under the half of 1 N m in a step."""
    joint = JointModel(
        v_max=4.0,
        theta_0=0.5,
        lag=0.0,
        acceleration_time=0.1,
        tick=0.1,
        v_offset=0.5,
        speed_per_torque=1.0,
    )
    path = np.array([0.0, 0.4, 0.0, 0.5])
    found = path_speeds(joint, path, cyclic=True, load=np.array([0.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(found.speeds, [4.0, -4.0, 5.0, -5.0], atol=1e-12)
    np.testing.assert_allclose(found.limits, [4.5, -3.5, 5.0, -3.0], atol=1e-12)
    assert found.too_fast.tolist() == [False, True, False, True]
    assert found.highest == pytest.approx((5.0, 3.0))
    steady = path_speeds(joint, 0.45 * np.arange(9), cyclic=False)
    assert not steady.too_fast.any()
