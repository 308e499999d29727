"""Plans for a foot: within limits, never worse than joint by joint, and honest about the rest."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import planner
from planner.arrays import error_norm, rms
from planner.gait.half_ellipse import reference_walk
from planner.model.response import simulate
from planner.planning import search
from planner.planning.inversion import invert_foot
from planner.planning.line_inverse import RULES
from tests.independent import from_rest, next_cycle
from tests.instances import ERS210A, random_model
from tests.kinematics.made_up_robots import SHAPES, ers210a_leg, made_up_leg
from tests.plans import foot_distances

WALK = reference_walk()
SAME = 1e-11  # two simulations of the same requests agree to this [rad, m]
NO_WORSE = 1e-12  # rounding between two simulations of the same requests [m]
UNSEEN = 1e-4  # error that no encoder shows [m]: a step of one of 12 bits in one joint of this leg
CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
NORMS = pytest.mark.parametrize("norm", ["rms", "max"])
pytestmark = pytest.mark.filterwarnings("ignore::planner.exceptions.OutsideEquation13")


def limits_of(plan):
    return plan.plan.task.lower, plan.plan.task.upper


@cache
def reference_plan(**options):
    """The plan for the reference walk, searched for once."""
    return invert_foot(ERS210A, WALK.leg, WALK.desired_foot, **options)


def stride(leg, *, samples=30, swing=0.35):
    """Angles of a stride about the middle of the limits, too fast for the ERS-210A [rad]."""
    rng = np.random.default_rng(1)
    phase = 2.0 * np.pi * np.arange(samples)[:, np.newaxis] / samples
    middle = leg.limits.middle
    shifts = rng.uniform(0.0, 2.0 * np.pi, (2, len(middle)))
    return middle + swing * (np.sin(phase + shifts[0]) + 0.3 * np.sin(2.0 * phase + shifts[1]))


def assert_within_limits(plan):
    lower, upper = limits_of(plan)
    assert np.all((lower <= plan.requests) & (plan.requests <= upper))


def assert_no_better(requests, plan):
    """Other requests to the same joints are no better than the plan's."""
    assert plan.error <= error_norm(foot_distances(plan, requests), plan.norm) + NO_WORSE


def joint_by_joint(plan):
    """Every joint planned for itself, for the angles that come nearest to the path."""
    task = plan.plan.task
    offsets = np.array([model.offset for model in plan.models])
    within = np.array(limits_of(plan)) + offsets  # where the requests let the joints rest
    desired = np.clip(task.leg.joint_angles(task.desired_foot, unreachable="nearest"), *within)
    options = {"cyclic": plan.cyclic, "limits": limits_of(plan), "norm": plan.norm}
    return planner.plan(plan.models, desired, **options).requests


def test_the_reference_walk_is_followed_to_62_hundredths_of_a_centimetre_and_135_at_most():
    mean, largest = reference_plan(), reference_plan(norm="max")
    assert mean.rms <= 0.0062
    assert largest.max_error <= min(0.0135, 0.95 * mean.max_error)
    assert largest.norm == "max"
    for plan in (mean, largest):
        assert_within_limits(plan)


@CYCLIC
@NORMS
def test_on_the_reference_walk_no_plan_of_single_joints_is_better(norm, cyclic):
    plan = reference_plan(norm=norm, cyclic=cyclic)
    assert_no_better(joint_by_joint(plan), plan)
    for rule in RULES:
        options = {"cyclic": cyclic, "method": "closed_form", "segments": 6, "rule": rule}
        form = planner.plan(ERS210A, WALK.desired, **options)
        assert_no_better(np.clip(form.requests, *limits_of(plan)), plan)


@pytest.mark.parametrize(
    ("shape", "cyclic"), list(zip(SHAPES, [True, False, True, False, True], strict=True))
)
def test_a_path_that_requests_have_led_to_is_followed_to_a_tenth_of_a_millimetre(
    shape, cyclic, tmp_path
):
    leg = made_up_leg(tmp_path, *SHAPES[shape])
    requests = stride(leg, samples=40, swing=0.15)
    requests[:10] = requests[0]  # so that from rest the joints can start there
    angles = [simulate(ERS210A, column, cyclic=cyclic) for column in requests.T]
    path = leg.foot_positions(np.transpose(angles))
    plan = invert_foot(ERS210A, leg, path, cyclic=cyclic, smoothness=0.0)
    assert plan.rms <= 1e-4


@CYCLIC
@NORMS
def test_limits_narrower_than_the_path_are_respected_to_the_last_bit(norm, cyclic):
    leg = ers210a_leg("front_left")
    desired = stride(leg)
    limits = (desired.min(axis=0) + 0.1, desired.max(axis=0) - np.array([0.1, 0.2, 0.0]))
    path = leg.foot_positions(desired)
    options = {"cyclic": cyclic, "limits": limits, "norm": norm, "smoothness": 0.0}
    plan = invert_foot(ERS210A, leg, path, **options)
    assert_within_limits(plan)
    np.testing.assert_array_equal(limits_of(plan), limits)
    assert np.any((plan.requests == limits[0]) | (plan.requests == limits[1]))
    assert_no_better(joint_by_joint(plan), plan)


