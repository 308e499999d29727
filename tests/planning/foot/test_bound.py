"""The bound for a foot: below every plan whatever, close to the best, and proved by anything."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import NoSteadyCycle, invert_foot, simulate
from planner.arrays import error_norm
from planner.gait.stride import stride
from planner.planning.bounds.foot_bound import (
    Distance,
    LagrangianRelaxation,
    attainable_angles,
    dual_function,
    foot_bound,
    minima,
)
from planner.planning.bounds.multipliers import ConicSolution
from planner.planning.task import Task
from tests.instances import ERS210A, joint_of, random_model
from tests.kinematics.made_up_robots import ers210a_leg
from tests.plans import foot_distances

ROUNDING = 1e-9  # rounding in sums over samples [relative]


@pytest.fixture(autouse=True)
def less_effort(monkeypatch):
    """Less effort than usual: what is proved is then less, and no less valid."""
    monkeypatch.setattr("planner.planning.bounds.foot_bound.EFFORT", 250)


@cache
def short_plan(hold, cyclic, norm, *, samples=12, friction=False, gravity=False):
    """A short plan for random joints of the Aibo's own leg, asked for too much, not smoothed."""
    rng = np.random.default_rng([hold, cyclic])
    model, load = random_model(rng, whole=False, hold=hold), None
    if friction:
        faster = 0.2 * model.v_max
        terms = {"dead_band": 0.02, "v_offset": faster, "compliance": 0.03}
        model = replace(model, **terms, speed_per_torque=faster)
        load = 0.5 * np.sin(2.0 * np.pi * np.arange(samples)[:, np.newaxis] / samples + [0, 1, 2])
    if gravity:
        model = replace(model, sag_sin=0.4 * model.theta_0, sag_cos=-0.3 * model.theta_0)
    leg = ers210a_leg("front_left")
    phase = 2.0 * np.pi * np.arange(samples)[:, np.newaxis] / samples
    middle = np.mean(leg.limits, axis=0)
    swing = 1.5 * model.v_max * model.period * samples / (2.0 * np.pi)
    angles = middle + np.minimum(swing, 0.5) * np.sin(phase + rng.uniform(0.0, 6.0, 3))
    options = {"cyclic": cyclic, "norm": norm, "load": load, "smoothness": 0.0}
    return invert_foot(model, leg, leg.foot_positions(angles), **options)


def limits_of(plan):
    return plan.plan.task.lower, plan.plan.task.upper


@pytest.mark.parametrize(
    ("hold", "cyclic", "norm", "friction", "gravity"),
    [
        (1, True, "rms", False, False),
        (1, True, "max", False, False),
        (1, False, "rms", True, False),
        (2, False, "max", False, True),
    ],
)
def test_no_requests_within_the_limits_go_below_it(hold, cyclic, norm, friction, gravity):
    plan = short_plan(hold, cyclic, norm, friction=friction, gravity=gravity)
    assert 0.0 <= plan.lower_bound <= plan.error
    assert plan.lower_bound > 0.0 or gravity
    rng = np.random.default_rng(1)
    for spread in (0.01, 0.1, 1.0):
        for _ in range(20):
            requests = plan.requests + rng.normal(0.0, spread, plan.requests.shape)
            if plan.plan.task.start is not None:
                requests[0] = plan.requests[0]  # which holds the joints where they rest
            requests = np.clip(requests, *limits_of(plan))
            assert plan.lower_bound <= error_norm(foot_distances(plan, requests), norm)


@pytest.mark.parametrize(("cyclic", "norm"), [(True, "max"), (False, "rms")])
def test_whatever_the_multipliers_nothing_is_proved_that_is_not_so(cyclic, norm):
    rng = np.random.default_rng(4)
    plan = short_plan(2, cyclic, norm)
    task = LagrangianRelaxation.of(plan.plan.task, plan.error)
    for size in (0.0, 0.01, 0.1, 1.0):
        shares = rng.uniform(size=12) if norm == "max" else np.ones(12)
        guess = shares / np.sum(shares), size * rng.exponential(size=len(task.limits))
        proved, _ = dual_function(task, guess, plan.predicted)
        assert proved <= 1.0 + ROUNDING  # the plan's own squared error


def test_no_plan_that_is_planted_is_below_it():
    weights = (4.0, 1.0, 0.0)
    shares = np.array(weights) / max(weights)
    rng = np.random.default_rng(6)
    leg = ers210a_leg("hind_right")
    holds = [(1, 0.008), (2, 0.004), (4, 0.002)]
    models = [replace(ERS210A, tick=tick, hold=hold, offset=0.02) for hold, tick in holds]
    middle = np.mean(leg.limits, axis=0)
    for cyclic in (True, False):
        requests = middle + np.cumsum(rng.normal(0.0, 0.1, (10, 3)), axis=0)
        start = None if cyclic else requests[0] + 0.02
        angles = np.transpose(
            [
                simulate(model, column, cyclic=cyclic, start=None if cyclic else float(start[j]))
                for j, (model, column) in enumerate(zip(models, requests.T, strict=True))
            ]
        )
        noise = rng.normal(0.0, 0.002, (10, 3))
        limits = np.min(requests, axis=0), np.max(requests, axis=0)
        far = 0.1 * (shares == 0.0)  # [m], along an axis that does not count
        foot = leg.foot_positions(angles) + noise + far
        task = Task.of(models, foot, leg=leg, cyclic=cyclic, limits=limits, weights=weights)
        plan = np.tile(middle, (10, 1)) if cyclic else angles + 0.3 * (angles - angles[0])
        bound = foot_bound(replace(task, start=start), plan)
        assert bound <= np.sqrt(np.mean(noise**2 @ shares))


