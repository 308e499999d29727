"""Smoother requests at nearly the same error."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner import invert_foot, invert_optimal, reference_walk
from planner.model.evidence import ENCODER_STEP, UNFORESEEN, Evidence
from planner.planning import search
from planner.planning.problem import problem_of
from planner.planning.search import (
    NARROW,
    allowed,
    judged,
    known_errors,
    minimise,
    smoothed,
    solve,
)
from planner.planning.task import Task
from tests.instances import ERS210A, REFERENCE_JOINTS, attainable, random_model, saturating
from tests.plans import track

ROUNDING = 1e-12  # errors of two simulations of the same requests [rad]
CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])

RAMP = np.interp(np.arange(200), [20, 35, 110, 125], [0.0, 0.3, 0.3, 0.0])
"""To an angle and back, with rests before, between and after [rad]."""

PHASE = 2.0 * np.pi * np.arange(40) / 40
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE), 0.1 * np.sin(2.0 * PHASE)])


def allowed_error(error, share, noise=ENCODER_STEP):
    """The error that a joint's smoothing may leave [rad], (12b) of docs/math.md."""
    shown = (1.0 + share) * np.hypot(error, noise)
    return np.sqrt(shown**2 - noise**2)


def allowed_where_requests_shake(error, share, noise=ENCODER_STEP):
    """The same where without more they would change direction far more often than the path does."""
    return max(allowed_error(error, share, noise), ENCODER_STEP)


def travel(requests):
    """The way that requests go from one to the next [rad]."""
    return np.sum(np.abs(np.diff(requests.ravel())))


def rough(plan):
    """The sum of the squared second differences of a plan's requests [rad^2]."""
    columns = np.asarray(plan.requests).reshape(len(plan.requests), -1)
    ends = (columns[-1:], columns[:1]) if plan.cyclic else (columns[:1], columns[:0])
    return float(np.sum(np.diff(np.vstack([ends[0], columns, ends[1]]), n=2, axis=0) ** 2))


@CYCLIC
@pytest.mark.parametrize("norm", ["rms", "max"])
@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_smoother_requests_cost_the_reference_walk_no_more_than_their_share(joint, norm, cyclic):
    options = {"limits": joint.limits, "norm": norm, "cyclic": cyclic}
    rugged = invert_optimal(ERS210A, joint.desired, smoothness=0.0, **options)
    plan = invert_optimal(ERS210A, joint.desired, **options)
    assert plan.error <= allowed_error(rugged.error, 0.005) + ROUNDING
    # Where a plan spends its largest error at a limit of speed, no smoother one may be found.
    assert rough(plan) <= (0.25 if norm == "rms" or cyclic else 1.0) * rough(rugged)
    if norm == "rms" and cyclic:
        assert travel(plan.requests) <= 1.02 * travel(rugged.requests)
        assert plan.largest_step < np.radians(8.0)


@CYCLIC
def test_random_joints_get_smoother_requests_within_the_share(cyclic):
    ratios = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        model = random_model(rng, whole=seed % 2 == 0, hold=1 + seed % 3)
        desired = saturating(rng, model)
        if seed % 3 == 2:
            desired = attainable(rng, model) + 0.004 * rng.standard_normal(88)
        noise = np.radians(rng.uniform(0.2, 1.0)) if seed % 4 == 1 else ENCODER_STEP
        if seed % 4 == 3:
            model = replace(model, dead_band=rng.uniform(0.01, 0.12))
        model = model.with_evidence(Evidence(error=noise))
        beyond = model.theta_0 / 2.0
        limits = (desired.min() - beyond, desired.max() + beyond) if seed % 2 else None
        options = {"limits": limits, "cyclic": cyclic}
        rugged = invert_optimal(model, desired, smoothness=0.0, **options)
        plan = invert_optimal(model, desired, smoothness=0.01, **options)
        assert plan.error <= allowed_where_requests_shake(rugged.error, 0.01, noise) + ROUNDING
        assert rough(plan) <= rough(rugged)
        ratios.append(rough(plan) / rough(rugged))
    assert np.median(ratios) < 0.3


