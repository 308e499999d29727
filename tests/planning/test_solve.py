"""From a task to searches: what each of them is given, and which answer is taken."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from planner.model.evidence import Evidence
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning import solve as searches
from planner.planning.result import UNFORESEEN
from planner.planning.solve import Solved, solve
from planner.planning.task import Task

ERS210A = JointModel.ers210a()
PHASE = 2.0 * np.pi * np.arange(40) / 40
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE), 0.1 * np.sin(2.0 * PHASE)])


@pytest.fixture
def single(monkeypatch):
    """The tasks of the joints that are planned one by one; their plans are the desired angles."""
    given = []

    def record(task, **options):
        given.append((task, options))
        several = len(task.scenarios) > 1
        return Solved(task.desired, task.desired + 1.0 if several else None)

    monkeypatch.setattr(searches, "solve_joint", record)
    return given


def test_a_share_of_a_measured_disturbance_replaces_what_models_were_known_to_miss(single):
    known = ERS210A.with_evidence(Evidence(0.1))
    task = Task.of([[known, known]] * 3, DESIRED)
    solve(task)
    solve(replace(task, disturbance=np.tile([0.01, -0.02, 0.0], (len(DESIRED), 1))))
    errors = [[model.evidence.error for model in each.models[0]] for each, _ in single]
    shares = [[pytest.approx(UNFORESEEN * size)] * 2 for size in (0.01, 0.02, 0.0)]
    assert errors == [[0.1] * 2] * 3 + shares


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("several", "smoothness"), [(False, 0.005), (False, 0.0), (True, 0.005)])
def test_the_first_request_leaves_the_middle_of_the_band_for_the_side_of_the_motion(
    way, several, smoothness
):
    """For a single model alone: several may have other bands."""
    sticky = replace(ERS210A, dead_band=0.03)
    steep = way * 0.6 * np.minimum(np.arange(30) / 10.0, 1.0)[:, np.newaxis]
    models = [[sticky, replace(sticky, lag=0.04)]] if several else [sticky]
    made = solve(Task.of(models, steep, cyclic=False, smoothness=smoothness))
    first = float(made.requests[0, 0])
    assert abs(first) < 0.03
    assert first == 0.0 if several else way * first == pytest.approx(0.03, rel=1e-6)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("loaded", [True, False])
def test_the_ideal_is_the_nearest_trajectory_within_the_speeds_of_either_direction(loaded, cyclic):
    """By a convex solver; each step has the speeds under the torque of the sample where it ends."""
    model = replace(ERS210A, v_offset=0.8, speed_per_torque=0.9, compliance=0.01)
    load = np.cos(0.3 * np.arange(40)) if loaded else None
    desired = 0.4 * np.sin(2.0 * np.pi * np.arange(40) / 40) + 0.1 * np.cos(
        0.3 * np.pi * np.arange(40)
    )
    made = searches.nearest_within_speeds(model, desired, load, cyclic=cyclic)
    low, high = (
        np.broadcast_to(limit, 40) * model.period
        for limit in model.speed_limits(0.0 if load is None else load)
    )
    x = cp.Variable(40)
    steps, first = cp.diff(x), 0 if cyclic else 1
    if cyclic:
        steps = cp.hstack([x[0] - x[-1], steps])
    problem = cp.Problem(
        cp.Minimize(cp.sum_squares(x - desired)), [steps >= low[first:], steps <= high[first:]]
    )
    problem.solve(solver=cp.CLARABEL)
    np.testing.assert_allclose(made, x.value, rtol=0.0, atol=1e-4)  # the solver's


@pytest.mark.parametrize("load", [None, -0.5])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_from_rest_a_joint_is_within_reach_of_its_top_speed_from_the_second_request_on(way, load):
    model = replace(ERS210A, lag=0.028, hold=2, v_offset=0.8, speed_per_torque=0.9)
    torques = None if load is None else np.full(30, load)
    far = searches.within_attainable_range(model, np.full(30, 99.0 * way), 0.5, torques)
    jump = np.full(30, 99.0 * way)
    jump[0] = 0.5
    angles = simulate(model, jump, cyclic=False, start=0.5, load=torques)
    assert np.all(way * (far - angles) >= -1e-12)
    np.testing.assert_array_equal(far == 0.5, angles == 0.5)
    top = model.speed_limits(load or 0.0)[1 if way > 0.0 else 0] * model.period
    np.testing.assert_allclose(np.diff(far[far != 0.5]), top)
    np.testing.assert_allclose(np.diff(angles)[-3:], top)
