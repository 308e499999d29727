"""The best trajectory within a joint's top speeds, from which its search starts."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from planner import simulate
from planner.planning.closed_form import nearest_within_speeds, within_attainable_range
from tests.instances import ERS210A


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("loaded", [True, False])
def test_the_ideal_is_the_nearest_trajectory_within_the_speeds_of_either_direction(loaded, cyclic):
    """By a convex solver; each step has the speeds under the torque of the sample where it ends."""
    model = replace(ERS210A, v_offset=0.8, speed_per_torque=0.9, compliance=0.01)
    load = np.cos(0.3 * np.arange(40)) if loaded else np.zeros(40)
    desired = 0.4 * np.sin(2.0 * np.pi * np.arange(40) / 40) + 0.1 * np.cos(
        0.3 * np.pi * np.arange(40)
    )
    made = nearest_within_speeds(model, desired, load, cyclic=cyclic)
    low, high = (np.broadcast_to(limit, 40) * model.period for limit in model.speed_limits(load))
    x = cp.Variable(40)
    steps, first = cp.diff(x), 0 if cyclic else 1
    if cyclic:
        steps = cp.hstack([x[0] - x[-1], steps])
    problem = cp.Problem(
        cp.Minimize(cp.sum_squares(x - desired)), [steps >= low[first:], steps <= high[first:]]
    )
    problem.solve(solver=cp.CLARABEL)
    np.testing.assert_allclose(made, x.value, rtol=0.0, atol=1e-4)  # the solver's


@pytest.mark.parametrize("load", [0.0, -0.5])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_from_rest_a_joint_is_within_reach_of_its_top_speed_from_the_second_request_on(way, load):
    model = replace(ERS210A, lag=0.028, hold=2, v_offset=0.8, speed_per_torque=0.9)
    torques = np.full(30, load)
    far = within_attainable_range(model, np.full(30, 99.0 * way), 0.5, torques)
    jump = np.full(30, 99.0 * way)
    jump[0] = 0.5
    angles = simulate(model, jump, cyclic=False, start=0.5, load=torques)
    assert np.all(way * (far - angles) >= -1e-12)
    np.testing.assert_array_equal(far == 0.5, angles == 0.5)
    top = model.speed_limits(load)[1 if way > 0.0 else 0] * model.period
    np.testing.assert_allclose(np.diff(far[far != 0.5]), top)
    np.testing.assert_allclose(np.diff(angles)[-3:], top)
