"""Stacked joints: what their models make of requests, run and period by period."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.model.joint import JointModel
from planner.model.response import load_by_period, motion_under, simulate
from planner.planning import gauss_newton
from planner.planning.gauss_newton import Stage
from planner.planning.problem import Problem, problem_of
from planner.planning.task import Task
from tests.from_python import from_python
from tests.instances import TICK, random_model, saturating
from tests.plans import track

evaluate = from_python(gauss_newton.evaluate)
allocated = from_python(gauss_newton.allocated)

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
        loads=np.zeros((joints, samples)),
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


def test_from_rest_the_first_requests_hold_the_joints_at_their_starts():
    problem, requests = stacked(6, 2, cyclic=False)
    free = np.full_like(requests, 7.0)
    held = problem.admissible(free)
    offsets = [model.offset for model in problem.models]
    np.testing.assert_array_equal(held[0], problem.start - offsets)
    np.testing.assert_array_equal(held[1:], 7.0)


def test_the_error_is_that_of_the_norm():
    desired = np.array([1.0, 2.0, 3.0])
    angles = np.array([[1.0], [2.5], [1.0]])
    for norm, expected in (("rms", math.sqrt((0.25 + 4.0) / 3.0)), ("max", 2.0)):
        problem = track(ERS210A, desired, cyclic=True, norm=norm)
        assert problem.error(angles) == pytest.approx(expected, rel=1e-15)


def test_scenarios_count_by_their_weights_and_keep_the_first_request_of_the_nominal_one():
    problem = track(ERS210A, np.zeros(3), cyclic=False, start=0.3)
    raised = replace(ERS210A, offset=0.1)
    both = problem.in_scenarios([(raised,), (ERS210A,)], np.zeros((2, 3)), "mean")
    np.testing.assert_array_equal(both.first_requests, problem.first_requests)
    weighted = replace(both, weights=(0.2, 0.8))
    distances = weighted.distances(np.tile([3.0, 1.0], (3, 1)))
    np.testing.assert_allclose(distances, math.sqrt(0.2 * 9.0 + 0.8 * 1.0), rtol=1e-12)


def loaded(**options):
    """A joint that sags under a load, from rest, with the torque of each sample [N m]."""
    model = replace(ERS210A, compliance=0.1, offset=0.02)
    torques = np.array([1.0, -1.0, 2.0, 0.5])
    desired = np.array([0.3, 0.2, 0.1, 0.0])
    options = {"cyclic": False, "start": 0.4, "load": torques, **options}
    return track(model, desired, **options), 0.1 * torques + 0.02, desired


def test_requests_that_hold_the_desired_angles_are_lower_by_the_sag_of_each_sample():
    problem, sag, desired = loaded()
    np.testing.assert_allclose(problem.resting[1:, 0], (desired - sag)[1:])
    assert problem.resting[0, 0] == problem.first_requests[0] == pytest.approx(0.4 - sag[0])
    cyclic, _, _ = loaded(cyclic=True, start=None)
    np.testing.assert_allclose(cyclic.resting[:, 0], desired - sag)
    given, _, _ = loaded(first=0.31)
    assert given.resting[0, 0] == given.first_requests[0] == 0.31


def test_a_first_request_beyond_the_limits_is_the_nearest_within_them():
    problem, _, _ = loaded(limits=(-1.0, 0.25))
    assert problem.first_requests[0] == pytest.approx(0.28)
    assert problem.admissible(np.zeros((4, 1)))[0, 0] == 0.25
    evaluated = problem.spec.bounds
    np.testing.assert_array_equal(evaluated[:, 0, 0], [0.25, -1.0, 0.25, np.inf])


def test_limits_and_largest_steps_of_one_joint_are_kept_beside_joints_without():
    problem, requests = stacked(8, 2, cyclic=True)
    far = 3.0 * requests
    limits = np.array([-0.1, -np.inf]), np.array([np.inf, np.inf])
    low = replace(problem, lower=limits[0], upper=limits[1]).admissible(far)
    np.testing.assert_array_equal(low, np.maximum(far, limits[0]))
    steady = replace(problem, max_step=np.array([np.inf, 0.01])).admissible(far)
    np.testing.assert_array_equal(steady[:, 0], far[:, 0])
    assert np.max(np.abs(np.diff(steady[:, 1], append=steady[0, 1]))) <= 0.01
    assert replace(problem, lower=limits[0], upper=limits[1]).spec.bounded
    assert replace(problem, max_step=np.array([np.inf, 0.01])).spec.limited
    assert (problem.spec.bounded, problem.spec.limited) == (False, False)


def test_what_cycles_have_added_is_taken_off_the_desired_angles_within_the_limits():
    desired = np.array([[0.3], [0.2], [0.1]])
    added = np.array([[0.05], [-0.1], [0.2]])
    task = replace(Task.of([ERS210A], desired, limits=(-0.05, 0.3)), disturbance=added)
    np.testing.assert_allclose(problem_of(task).desired, [[0.25], [0.3], [-0.05]])


def test_the_largest_error_over_several_models_is_that_of_all_of_them_together():
    """So that powers of it lower the distances of (10), not those of each model by itself."""
    problem = track(ERS210A, np.zeros(3), cyclic=True, norm="max")
    assert allocated(problem.spec, smoothing=False).quadratic.shape[1] == 1
    several = problem.in_scenarios([(ERS210A,)] * 2, np.zeros((2, 3)), "worst")
    assert allocated(several.spec, smoothing=False).quadratic.shape[1:] == (1, 2, 3)
    each = allocated(replace(several, norm="rms").spec, smoothing=False)
    assert each.quadratic.shape[1:] == (2, 1, 2)
    angles = np.array([[0.1, 0.2], [-0.4, 0.1], [0.0, 0.3]])
    mean = math.sqrt((0.01 + 0.16 + 0.04 + 0.01 + 0.09) / 6.0)
    np.testing.assert_allclose(several.errors_of_models(angles)[1], [0.4, 0.3, mean])
    assert several.error(angles) == pytest.approx(0.4)
    even = replace(several, robust="mean")
    assert even.error(angles) == pytest.approx(math.sqrt((0.16 + 0.09) / 2.0))


def test_with_dry_friction_roughness_counts_how_far_requests_are_from_the_middle_of_the_band():
    """A tenth of the distance, beside second differences; docs/math.md, section 6."""
    rng = np.random.default_rng(5)
    for cyclic in (True, False):
        start = None if cyclic else 0.1
        plain, sticky = (
            track(replace(ERS210A, dead_band=band), np.full(6, 0.1), cyclic=cyclic, start=start)
            for band in (0.0, 0.02)
        )
        requests = rng.normal(size=(6, 1))
        bends = requests[:-2] - 2.0 * requests[1:-1] + requests[2:]
        first = requests[1] - requests[0]  # before the first the joint rests at it
        squares = float(np.sum(bends**2)) + float(first[0] ** 2)
        if cyclic:
            closed = np.vstack([requests[-1:], requests, requests[:1]])
            squares = float(np.sum(np.diff(closed, 2, axis=0) ** 2))
        assert plain.roughness(requests) == pytest.approx(squares)
        away = float(np.sum((0.1 * (requests - 0.1)) ** 2))
        assert sticky.roughness(requests) == pytest.approx(squares + away)


@CYCLIC
@pytest.mark.parametrize(
    ("inertia", "integral", "position"),
    [(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), (0.03, 12.0, 0.0), (0.03, 0.0, 4.0)],
)
def test_a_joint_whose_load_makes_it_sag_and_slower_goes_where_its_simulation_does(
    inertia, integral, position, cyclic
):
    """Each period has a torque of its own; the top speeds of the two directions differ, too."""
    model = replace(
        ERS210A,
        sag_sin=-0.04,
        sag_cos=0.02,
        compliance=0.05,
        v_offset=0.6,
        speed_per_torque=0.8,
        dead_band=0.01,
        time_constant=inertia,
        integral_rate=integral,
        position_integral_rate=position,
    )
    requests = 0.8 * np.sin(2.0 * np.pi * np.arange(60) / 30)
    torques = np.cos(0.3 * np.arange(60))
    start = None if cyclic else 0.1
    problem = track(model, requests, cyclic=cyclic, start=start, load=torques)
    point = allocated(problem.spec, smoothing=False)
    acting_load = load_by_period(torques, cyclic=cyclic)
    motion = motion_under(model, requests, cyclic=cyclic, start=start, torques=acting_load)
    point.requests[:, 0] = requests
    point.states[:, 0] = motion[0]
    point.states[:, 1:] = (
        problem.spec.drives[:, gauss_newton.COASTING] * motion[1 : problem.spec.parts].T
    )
    evaluate(problem.spec, Stage(1e-12, 1.0), 1.0, point)
    np.testing.assert_allclose(point.defects, 0.0, rtol=0.0, atol=SAME)
    exact = problem.exact_angles(requests[:, np.newaxis])
    np.testing.assert_array_equal(exact[:, 0], motion[0])