@CYCLIC
@pytest.mark.parametrize("hold", [1, 3])
def test_joints_of_different_kinds_are_planned_together(hold, cyclic):
    rng = np.random.default_rng(hold)
    leg = ers210a_leg("hind_left")
    models = [random_model(rng, whole=False, hold=hold, offset=True) for _ in range(3)]
    models[1] = replace(models[1], tick=models[1].tick / 2.0, hold=2 * hold)
    path = leg.foot_positions(stride(leg))
    plan = invert_foot(models, leg, path, cyclic=cyclic)
    assert plan.models == tuple(models)
    assert_within_limits(plan)
    assert_no_better(joint_by_joint(plan), plan)
    for joint, model in enumerate(models):
        requests, angles = plan.requests[:, joint], plan.predicted[:, joint]
        if cyclic:
            expected = next_cycle(model, requests, angles[-1])
        else:
            expected = from_rest(model, requests, start=plan.plan.task.start[joint])
        np.testing.assert_allclose(angles, expected, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("offset", [-0.1, 0.1])
def test_joints_that_sag_follow_a_path_along_the_limits_of_the_leg_too(offset):
    plan = invert_foot(replace(ERS210A, offset=offset), WALK.leg, WALK.desired_foot)
    assert_within_limits(plan)
    assert plan.rms <= 1.2 * reference_plan().rms


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_without_a_weight_is_let_go_for_the_others(axis):
    weights = np.ones(3)
    weights[axis] = 0.0
    errors = np.abs(reference_plan().foot - WALK.desired_foot)
    plan = reference_plan(weights=tuple(weights))
    freed = np.abs(plan.foot - WALK.desired_foot)
    assert rms(freed[:, axis]) > 1.5 * rms(errors[:, axis])
    assert rms(freed * weights) < 0.9 * rms(errors * weights)
    np.testing.assert_array_equal(plan.plan.task.weights, weights)


@NORMS
def test_a_path_partly_out_of_reach_is_followed_as_closely_as_the_rest_of_it(norm):
    plan = invert_foot(ERS210A, WALK.leg, WALK.half_ellipse, norm=norm)
    solution = WALK.leg.inverse(WALK.half_ellipse, unreachable="nearest")
    assert not solution.reachable.all()
    assert error_norm(solution.distance, norm) <= plan.error
    assert_no_better(joint_by_joint(plan), plan)
    np.testing.assert_array_equal(plan.plan.task.desired_foot, WALK.half_ellipse)


def test_every_figure_follows_from_the_requests():
    plan = reference_plan()
    np.testing.assert_allclose(plan.distances, foot_distances(plan), atol=SAME)
    np.testing.assert_array_equal(plan.foot, WALK.leg.foot_positions(plan.predicted))
    assert plan.rms == rms(plan.distances)
    assert plan.max_error == np.max(plan.distances)
    other = replace(plan, requests=WALK.desired)
    np.testing.assert_allclose(other.distances, foot_distances(plan, WALK.desired), atol=SAME)


@pytest.mark.parametrize("seed", [0, 3])
def test_the_plan_for_the_largest_error_of_a_rough_path_is_no_worse_than_that_for_the_rms(seed):
    rng = np.random.default_rng(seed)
    model = replace(ERS210A, v_max=0.7 * ERS210A.v_max)
    path = WALK.desired_foot[::4] + rng.normal(scale=0.004, size=(22, 3))  # [m]
    mean, largest = (
        invert_foot(model, WALK.leg, path, norm=norm, smoothness=0.0) for norm in ("rms", "max")
    )
    assert largest.max_error <= mean.max_error + NO_WORSE


def stepping(swing_deg):
    """A foot path in a plane, along which the abductor has nothing to do: (60, 3) [m]."""
    phase = 2.0 * np.pi * np.arange(60) / 60
    waves = np.sin(phase) + 0.2 * np.sin(3.0 * phase), 0.0 * phase, np.cos(phase)
    angles = np.radians(np.transpose(waves) * swing_deg + np.array([0.0, 20.0, 60.0]))
    return WALK.leg.foot_positions(angles)


@NORMS
def test_a_joint_that_could_only_make_up_for_next_to_nothing_rests(norm, monkeypatch):
    path = stepping(10.0)
    plan = invert_foot(ERS210A, WALK.leg, path, norm=norm)
    assert np.ptp(plan.requests[:, 1]) == 0.0
    monkeypatch.setattr(search, "STATIONARY", -1.0)
    moving = invert_foot(ERS210A, WALK.leg, path, norm=norm, smoothness=0.0)
    assert np.ptp(moving.requests[:, 1]) > math.radians(0.01)
    assert plan.error <= 1.005 * moving.error + UNSEEN


def test_a_joint_that_makes_up_for_what_others_miss_moves():
    path = stepping(40.0)
    plan = invert_foot(ERS210A, WALK.leg, path)
    assert np.ptp(plan.requests[:, 1]) > math.radians(1.0)
    resting = invert_foot(ERS210A, WALK.leg, path, smoothness=10.0)
    assert np.ptp(resting.requests[:, 1]) == 0.0
    assert plan.rms < 0.99 * resting.rms
