"""Smoother requests at nearly the same error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.gait.half_ellipse import reference_walk
from planner.model.evidence import Evidence
from planner.model.joint import JointModel
from planner.planning.inversion import invert_foot, invert_optimal
from planner.planning.search import smoothed
from tests.instances import REFERENCE_JOINTS, attainable, random_model, saturating
from tests.plans import track

ERS210A = JointModel.ers210a()

ROUNDING = 1e-12
"""Errors of two simulations of the same requests [rad]."""

CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])


ENCODER_STEP = 2.0 * np.pi / 4096.0
"""Of an encoder of 12 bits [rad]."""


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


@pytest.mark.parametrize("seed", [6, 15])
def test_a_first_request_in_the_middle_of_the_dead_band_costs_nothing_beside_the_share(seed):
    rng = np.random.default_rng(seed)
    model = replace(ERS210A, dead_band=rng.uniform(0.03, 0.15))
    desired = np.cumsum(rng.uniform(-1.0, 1.0, 30)) * rng.uniform(0.02, 0.1)
    desired -= desired[0]
    rugged = invert_optimal(model, desired, cyclic=False, smoothness=0.0)
    plan = invert_optimal(model, desired, cyclic=False)
    assert ENCODER_STEP < plan.rms <= allowed_error(rugged.rms, 0.005) + ROUNDING


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


def test_a_square_is_followed_as_well_by_requests_that_hardly_go_beyond_it():
    desired = np.radians(20.0) * np.repeat([1.0, -1.0], [63, 62])
    rugged = invert_optimal(ERS210A, desired, smoothness=0.0)
    plan = invert_optimal(ERS210A, desired)
    assert plan.rms <= 1.005 * rugged.rms
    assert travel(plan.requests) < 0.4 * travel(rugged.requests)
    assert plan.largest_step < 0.6 * rugged.largest_step
    assert plan.excess < 0.6 * rugged.excess


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


def test_a_smooth_path_is_not_flattened_for_smoothness():
    """Its requests are smooth already: an encoder's step more of error would spare them little."""
    desired = np.radians(1.0) * np.sin(2.0 * np.pi * np.arange(88) / 88.0)
    plan = invert_optimal(ERS210A, desired)
    assert plan.rms < 0.11 * ENCODER_STEP  # what the share allows


def test_a_plan_for_the_foot_is_smoothed_within_the_share_of_the_foots_error():
    walk = reference_walk()
    rugged, plan = (
        invert_foot(ERS210A, walk.leg, walk.desired_foot, smoothness=share)
        for share in (0.0, 0.005)
    )
    assert plan.rms <= 1.005 * rugged.rms
    assert rough(plan) < 0.1 * rough(rugged)
    assert plan.largest_step < 0.5 * rugged.largest_step


def test_what_a_model_is_known_to_miss_is_not_worth_rough_requests():
    """A step of 20 degrees, rounded so that the joint can follow it: jumps would gain nothing."""
    ramp = np.clip((np.arange(88) - 20) / 24.0, 0.0, 1.0) - np.clip((np.arange(88) - 60) / 24, 0, 1)
    desired = 0.35 * ramp**2 * (3.0 - 2.0 * ramp)
    known = ERS210A.with_evidence(Evidence(error=np.radians(0.25)))
    exact, plan = invert_optimal(ERS210A, desired, smoothness=0.0), invert_optimal(known, desired)
    assert exact.rms < np.radians(0.05)
    allowed = allowed_where_requests_shake(exact.rms, 0.005, noise=np.radians(0.25))
    assert plan.rms <= allowed + ROUNDING
    assert rough(plan) < 0.3 * rough(exact)


def test_a_joint_does_not_rest_because_its_largest_error_would_bear_it():
    """As before, and 2 % may be added, so 40 % of the root mean square; without that limit 85 %."""
    desired = 0.1 * np.sin(6.0 * np.pi * np.arange(120) / 120)
    desired[60] += 2.0
    exact, plan = (invert_optimal(ERS210A, desired, norm="max", smoothness=s) for s in (0.0, 0.02))
    assert rough(plan) < 0.1 * rough(exact)
    assert plan.rms <= allowed_error(exact.rms, 0.4) + ROUNDING


def test_a_smooth_path_is_not_flattened_within_a_dead_band_either():
    """A step of an encoder is allowed: 70 % of it would save 7 % of the second differences."""
    sticky = replace(ERS210A, dead_band=0.005)
    plan = invert_optimal(sticky, np.radians(5.0) * np.sin(2.0 * np.pi * np.arange(88) / 88.0))
    assert plan.rms < 0.5 * ENCODER_STEP


def test_a_leg_with_friction_in_one_joint_does_not_cross_its_dead_band_for_noise():
    leg, band = reference_walk().leg, np.radians(2.0)
    noise = 0.05 * band * np.random.default_rng(0).normal(size=40)
    angles = np.column_stack([np.full(40, 0.1), np.full(40, 0.35), 1.0 + noise])
    models = [ERS210A, ERS210A, replace(ERS210A, dead_band=band)]
    plan = invert_foot(models, leg, leg.foot_positions(angles))
    assert travel(plan.requests[:, 2]) <= 15.0 * band  # 38 where the noise is followed


RAMP = np.interp(np.arange(200), [20, 35, 110, 125], [0.0, 0.3, 0.3, 0.0])
"""To an angle and back, with rests before, between and after [rad]."""


@CYCLIC
@pytest.mark.parametrize(
    ("model", "limits"),
    [
        (replace(ERS210A, theta_0=0.1, offset=0.03), {}),
        (replace(ERS210A, lag=0.045, acceleration_time=0.05, tick=0.01), {}),
        (
            replace(ERS210A, lag=0.02, acceleration_time=0.05, tick=0.01),
            {"max_step": 0.05, "limits": (-0.01, 0.31)},
        ),
    ],
)
def test_where_the_path_rests_requests_rest(model, limits, cyclic):
    """To cancel the window of the acceleration exactly they would go to and fro for ever."""
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


def test_where_the_largest_error_does_not_bind_requests_are_as_smooth_as_for_the_mean():
    ratios = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        model = random_model(rng)
        desired = saturating(rng, model)
        plans = (invert_optimal(model, desired, norm=norm) for norm in ("max", "rms"))
        largest, mean = map(rough, plans)
        ratios.append(largest / mean)
    assert max(ratios) <= 2.0
