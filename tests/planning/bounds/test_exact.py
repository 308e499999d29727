"""The search behind the exact bound: no response that is better than what is known is ever lost."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import JointModel, certify, invert_optimal, lower_bound, simulate
from planner.arrays import error_norm
from planner.planning.bounds.exact import (
    Node,
    ScaledProblem,
    branch,
    conditions,
    cut_off,
    exact_bound,
    solve_relaxation,
    tighten,
    without_load,
)
from tests.instances import ERS210A, REFERENCE_JOINTS, random_model, saturating
from tests.plans import joint_task
from tests.strategies import models, trajectories

ROUNDING = 1e-7
"""Rounding of angles, contributions and cuts [theta_0]; the cycle closes to 1e-12 rad."""

WITHIN = 1e-3  # what plans of the reference walk's joints may be above the bound
SUMMED = 1e-9  # sums of at most a dozen terms of about one


def unknowns(problem, model, requests, middle, *, cyclic, start):
    """What the response to the requests is among the problem's unknowns, and its requests."""
    every_tick = replace(model, hold=1)
    held = np.repeat(requests, model.hold)[: problem.ticks]
    angles = simulate(every_tick, held, cyclic=cyclic, start=start)
    before = np.roll(angles, 1)
    if not cyclic:
        before[0] = requests[0] + model.offset if start is None else start
    apart = np.asarray(requests)[problem.request] + model.offset - before[problem.tick]
    contributions = model.speed(apart) / model.v_max - problem.excess
    scaled = (np.asarray(requests) + model.offset - middle) / problem.unit - problem.excess
    return np.concatenate([(angles - middle) / problem.unit, contributions]), scaled


def violation(problem, node, point, requests):
    """By how much the response misses what the node says about it."""
    matrix, limits = conditions(problem, node.ranges, node.cuts)
    above = matrix @ point - limits
    equations = problem.equations
    worst = max(float(np.max(np.abs(above[:equations]))), float(np.max(above[equations:])))
    for request, (lower, upper) in node.intervals.items():
        worst = max(worst, lower - requests[request], requests[request] - upper)
    return worst


def without_dead_band(model):
    """The joint without what the level "exact" was not derived for."""
    return replace(model, dead_band=0.0)