def test_more_smoothness_never_gives_rougher_requests_and_none_switches_it_off():
    joint = REFERENCE_JOINTS[1]
    plans = [
        invert_optimal(ERS210A, joint.desired, limits=joint.limits, smoothness=share)
        for share in (0.0, 0.001, 0.01, 0.1)
    ]
    sums = [rough(plan) for plan in plans]
    assert sums == sorted(sums, reverse=True)
    errors = [plan.rms for plan in plans]
    assert errors == sorted(errors)
    problem = track(ERS210A, joint.desired, cyclic=True)
    assert smoothed(replace(problem, smoothness=0.0), problem.resting) is problem.resting


@pytest.mark.parametrize(
    ("band", "size", "share"),
    [(0.0, 1.0, 0.11), (0.005, 5.0, 0.5)],  # what the share allows; with friction a step is
)
def test_a_smooth_path_is_not_flattened_for_smoothness(band, size, share):
    """Its requests are smooth already: an encoder's step more of error would spare them little."""
    desired = np.radians(size) * np.sin(2.0 * np.pi * np.arange(88) / 88.0)
    assert invert_optimal(replace(ERS210A, dead_band=band), desired).rms < share * ENCODER_STEP


def test_a_plan_for_the_foot_is_smoothed_within_the_share_of_the_foots_error():
    walk = reference_walk()
    rugged, plan = (
        invert_foot(ERS210A, walk.leg, walk.desired_foot, smoothness=share)
        for share in (0.0, 0.005)
    )
    assert plan.rms <= 1.005 * rugged.rms
    assert rough(plan) < 0.1 * rough(rugged)
    assert plan.largest_step < 0.5 * rugged.largest_step


def test_a_joint_does_not_rest_because_its_largest_error_would_bear_it():
    """As before, and 2 % may be added, so 40 % of the root mean square; without that limit 85 %."""
    desired = 0.1 * np.sin(6.0 * np.pi * np.arange(120) / 120)
    desired[60] += 2.0
    exact, plan = (invert_optimal(ERS210A, desired, norm="max", smoothness=s) for s in (0.0, 0.02))
    assert rough(plan) < 0.1 * rough(exact)
    assert plan.rms <= allowed_error(exact.rms, 0.4) + ROUNDING


def test_a_leg_with_friction_in_one_joint_does_not_cross_its_dead_band_for_noise():
    leg, band = reference_walk().leg, np.radians(2.0)
    noise = 0.05 * band * np.random.default_rng(0).normal(size=40)
    angles = np.column_stack([np.full(40, 0.1), np.full(40, 0.35), 1.0 + noise])
    models = [ERS210A, ERS210A, replace(ERS210A, dead_band=band)]
    plan = invert_foot(models, leg, leg.foot_positions(angles))
    assert travel(plan.requests[:, 2]) <= 15.0 * band  # 38 where the noise is followed


@CYCLIC
@pytest.mark.parametrize(
    ("terms", "limits"),
    [
        ({"theta_0": 0.1, "offset": 0.03}, {}),
        ({"lag": 0.045, "acceleration_time": 0.05, "tick": 0.01}, {}),
        ({"lag": 0.02, "acceleration_time": 0.05, "tick": 0.01}, {"max_step": 0.05}),
    ],
)
def test_where_the_path_rests_requests_rest(terms, limits, cyclic):
    """To cancel the window of the acceleration exactly they would go to and fro for ever."""
    model = replace(ERS210A, **terms)
    limits = limits and {"limits": (-0.01, 0.31), **limits}
    plan = invert_optimal(model, RAMP, cyclic=cyclic, **limits)
    least = invert_optimal(model, RAMP, cyclic=cyclic, smoothness=0.0, **limits)
    assert plan.error <= allowed_where_requests_shake(least.error, 0.005) + ROUNDING
    for rest, angle in ((slice(60, 85), 0.3), (slice(150, 180), 0.0)):
        np.testing.assert_allclose(plan.requests[rest], angle - model.offset, atol=2e-4)
        assert np.ptp(plan.requests[rest]) <= 2e-5
    assert rough(plan) <= rough(least)
    steps = np.diff(plan.requests)
    assert np.max(np.abs(steps)) <= limits.get("max_step", np.radians(3.0))