def test_a_solver_that_fails_makes_the_bound_weaker_and_never_wrong(monkeypatch):
    plan = short_plan(1, False, "rms")
    sharp = plan.lower_bound
    nothing = ConicSolution(np.zeros(0), np.zeros(0), "no luck", has_multipliers=False)
    name = "planner.planning.bounds.foot_bound.conic_solutions"
    monkeypatch.setattr(name, lambda *_, **__: [nothing])
    assert 0.0 < replace(plan).lower_bound <= sharp


def test_whole_turns_of_a_plan_change_no_bound():
    """Joints of robots may turn ten radians either way: a search that began elsewhere fails."""
    plan = short_plan(1, True, "rms", samples=8)
    turned = plan.predicted + 2.0 * np.pi * np.array([-2, 0, 1])
    assert plan.lower_bound > 0.0
    assert foot_bound(plan.plan.task, turned) == pytest.approx(plan.lower_bound, rel=1e-6)


def test_where_the_joints_could_follow_nothing_is_searched(monkeypatch):
    """The plan misses only what smoother requests may cost."""
    leg = ers210a_leg("hind_right")
    made = stride(leg, samples=40)
    joint = joint_of(5.2, 0.3, 0.02, 0.03, tick=0.01, hold=2, dead_band=0.01)
    plan = invert_foot([joint] * 3, replace(leg, near=made.pose), made.foot)
    assert plan.rms > 1e-5
    monkeypatch.setattr("planner.planning.bounds.foot_bound._improved", None)
    assert plan.lower_bound == 0.0


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), share=st.floats(0.0, 2.0), size=st.floats(0.0, 10.0))
def test_minima_are_proved_from_below_and_reached_from_above(seed, share, size):
    rng = np.random.default_rng(seed)
    leg = ers210a_leg("front_left")
    lower, upper = (np.tile(limit, (3, 1)) for limit in leg.limits)
    wanted = leg.foot_positions(rng.uniform(lower, upper)) + rng.normal(0.0, 0.02, (3, 3))
    distance = Distance(leg.chain, lower, upper, wanted, np.array([50.0, 30.0, 50.0]))
    shares, gradients = np.full(3, share), rng.normal(0.0, size, (3, 3))

    def values(angles):
        return shares * distance.squared(angles) + np.sum(gradients * angles, axis=1)

    tolerance = 1e-3
    proved, angles = minima(distance, shares, gradients, (lower + upper) / 2.0, tolerance=tolerance)
    assert np.all(angles >= lower)
    assert np.all(angles <= upper)
    reached = values(angles)
    assert np.all(proved <= reached)
    if share > 0.1:
        assert np.all(proved >= reached - 2.0 * tolerance - ROUNDING * np.abs(reached))
    for _ in range(200):
        assert np.all(proved <= values(rng.uniform(lower, upper)) + ROUNDING)


def cycles(seed, limits):
    """Random cycles of a random joint under requests within limits, [rad], and the joint."""
    rng = np.random.default_rng(seed)
    model = with_gravity(rng, random_model(rng, whole=False))
    for _ in range(5):
        requests = rng.choice([*limits, rng.uniform(*limits)], size=40)
        try:
            yield model, simulate(model, requests)
        except NoSteadyCycle:
            continue


def with_gravity(rng, model):
    """The joint, or one with dry friction that sags by its angle; it may be overcome."""
    if rng.random() < 0.5:
        return model
    sags = rng.normal(scale=0.5 * model.theta_0, size=2).tolist()
    band = model.theta_0 * rng.choice([0.0, 0.3])
    return replace(model, sag_sin=sags[0], sag_cos=sags[1], dead_band=float(band))


@given(seed=st.integers(0, 1000))
def test_a_cycle_and_a_joint_that_rests_first_stay_within_reach(seed):
    limits, rng = (-0.3, 0.4), np.random.default_rng(seed)
    model = with_gravity(rng, random_model(rng, whole=False))
    requests = rng.choice(limits, size=40)
    requests[0] = 0.1 - model.offset - model.pose_sag(0.1)
    motions = [(model, simulate(model, requests, cyclic=False, start=0.1), np.array([0.1]))]
    motions += [(*cycle, None) for cycle in cycles(seed, limits)]
    for joint, angles, start in motions:
        box = attainable_angles([joint], np.array(limits)[:, np.newaxis], 40, start=start)
        lower, upper = (edges[:, 0] for edges in box)
        assert np.all((angles >= lower - ROUNDING) & (angles <= upper + ROUNDING))


@pytest.mark.parametrize("limits", [(-np.inf, np.inf), (-0.3, np.inf), (-np.inf, 20.0)])
def test_without_limits_a_cycle_is_within_reach_but_for_whole_turns(limits):
    for model, angles in cycles(0, (5.0, 19.0)):
        box = attainable_angles([model], np.array(limits)[:, np.newaxis], 40, start=None)
        lower, upper = (edges[0, 0] for edges in box)
        turns = 2.0 * np.pi * np.arange(-5, 6)
        fits = (np.min(angles) + turns >= lower) & (np.max(angles) + turns <= upper)
        assert np.isfinite(upper - lower)
        assert np.any(fits)
