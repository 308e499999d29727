"""Stacked joints: what their models make of requests, run and period by period."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.gauss_newton import Stage, allocated, evaluate
from planner.planning.problem import Problem, track
from tests.instances import TICK, random_model, saturating

ERS210A = JointModel.ers210a()

SAME = 1e-9
"""Agreement of the compiled run and the simulation: cycles are closed to 1e-11 [rad]."""

CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
HELD = pytest.mark.parametrize("hold", [1, 3])


def stacked(seed, joints, *, samples=30, hold=1, cyclic=True, limits=None):
    """Joints of different lag, sag and tick, but of one period, and requests for them."""
    rng = np.random.default_rng([seed, joints, hold, cyclic])
    models = [random_model(rng, whole=False, hold=hold, offset=True) for _ in range(joints)]
    models[0] = replace(models[0], tick=TICK / 2.0, hold=2 * hold)
    resting = np.stack([saturating(rng, model, samples=samples) for model in models], axis=1)
    offsets = np.array([model.offset for model in models])
    lower, upper = limits or (np.full(joints, -np.inf), np.full(joints, np.inf))
    problem = Problem(
        models=tuple(models),
        desired=resting + offsets,
        lower=lower,
        upper=upper,
        max_step=np.full(joints, np.inf),
        loads=(None,) * joints,
        cyclic=cyclic,
        start=None if cyclic else resting[0] + offsets,
    )
    requests = problem.admissible(resting + rng.uniform(-0.1, 0.1, resting.shape))
    return problem, requests


@CYCLIC
@HELD
@pytest.mark.parametrize("joints", [1, 2, 3])
def test_the_exact_angles_are_those_of_the_simulation(joints, hold, cyclic):
    problem, requests = stacked(1, joints, hold=hold, cyclic=cyclic)
    angles = problem.exact_angles(requests)
    for joint, model in enumerate(problem.models):
        start = None if cyclic else float(problem.start[joint])
        alone = simulate(model, requests[:, joint], cyclic=cyclic, start=start)
        np.testing.assert_allclose(angles[:, joint], alone, rtol=0.0, atol=SAME)


def reached(problem, requests, angles, radius):
    """Where every period leads from these angles."""
    point = allocated(problem.spec, smoothing=False)
    point.requests[:], point.states[:] = requests, angles
    evaluate(problem.spec, Stage(radius, 1.0), 1.0, point)
    return angles + point.defects, point.slopes[:, 0, 0, 0]


@CYCLIC
@HELD
def test_from_the_exact_angles_every_period_leads_to_the_next_one(hold, cyclic):
    rng = np.random.default_rng([2, hold, cyclic])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    desired = saturating(rng, model, samples=30)
    start = None if cyclic else float(desired[0])
    problem = track(model, desired, cyclic=cyclic, start=start)
    requests = problem.admissible(problem.resting + rng.uniform(-0.1, 0.1, (30, 1)))
    angles = problem.exact_angles(requests)
    sharp, _ = reached(problem, requests, angles, 1e-12)
    np.testing.assert_allclose(sharp, angles, rtol=0.0, atol=SAME)
    assert np.max(np.abs(reached(problem, requests, angles, 0.3)[0] - angles)) > 1e-4


def test_from_rest_nothing_comes_before_the_first_sample():
    problem = track(ERS210A, np.linspace(0.0, 0.5, 20), cyclic=False, start=0.0)
    requests, angles = np.random.default_rng(3).normal(size=(2, 20, 1))
    first, slopes = reached(problem, requests, angles, 0.1)
    assert slopes[0] == 0.0
    angles[-1] += 1.0
    np.testing.assert_array_equal(reached(problem, requests, angles, 0.1)[0], first)


@CYCLIC
def test_joints_answer_together_as_they_do_alone(cyclic):
    problem, requests = stacked(4, 3, cyclic=cyclic)
    together = problem.exact_angles(requests)
    for joint, model in enumerate(problem.models):
        start = None if cyclic else float(problem.start[joint])
        single = track(model, np.zeros(len(requests)), cyclic=cyclic, start=start)
        column = requests[:, joint : joint + 1]
        alone = single.exact_angles(column)
        np.testing.assert_array_equal(together[:, joint], alone[:, 0])


@CYCLIC
def test_a_joint_at_top_speed_throughout_is_judged_as_it_is_simulated(cyclic):
    # Its cycles are many: each may begin higher or lower than another.
    requests = np.repeat([5.0, -5.0], 20)
    problem = track(ERS210A, np.zeros(40), cyclic=cyclic, start=None if cyclic else 0.0)
    angles = problem.exact_angles(requests[:, np.newaxis])
    alone = simulate(ERS210A, requests, cyclic=cyclic, start=None if cyclic else 0.0)
    np.testing.assert_allclose(angles[:, 0], alone, rtol=0.0, atol=SAME)


def test_one_joint_that_finds_no_cycle_leaves_the_problem_without_angles(monkeypatch):
    monkeypatch.setattr("planner.model.response.MOST_CYCLES", 2)
    both = np.full(2, np.inf)
    problem = Problem(
        models=(ERS210A, ERS210A),
        desired=np.zeros((88, 2)),
        lower=-both,
        upper=both,
        max_step=both,
        loads=(None, None),
    )
    requests = np.zeros((88, 2))
    assert problem.exact_angles(requests) is not None
    requests[:, 1] = np.repeat([-1e3, 1e3], [43, 45])  # at v_max throughout, and up for longer
    assert problem.exact_angles(requests) is None
    assert problem.exact_error(requests) == math.inf


@CYCLIC
@HELD
@pytest.mark.parametrize("norm", ["rms", "max"])
def test_the_exact_error_is_that_of_the_simulated_angles(norm, hold, cyclic):
    rng = np.random.default_rng([9, hold, cyclic])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    desired = saturating(rng, model, samples=30)
    start = None if cyclic else 0.7
    problem = track(model, desired, cyclic=cyclic, norm=norm, start=start)
    requests = problem.admissible(rng.uniform(-1.0, 1.0, (30, 1)))
    angles = simulate(model, requests[:, 0], cyclic=cyclic, start=start)
    errors = np.abs(angles - desired)
    expected = np.max(errors) if norm == "max" else math.sqrt(np.mean(errors**2))
    assert problem.exact_error(requests) == pytest.approx(expected, abs=SAME)


def test_from_rest_the_first_requests_hold_the_joints_at_their_starts():
    problem, requests = stacked(6, 2, cyclic=False)
    free = np.full_like(requests, 7.0)
    held = problem.admissible(free)
    offsets = [model.offset for model in problem.models]
    np.testing.assert_array_equal(held[0], problem.start - offsets)
    np.testing.assert_array_equal(held[1:], 7.0)


@CYCLIC
def test_each_joint_has_limits_of_its_own(cyclic):
    limits = (np.array([-0.1, -0.2]), np.array([0.3, math.inf]))
    problem, _ = stacked(7, 2, cyclic=cyclic, limits=limits)
    for requests in (problem.resting, problem.admissible(np.full((30, 2), 5.0))):
        assert np.all((requests >= limits[0]) & (requests <= limits[1]))
    np.testing.assert_array_equal(problem.admissible(np.full((30, 2), 5.0))[1:], [[0.3, 5.0]] * 29)


def test_the_error_is_that_of_the_norm():
    desired = np.array([1.0, 2.0, 3.0])
    angles = np.array([[1.0], [2.5], [1.0]])
    for norm, expected in (("rms", math.sqrt((0.25 + 4.0) / 3.0)), ("max", 2.0)):
        problem = track(ERS210A, desired, cyclic=True, norm=norm)
        assert problem.error(angles) == pytest.approx(expected, rel=1e-15)


def test_angles_miss_desired_ones_by_their_difference():
    problem = track(ERS210A, np.array([0.5, -1.0, 2.0]), cyclic=True)
    values, jacobians = problem.errors(np.array([[0.0], [-1.0], [2.5]]))
    np.testing.assert_array_equal(values, [[[-0.5]], [[0.0]], [[0.5]]])
    np.testing.assert_array_equal(jacobians, np.ones((3, 1, 1, 1)))


def test_scenarios_count_by_their_weights_and_keep_the_first_request_of_the_nominal_one():
    problem = track(ERS210A, np.zeros(3), cyclic=False, start=0.3)
    raised = replace(ERS210A, offset=0.1)
    both = problem.in_scenarios([(raised,), (ERS210A,)], [(None,)] * 2, "mean")
    np.testing.assert_array_equal(both.first_requests, problem.first_requests)
    weighted = replace(both, weights=(0.2, 0.8))
    distances = weighted.distances(np.tile([3.0, 1.0], (3, 1)))
    np.testing.assert_allclose(distances, math.sqrt(0.2 * 9.0 + 0.8 * 1.0), rtol=1e-12)