def test_requests_at_rest_are_not_bought_with_steps_of_the_others():
    """Near the motion a joint of a long window needs room: the rests are shorter, not the steps."""
    model = replace(ERS210A, theta_0=0.12, lag=0.045, acceleration_time=0.05, tick=0.01)
    plan = invert_optimal(model, RAMP)
    assert np.max(np.abs(np.diff(plan.requests))) <= np.radians(2.0)
    assert np.ptp(plan.requests[150:180]) <= 2e-5


def test_the_weights_of_the_worst_models_grow_until_their_errors_are_equal():
    """Sags of 0, 0.1 and 0.3 rad: requests of -0.15 miss two of them by 0.15 each, none by more."""
    models = [replace(ERS210A, offset=sag) for sag in (0.0, 0.1, 0.3)]
    made = invert_optimal(models, np.zeros(20), robust="worst")
    assert made.over_models.worst == pytest.approx(0.15, rel=0.02)  # six rounds leave 1 %
    mean = invert_optimal(models, np.zeros(20), robust="mean")
    np.testing.assert_allclose(mean.requests, -0.4 / 3.0, rtol=0.0, atol=1e-3)


def test_what_models_miss_is_at_least_an_encoders_step_and_grows_with_the_motion():
    """A model whose error grows with the acceleration, and motions that are seen as they repeat."""
    by_acceleration = Evidence(0.01, by_acceleration=((0.0, 0.004), (60.0, 0.05)))
    known = Evidence(1e-9), Evidence(math.nan), by_acceleration
    models = [ERS210A, *map(ERS210A.with_evidence, known)]
    ramp = np.tile(np.linspace(0.0, 1.0, 30)[:, np.newaxis], 4)  # jumps back where it repeats
    cyclic, once = (known_errors(models, ramp, cyclic=each) for each in (True, False))
    np.testing.assert_array_equal(cyclic[:3], ENCODER_STEP)
    np.testing.assert_array_equal(once[:3], ENCODER_STEP)
    assert once[3] == pytest.approx(0.004, rel=0.05)
    assert cyclic[3] > 2.0 * once[3]


def test_the_best_end_of_all_sharp_stages_is_kept_even_if_the_last_is_worse():
    """The beginning too: a search never makes requests worse by the exact model."""
    desired = saturating(np.random.default_rng(4), ERS210A, samples=40)
    problem = track(ERS210A, desired, cyclic=True)
    best, least = minimise(problem, problem.resting, problem.desired, NARROW)
    assert least == problem.exact_error(best)
    again, error = minimise(problem, best, problem.exact_angles(best), NARROW[:1])
    np.testing.assert_array_equal(again, best)
    assert error == least


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


def foot_problem():
    """The reference walk's foot, every fourth sample."""
    walk = reference_walk()
    return problem_of(Task.of(ERS210A, walk.desired_foot[::4], leg=walk.leg))


def test_no_more_is_allowed_than_the_share_but_where_many_requests_lead_to_one_motion():
    """The share is of the shown error; for a foot and dry friction an encoder's step is."""
    known = track(ERS210A.with_evidence(Evidence(0.1)), np.zeros(5), cyclic=True)
    assert judged(known, known.resting).model_error == pytest.approx(0.1)
    sticky = track(replace(ERS210A, dead_band=0.01), np.zeros(5), cyclic=True)
    for problem in (track(ERS210A, np.zeros(5), cyclic=True), sticky, foot_problem()):
        smooth, plan = replace(problem, smoothness=0.1), replace(problem, smoothness=0.0)
        motion = judged(problem, problem.resting)
        many = problem.goal == "foot" or problem is sticky
        assert motion.negligible == (motion.unseen if many else 0.0)
        best = motion._replace(error=0.3, model_error=0.4, negligible=0.05 if many else 0.0)
        assert allowed(smooth, best._replace(error=0.37), best)  # hypot(0.37, 0.4) is 0.545
        assert not allowed(smooth, best._replace(error=0.39), best)
        assert allowed(smooth, best._replace(error=0.04, model_error=2.0), best) == many
        assert allowed(plan, best, best)
        assert not allowed(plan, best._replace(error=0.3001), best)
