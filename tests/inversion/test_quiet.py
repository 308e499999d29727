"""Quieter requests under which the joints do the same."""

from __future__ import annotations

import numpy as np
import pytest

from planner.inversion import descent
from planner.inversion.optimal import invert_optimal
from planner.inversion.quiet import idle_between, neighbours, quieten
from planner.inversion.tracking import follow
from planner.model.joint import JointModel
from tests.instances import REFERENCE_JOINTS, random_model, saturating

ERS210A = JointModel.ers210a()

SAME = 1e-11
"""Two simulations of requests that should make no difference [rad]."""


def ragged(seed, *, cyclic=True, hold=1, limits=None):
    """A joint mostly at top speed, under requests that jump."""
    rng = np.random.default_rng([seed, cyclic, hold])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    desired = 2.0 * saturating(rng, model, samples=50)
    start = None if cyclic else float(desired[0])
    problem = follow(model, desired, cyclic=cyclic, start=start, limits=limits)
    jumps = rng.normal(scale=2.0 * model.theta_0, size=(50, 1))
    return problem, problem.admissible(problem.resting + jumps)


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("hold", [1, 3])
@pytest.mark.parametrize("seed", range(4))
def test_idle_requests_change_nothing_between_their_bounds(seed, hold, cyclic):
    problem, requests = ragged(seed, cyclic=cyclic, hold=hold)
    angles = problem.exact_angles(requests)
    lower, upper = idle_between(problem, requests, angles)
    assert np.all((lower <= requests) & (requests <= upper))
    lower, upper = np.maximum(lower, -99.0), np.minimum(upper, 99.0)
    idle = np.flatnonzero((lower < upper)[:, 0])
    assert idle.size
    if not cyclic:
        assert idle[0] > 0
    for number in idle:
        for bound in (lower, upper):
            moved = requests.copy()
            moved[number] = bound[number]
            np.testing.assert_allclose(problem.exact_angles(moved), angles, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("seed", range(4))
def test_quieter_requests_lead_to_the_same_angles_by_a_shorter_way(seed, cyclic):
    limits = None if seed % 2 else (-1.0, 1.0)
    problem, requests = ragged(seed, cyclic=cyclic, limits=limits)
    quieter = quieten(problem, requests)
    travelled, farther = (np.sum(np.abs(np.diff(r[:, 0]))) for r in (quieter, requests))
    assert travelled < farther
    np.testing.assert_allclose(
        problem.exact_angles(quieter), problem.exact_angles(requests), rtol=0.0, atol=SAME
    )
    assert np.all((problem.lower <= quieter) & (quieter <= problem.upper))


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_of_two_plans_that_track_equally_well_the_quieter_one_is_given(joint, monkeypatch):
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits)
    monkeypatch.setattr("planner.inversion.quiet.SMOOTHINGS", 0)
    jumping = invert_optimal(ERS210A, joint.desired, limits=joint.limits)
    assert plan.largest_step < jumping.largest_step
    np.testing.assert_allclose(plan.predicted, jumping.predicted, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("joint", REFERENCE_JOINTS[::2], ids=lambda joint: joint.name)
def test_a_pull_makes_the_last_stages_quieter_at_next_to_no_cost(joint, monkeypatch):
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits)
    weak = tuple(s._replace(pull=min(s.pull, 1e-8), steps=12) for s in descent.SEARCH[3:])
    monkeypatch.setattr(descent.improve, "__defaults__", ((*descent.SEARCH[:3], *weak),))
    jumping = invert_optimal(ERS210A, joint.desired, limits=joint.limits)
    travelled, farther = (np.sum(np.abs(np.diff(p.requests))) for p in (plan, jumping))
    assert travelled < farther
    assert plan.rms <= jumping.rms * (1.0 + descent.AS_WELL)


def test_neighbours_of_a_cycle_are_around_it_and_from_rest_none_is_before_the_first():
    cycle = neighbours(follow(ERS210A, np.zeros(30), cyclic=True))
    assert cycle[:, 0].tolist() == [27, 28, 29, 0, 1, 2, 3]
    resting = neighbours(follow(ERS210A, np.zeros(30), cyclic=False, start=0.0))
    assert resting[:, 0].tolist() == [0, 0, 0, 0, 1, 2, 3]
    assert resting[:, 29].tolist() == [26, 27, 28, 29, 29, 29, 29]


def test_requests_without_a_cycle_are_left_alone(monkeypatch):
    monkeypatch.setattr("planner.inversion.tracking.MOST_CYCLES", 2)
    problem = follow(ERS210A, np.zeros(88), cyclic=True)
    requests = np.repeat([-1e3, 1e3], [43, 45])[:, np.newaxis]
    assert quieten(problem, requests) is requests