@pytest.mark.parametrize(
    ("kind", "norm"), [("cyclic", "rms"), ("from rest", "rms"), ("from a start", "max")]
)
@settings(max_examples=4)
@given(
    model=st.one_of(
        models(holds=(1, 2)), models(holds=(1, 2), friction=True).map(without_dead_band)
    ),
    requests=trajectories(least=4, most=7, reach=0.5),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_response_better_than_what_is_known_stays_in_some_part(kind, norm, model, requests, seed):
    rng = np.random.default_rng(seed)
    cyclic = kind == "cyclic"
    start = float(requests[0] + model.offset) if kind == "from a start" else None
    angles = simulate(model, requests, cyclic=cyclic, start=start)
    desired = angles + rng.normal(size=len(angles)) * model.theta_0 * 10.0 ** rng.uniform(-2, 0)
    known = 1.0001 * error_norm(angles - desired, norm)
    task = joint_task(model, desired, cyclic=cyclic, norm=norm, start=start)
    problem, middle = ScaledProblem(task, known), float(np.mean(desired))
    point, scaled = unknowns(problem, model, requests, middle, cyclic=cyclic, start=start)
    ranges = problem.initial_ranges()
    node = Node(0.0, dict(problem.fixed), ranges, [], solve_relaxation(problem, ranges, []))
    assert violation(problem, node, point, scaled) <= ROUNDING
    for _ in range(2):
        assert tighten(problem, ranges, node.solution, range(problem.ticks))
        node = cut_off(problem, node)
        assert violation(problem, node, point, scaled) <= ROUNDING
        assert node.bound * problem.unit <= error_norm(angles - desired, norm) + ROUNDING
    for _ in range(3):  # follow it down the tree
        parts = branch(problem, node)
        if not parts:
            break  # no cut is left
        misses = [violation(problem, part, point, scaled) for part in parts]
        assert min(misses) <= ROUNDING
        node = parts[int(np.argmin(misses))]
        assert node.bound * problem.unit <= error_norm(angles - desired, norm) + ROUNDING


@pytest.mark.parametrize(("seed", "norm", "samples"), [(1, "rms", 8), (1, "max", 6), (3, "max", 6)])
def test_the_bound_is_valid_whatever_is_said_to_be_known(seed, norm, samples):
    """Of so few samples most of the tree is searched."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=False)
    desired = saturating(rng, model, samples=samples)
    best = invert_optimal(model, desired, norm=norm, smoothness=0.0).error
    for known in (0.99 * best, 3.0 * best):
        bound = exact_bound(joint_task(model, desired, norm=norm), known, time_limit=0.3)
        assert bound <= min(known, best)


def test_what_no_response_goes_below_is_proved_to_the_full():
    rng = np.random.default_rng(5)
    model = random_model(rng, whole=False)
    desired = saturating(rng, model, samples=24)
    known = 0.5 * lower_bound(model, desired)
    bound = exact_bound(joint_task(model, desired), known, time_limit=1.0)
    assert bound == pytest.approx(known, rel=1e-3)


def test_the_plan_of_the_reference_walk_is_within_a_thousandth_of_the_best():
    joint = REFERENCE_JOINTS[0]
    certificate = certify(ERS210A, joint.desired, level="exact", time_limit=2.0)
    assert math.degrees(certificate.bound) >= joint.exact_bound_deg
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, smoothness=0.0)
    assert 0.0 <= plan.rms / certificate.bound - 1.0 <= WITHIN
    assert certificate.solver_gap <= WITHIN


@pytest.mark.parametrize(
    ("hold", "samples", "cyclic", "norm"), [(1, 16, True, "rms"), (2, 8, False, "max")]
)
def test_the_levels_are_ordered_and_no_plan_goes_below_them(samples, hold, cyclic, norm):
    rng = np.random.default_rng([samples, hold, cyclic])
    model = random_model(rng, whole=False, hold=hold)
    desired = saturating(rng, model, samples=samples)
    plan = invert_optimal(model, desired, cyclic=cyclic, norm=norm)
    for start in {None, plan.plan.task.starts[0]}:
        options = {"cyclic": cyclic, "norm": norm, "start": start, "time_limit": 0.1}
        bounds = [
            lower_bound(model, desired, level=level, **options)
            for level in ("slope", "envelope", "exact")
        ]
        assert bounds[0] <= bounds[1] * (1.0 + 1e-7) + 1e-12
        assert bounds[1] <= bounds[2] <= plan.error


@given(models(friction=True), trajectories(most=12), st.floats(-1.0, 1.0), st.booleans())
def test_a_constant_load_is_part_of_the_offsets(model, requests, torque, cyclic):
    loaded = joint_task(model, requests, cyclic=cyclic, load=torque)
    same = without_load(loaded)
    assert same.load is None
    np.testing.assert_allclose(
        simulate(same.nominal[0], requests, cyclic=cyclic),
        simulate(model, requests, cyclic=cyclic, load=torque),
        rtol=0.0,
        atol=SUMMED,
    )


def test_a_solver_that_runs_out_of_time_reports_its_gap_and_still_bounds():
    model = random_model(np.random.default_rng(3))
    desired = saturating(np.random.default_rng(4), model, samples=120)
    certificate = certify(model, desired, level="exact", time_limit=0.3)
    assert certificate.solver_gap > 0.0
    assert certificate.bound >= lower_bound(model, desired)


def test_a_mixture_of_requests_without_a_weight_is_branched_on():
    model = JointModel(v_max=3.0, theta_0=0.1, lag=0.03, acceleration_time=0.01, tick=0.02)
    desired = [0.0, 0.01, -0.01, 0.02, 0.0]
    bound = lower_bound(model, desired, cyclic=False, level="exact", time_limit=1.0)
    assert 6.0e-3 < bound < 6.08e-3  # [rad]; 5.42e-3 without cuts, and a response has 6.08e-3
