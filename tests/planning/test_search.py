"""The search's own bookkeeping: held requests, weights of models, and what smoothing may cost."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.gait.half_ellipse import reference_walk
from planner.model.evidence import ENCODER_STEP, Evidence
from planner.model.joint import JointModel
from planner.planning import search
from planner.planning.inversion import invert_optimal
from planner.planning.problem import problem_of
from planner.planning.result import UNFORESEEN
from planner.planning.search import (
    NARROW,
    Motion,
    allowed,
    judged,
    known_errors,
    minimise,
    solve,
)
from planner.planning.task import Task
from tests.instances import saturating
from tests.plans import track

ERS210A = JointModel.ers210a()

ROUNDING = 1e-12
"""Of sums over some hundred samples [relative]."""


def foot_problem(models=ERS210A, **options):
    """The reference walk's foot, every fourth sample, and a motion beside its desired angles."""
    walk = reference_walk()
    task = Task.of(models, walk.desired_foot[::4], leg=walk.leg, **options)
    problem = problem_of(task)
    beside = 0.05 * np.random.default_rng(0).normal(size=problem.desired.shape)
    return problem, np.tile(problem.desired + beside, len(problem.models) // 3)


def test_the_weights_of_the_worst_models_grow_until_their_errors_are_equal():
    """Sags of 0, 0.1 and 0.3 rad: requests of -0.15 miss two of them by 0.15 each, none by more."""
    models = [replace(ERS210A, offset=sag) for sag in (0.0, 0.1, 0.3)]
    made = invert_optimal(models, np.zeros(20), robust="worst")
    assert made.over_models.worst == pytest.approx(0.15, rel=0.02)  # six rounds leave 1 %
    mean = invert_optimal(models, np.zeros(20), robust="mean")
    np.testing.assert_allclose(mean.requests, -0.4 / 3.0, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("weights", [(0.5, 0.5), (0.2, 0.8)])
def test_a_motion_of_a_foot_is_judged_by_what_each_joint_moves_it_in_each_scenario(weights):
    """Root mean squares over samples and axes, the scenarios by their weights."""
    noise = (0.01, 0.02, 0.03)
    models = [ERS210A.with_evidence(Evidence(each)) for each in noise]
    nominal, _ = foot_problem(models)
    drawn = (ERS210A,) * 3  # those that were drawn were not tested
    both = nominal.in_scenarios([tuple(models), drawn], np.zeros((6, len(nominal.desired))), "mean")
    both = replace(both, weights=weights)
    rng = np.random.default_rng(1)
    angles = np.tile(nominal.desired, 2) + 0.05 * rng.normal(size=(22, 6))
    found = judged(both, both.resting, angles)
    squares = np.zeros(3)
    for scenario, weight in enumerate(weights):
        values, jacobians = nominal.errors(angles[:, 3 * scenario : 3 * scenario + 3])
        moved = jacobians[:, 0]  # (n, 3 axes, J)
        squares += weight * np.array(
            [
                np.mean(np.sum(values[:, 0] ** 2, axis=1)),
                np.mean(np.sum((moved * noise) ** 2, axis=(1, 2))),
                np.mean(np.sum((moved * ENCODER_STEP) ** 2, axis=(1, 2))),
            ]
        )
    expected = np.sqrt(squares)
    assert [found.mean, found.model_error, found.unseen] == pytest.approx(expected, rel=ROUNDING)
    assert found.error == both.error(angles)


def test_what_models_miss_is_at_least_an_encoders_step_and_grows_with_the_motion():
    """A model whose error grows with the acceleration, and motions that are seen as they repeat."""
    by_acceleration = Evidence(0.01, by_acceleration=((0.0, 0.004), (60.0, 0.05)))
    models = [
        ERS210A,
        ERS210A.with_evidence(Evidence(1e-9)),
        ERS210A.with_evidence(Evidence(math.nan)),
        ERS210A.with_evidence(by_acceleration),
    ]
    ramp = np.tile(np.linspace(0.0, 1.0, 30)[:, np.newaxis], 4)  # jumps back where it repeats
    cyclic, once = (known_errors(models, ramp, cyclic=each) for each in (True, False))
    np.testing.assert_array_equal(cyclic[:3], ENCODER_STEP)
    np.testing.assert_array_equal(once[:3], ENCODER_STEP)
    assert once[3] == pytest.approx(0.004, rel=0.05)
    assert cyclic[3] > 2.0 * once[3]


def test_more_is_allowed_where_nearly_the_same_motion_follows_from_many_requests():
    """For a foot and with dry friction an encoder's step in any case."""
    best = Motion(np.zeros((5, 1)), np.zeros((5, 1)), 0.3, 0.2, 0.4, 0.05)
    desired = np.zeros(5)
    plain = track(ERS210A, desired, cyclic=True)
    sticky = track(replace(ERS210A, dead_band=0.01), desired, cyclic=True)
    foot, _ = foot_problem()
    for problem, unseen in ((plain, False), (sticky, True), (foot, True)):
        smooth, plan = replace(problem, smoothness=0.1), replace(problem, smoothness=0.0)
        assert allowed(smooth, best._replace(error=0.37), best)  # hypot(0.37, 0.4) is 0.545
        assert not allowed(smooth, best._replace(error=0.39), best)
        assert allowed(smooth, best._replace(error=0.04, model_error=2.0), best) == unseen
        assert allowed(plan, best, best)
        assert not allowed(plan, best._replace(error=0.3001), best)


def test_the_best_end_of_all_sharp_stages_is_kept_even_if_the_last_is_worse():
    """The beginning too: a search never makes requests worse by the exact model."""
    desired = saturating(np.random.default_rng(4), ERS210A, samples=40)
    problem = track(ERS210A, desired, cyclic=True)
    best, least = minimise(problem, problem.resting, problem.desired, NARROW)
    assert least == problem.exact_error(best)
    again, error = minimise(problem, best, problem.exact_angles(best), NARROW[:1])
    np.testing.assert_array_equal(again, best)
    assert error == least


PHASE = 2.0 * np.pi * np.arange(40) / 40
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE), 0.1 * np.sin(2.0 * PHASE)])


@pytest.fixture
def single(monkeypatch):
    """The tasks of the joints that are planned one by one; their plans are the desired angles."""
    given = []

    def record(task, **options):
        given.append((task, options))
        several = len(task.scenarios) > 1
        return task.desired, task.desired + 1.0 if several else None

    monkeypatch.setattr(search, "solve_joint", record)
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
    made, _ = solve(Task.of(models, steep, cyclic=False, smoothness=smoothness))
    first = float(made[0, 0])
    assert abs(first) < 0.03
    assert first == 0.0 if several else way * first == pytest.approx(0.03, rel=1e-6)
