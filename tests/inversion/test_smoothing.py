"""Smoother requests under which the joints do the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.gait import reference_walk
from planner.inversion import optimal, smoothing
from planner.inversion.foot import invert
from planner.inversion.foot.invert import invert_foot
from planner.inversion.optimal import invert_optimal
from planner.inversion.smoothing import (
    OPTIONS,
    SAME_ERROR,
    neighbours,
    room_of_saturated,
    saturated_averaged,
    smoothed,
    squared_changes,
)
from planner.inversion.tracking_problem import track
from planner.model.joint import JointModel
from tests.instances import REFERENCE_JOINTS, random_model, saturating

ERS210A = JointModel.ers210a()

SAME = 1e-11
"""Two simulations of requests that should make no difference [rad]."""


def travel(requests):
    """The way that requests go from one to the next [rad]."""
    return np.sum(np.abs(np.diff(requests.ravel())))


def ragged(seed, *, cyclic=True, hold=1, limits=None):
    """A joint mostly at top speed, under requests that jump."""
    rng = np.random.default_rng([seed, cyclic, hold])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    desired = 2.0 * saturating(rng, model, samples=50)
    start = None if cyclic else float(desired[0])
    problem = track(model, desired, cyclic=cyclic, start=start, limits=limits)
    jumps = rng.normal(scale=2.0 * model.theta_0, size=(50, 1))
    return problem, problem.admissible(problem.resting + jumps)


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("hold", [1, 3])
@pytest.mark.parametrize("seed", range(4))
def test_saturated_requests_change_nothing_between_their_bounds(seed, hold, cyclic):
    problem, requests = ragged(seed, cyclic=cyclic, hold=hold)
    angles = problem.exact_angles(requests)
    lower, upper = room_of_saturated(problem, requests, angles)
    assert np.all((lower <= requests) & (requests <= upper))
    lower, upper = np.maximum(lower, -99.0), np.minimum(upper, 99.0)
    saturated = np.flatnonzero((lower < upper)[:, 0])
    assert saturated.size
    if not cyclic:
        assert saturated[0] > 0
    for number in saturated:
        for bound in (lower, upper):
            moved = requests.copy()
            moved[number] = bound[number]
            answer = problem.exact_angles(moved, angles[-1])
            np.testing.assert_allclose(answer, angles, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("seed", range(4))
def test_smoother_requests_lead_to_the_same_angles_by_a_shorter_way(seed, cyclic):
    limits = None if seed % 2 else (-1.0, 1.0)
    problem, requests = ragged(seed, cyclic=cyclic, limits=limits)
    smoother = saturated_averaged(problem, requests, problem.exact_angles(requests))
    assert travel(smoother) < travel(requests)
    np.testing.assert_allclose(
        problem.exact_angles(smoother), problem.exact_angles(requests), rtol=0.0, atol=SAME
    )
    assert np.all((problem.lower <= smoother) & (smoother <= problem.upper))


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize(
    ("joint", "travelled"),
    list(zip(REFERENCE_JOINTS, (0.95, 0.7, 0.85), strict=True)),
    ids=[joint.name for joint in REFERENCE_JOINTS],
)
def test_of_two_plans_that_track_equally_well_the_smoother_one_is_given(
    joint, travelled, cyclic, monkeypatch
):
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, cyclic=cyclic)
    monkeypatch.setattr(smoothing, "OPTIONS", replace(OPTIONS, stages=(), averages=0))
    jumping = invert_optimal(ERS210A, joint.desired, limits=joint.limits, cyclic=cyclic)
    assert travel(plan.requests) < travelled * travel(jumping.requests)
    assert plan.largest_step < 0.85 * jumping.largest_step
    assert plan.rms <= jumping.rms * (1.0 + OPTIONS.error_share)


def test_the_largest_error_bears_smoother_requests_too(monkeypatch):
    joint = REFERENCE_JOINTS[1]
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, norm="max")
    monkeypatch.setattr(smoothing, "OPTIONS", replace(OPTIONS, stages=()))
    jumping = invert_optimal(ERS210A, joint.desired, limits=joint.limits, norm="max")
    assert travel(plan.requests) < 0.85 * travel(jumping.requests)
    assert plan.largest_step < 0.85 * jumping.largest_step
    assert plan.max_error <= jumping.max_error * (1.0 + OPTIONS.error_share)


@pytest.mark.parametrize("limited", [False, True], ids=["free", "limited"])
@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
def test_plans_of_random_joints_are_smoothed_at_next_to_no_cost(cyclic, limited, monkeypatch):
    ways = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        model = random_model(rng, whole=seed % 2 == 0)
        desired = saturating(rng, model)
        beyond = model.theta_0 / 2.0
        limits = (desired.min() - beyond, desired.max() + beyond) if limited else None
        plans = []
        for stages in (OPTIONS.stages, ()):
            monkeypatch.setattr(smoothing, "OPTIONS", replace(OPTIONS, stages=stages))
            plans.append(invert_optimal(model, desired, limits=limits, cyclic=cyclic))
        plan, jumping = plans
        assert plan.rms <= jumping.rms * (1.0 + OPTIONS.error_share)
        ways.append(travel(plan.requests) / travel(jumping.requests))
    assert np.mean(ways) < 0.97
    assert np.max(ways) < 1.01


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
def test_smoother_requests_never_pass_the_error_that_is_not_to_be_passed(cyclic):
    joint = REFERENCE_JOINTS[1]
    plan = invert_optimal(ERS210A, joint.desired, cyclic=cyclic)
    start = None if cyclic else float(joint.desired[0])
    problem = track(ERS210A, joint.desired, cyclic=cyclic, start=start)
    requests = plan.requests[:, np.newaxis]
    given = problem.exact_error(requests)
    smoother = smoothed(problem, requests, at_most=given)
    assert problem.exact_error(smoother) <= given + SAME_ERROR


@pytest.mark.parametrize("norm", ["rms", "max"])
@pytest.mark.parametrize("desired", [0.0, 0.7], ids=["at zero", "elsewhere"])
def test_what_does_not_change_is_left_alone(desired, norm):
    problem = track(ERS210A, np.full(20, desired), cyclic=True, norm=norm)
    np.testing.assert_array_equal(smoothed(problem, problem.resting), problem.resting)


@pytest.mark.parametrize("joint", REFERENCE_JOINTS[::2], ids=lambda joint: joint.name)
def test_a_regularisation_makes_the_last_stages_smoother_at_next_to_no_cost(joint, monkeypatch):
    monkeypatch.setattr(smoothing, "OPTIONS", replace(OPTIONS, stages=()))
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits)
    search = optimal.SEARCH
    weak = tuple(s._replace(weight=min(s.weight, 1e-8), steps=12) for s in search.narrow[3:])
    stages = (*search.narrow[:3], *weak)
    monkeypatch.setattr(optimal, "SEARCH", replace(search, narrow=stages))
    jumping = invert_optimal(ERS210A, joint.desired, limits=joint.limits)
    assert travel(plan.requests) < travel(jumping.requests)
    assert plan.rms <= jumping.rms * (1.0 + OPTIONS.error_share)


def test_neighbours_of_a_cycle_are_around_it_and_from_rest_none_is_before_the_first():
    cycle = neighbours(track(ERS210A, np.zeros(30), cyclic=True))
    assert cycle[:, 0].tolist() == [27, 28, 29, 0, 1, 2, 3]
    resting = neighbours(track(ERS210A, np.zeros(30), cyclic=False, start=0.0))
    assert resting[:, 0].tolist() == [0, 0, 0, 0, 1, 2, 3]
    assert resting[:, 29].tolist() == [26, 27, 28, 29, 29, 29, 29]


def test_requests_without_a_cycle_are_left_alone(monkeypatch):
    monkeypatch.setattr("planner.model.response.MOST_CYCLES", 2)
    problem = track(ERS210A, np.zeros(88), cyclic=True)
    requests = np.repeat([-1e3, 1e3], [43, 45])[:, np.newaxis]
    assert smoothed(problem, requests) is requests


def test_further_rounds_make_a_plan_for_the_foot_smoother_where_its_error_bears_it(monkeypatch):
    walk = reference_walk()
    plan = invert_foot(ERS210A, walk.leg, walk.desired_foot, norm="max")
    monkeypatch.setattr(invert, "OPTIONS", replace(invert.OPTIONS, smoothing_rounds=1))
    once = invert_foot(ERS210A, walk.leg, walk.desired_foot, norm="max")
    three, one = (squared_changes(each.requests, cyclic=True) for each in (plan, once))
    assert three < 0.9 * one
    assert three < 0.48  # rad^2, as smooth as two searches were with three rounds
    assert plan.max_error <= once.max_error * (1.0 + OPTIONS.error_share)
