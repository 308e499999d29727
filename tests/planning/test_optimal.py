"""The optimised plan: near its bound, within limits and steps, no worse than the closed form."""

import math
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from planner import (
    JointModel,
    invert_closed_form,
    invert_foot,
    invert_optimal,
    invert_shift,
    reference_walk,
    simulate,
)
from planner.arrays import rms, steps
from planner.model.evidence import ENCODER_STEP
from planner.planning.closed_form import nearest_within_speeds, within_attainable_range
from planner.planning.line_inverse import RULES
from tests.instances import (
    ERS210A,
    REFERENCE_JOINTS,
    TICK,
    attainable,
    random_model,
    random_model_outside_equation_13,
    saturating,
)

GAP_ON_THE_WALK = 0.002  # most by which a plan may exceed the exact bound on the reference walk
ATTAINED = math.radians(0.01)  # largest rms error on what the joint can do [rad]
NO_WORSE = 1e-12  # rounding between two simulations of the same requests [rad]

SAME_QUALITY = 1e-3
"""Difference of rms between two searches that take the same steps but for rounding [relative]."""

pytestmark = pytest.mark.filterwarnings("ignore::planner.exceptions.OutsideEquation13")
EXACT = 1e-12  # by how much a step may exceed the limit: the rounding of one subtraction [relative]
CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_the_gap_on_the_reference_walk_is_at_most_a_fifth_of_a_percent(joint):
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, smoothness=0.0)
    assert math.degrees(plan.rms) <= (1.0 + GAP_ON_THE_WALK) * joint.exact_bound_deg
    assert math.degrees(plan.rms) >= joint.exact_bound_deg - 1e-3
    lower, upper = joint.limits
    assert np.all((plan.requests >= lower) & (plan.requests <= upper))


def test_a_plan_is_no_worse_than_the_best_shift_where_a_path_needs_too_much_acceleration():
    weak = JointModel(
        v_max=7.2,
        theta_0=0.38,
        lag=2.0 * TICK,
        acceleration_time=TICK,
        tick=TICK,
        time_constant=TICK,
        max_acceleration=44.0,
    )
    turn = 2.0 * np.pi * np.arange(75) / 75
    desired = 0.6 * np.sin(turn) + 0.15 * np.sin(2.0 * turn + 1.0)
    plan = invert_optimal(weak, desired, smoothness=0.0)
    assert plan.rms <= invert_shift(weak, desired).rms + NO_WORSE


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_the_largest_error_on_the_reference_walk_comes_within_three_percent_of_its_bound(joint):
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, norm="max")
    assert plan.norm == "max"
    assert 0.0 <= plan.gap <= 0.03
    assert plan.max_error < invert_optimal(ERS210A, joint.desired, limits=joint.limits).max_error


@pytest.mark.parametrize("limited", [False, True], ids=["free", "limited"])
@CYCLIC
@pytest.mark.parametrize("seed", [1, 3, 5])
def test_no_closed_form_within_the_limits_does_better(seed, cyclic, limited):
    rng = np.random.default_rng([seed, cyclic, limited])
    model = (
        random_model_outside_equation_13(rng)
        if seed % 4 == 3
        else random_model(rng, whole=seed % 2 == 0, hold=1 + (seed == 1), offset=seed > 3)
    )
    desired = (saturating if seed % 3 else attainable)(rng, model, samples=60)
    requests = desired - model.offset
    limits = (requests.min() - 1e-3, requests.max() + 1e-3) if limited else None
    plan = invert_optimal(model, desired, cyclic=cyclic, limits=limits, smoothness=0.0)
    # Each rule with six lines at one seed and with a number of its own choice at the next.
    closed_forms_do_no_better(plan, segments=(6, None) if seed % 2 else (None, 6))


def closed_forms_do_no_better(plan, *, segments=(None, None)):
    """Clipped to the limits of the plan, by each rule with so many lines."""
    limits = plan.plan.task.limits[0] or (-math.inf, math.inf)
    for rule, lines in zip(RULES, segments, strict=True):
        options = {"cyclic": plan.cyclic, "segments": lines, "rule": rule}
        other = invert_closed_form(plan.model, plan.desired, **options)
        requests = np.clip(other.requests, *limits)
        angles = simulate(plan.model, requests, cyclic=plan.cyclic, start=other.plan.task.starts[0])
        assert plan.rms <= rms(angles - plan.desired) + NO_WORSE


@CYCLIC
def test_no_closed_form_does_better_for_a_joint_at_top_speed_throughout(cyclic):
    # Without closed forms to start from, plans of these cycles are 0.01 to 0.14 % worse than them.
    model = JointModel(v_max=2.3, theta_0=0.086, lag=0.047, acceleration_time=0.031, tick=TICK)
    for seed in (4, 5, 7):
        rng = np.random.default_rng([seed, cyclic])
        desired = rng.normal(size=17 + 9 * (seed % 3))
        plan = invert_optimal(model, desired, cyclic=cyclic, smoothness=0.0)
        closed_forms_do_no_better(plan)


@pytest.mark.parametrize(
    ("seed", "samples", "hold"),
    [*((seed, 88, 1 + seed % 2) for seed in range(6)), (1, 25, 1), (20, 20, 1), (35, 30, 1)],
)
def test_what_the_joint_can_do_is_reached_to_a_hundredth_of_a_degree(seed, samples, hold):
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=False, hold=hold, offset=seed == 3)
    desired = attainable(rng, model, samples=samples)
    assert invert_optimal(model, desired, smoothness=0.0).rms <= ATTAINED
    assert invert_optimal(model, desired).rms <= ENCODER_STEP


@CYCLIC
@pytest.mark.parametrize("seed", range(2))
def test_shift_mirror_rotation_and_an_offset_of_the_joint_change_nothing_else(seed, cyclic):
    desired = saturating(np.random.default_rng(seed), ERS210A)
    same = pytest.approx(invert_optimal(ERS210A, desired, cyclic=cyclic).rms, rel=SAME_QUALITY)
    for other in (desired + 2.0, -desired, *([np.roll(desired, 31)] if cyclic else [])):
        assert invert_optimal(ERS210A, other, cyclic=cyclic).rms == same
    sagging = replace(ERS210A, offset=(-2.0, -0.5, 0.5)[seed])
    assert invert_optimal(sagging, desired, cyclic=cyclic).rms == same


@CYCLIC
@pytest.mark.parametrize("loaded", [True, False])
def test_the_ideal_is_the_nearest_trajectory_within_the_speeds_of_either_direction(loaded, cyclic):
    """By a convex solver; each step has the speeds under the torque of the sample where it ends."""
    model = replace(ERS210A, v_offset=0.8, speed_per_torque=0.9, compliance=0.01)
    load = np.cos(0.3 * np.arange(40)) if loaded else np.zeros(40)
    rows = np.pi * np.arange(40)
    desired = 0.4 * np.sin(rows / 20.0) + 0.1 * np.cos(0.3 * rows)
    made = nearest_within_speeds(model, desired, load, cyclic=cyclic)
    low, high = (np.broadcast_to(limit, 40) * model.period for limit in model.speed_limits(load))
    x = cp.Variable(40)
    steps, first = cp.diff(x), 0 if cyclic else 1
    if cyclic:
        steps = cp.hstack([x[0] - x[-1], steps])
    problem = cp.Problem(
        cp.Minimize(cp.sum_squares(x - desired)), [steps >= low[first:], steps <= high[first:]]
    )
    problem.solve(solver=cp.CLARABEL)
    np.testing.assert_allclose(made, x.value, rtol=0.0, atol=1e-4)  # the solver's


@pytest.mark.parametrize("load", [0.0, -0.5])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_from_rest_a_joint_is_within_reach_of_its_top_speed_from_the_second_request_on(way, load):
    model = replace(ERS210A, lag=0.028, hold=2, v_offset=0.8, speed_per_torque=0.9)
    torques = np.full(30, load)
    far = within_attainable_range(model, np.full(30, 99.0 * way), 0.5, torques)
    jump = np.full(30, 99.0 * way)
    jump[0] = 0.5
    angles = simulate(model, jump, cyclic=False, start=0.5, load=torques)
    assert np.all(way * (far - angles) >= -1e-12)
    np.testing.assert_array_equal(far == 0.5, angles == 0.5)
    top = model.speed_limits(load)[1 if way > 0.0 else 0] * model.period
    np.testing.assert_allclose(np.diff(far[far != 0.5]), top)
    np.testing.assert_allclose(np.diff(angles)[-3:], top)


def random_instance(seed):
    """A joint and a path with all that a plan may have, by seed: options of invert_optimal."""
    rng = np.random.default_rng([31, seed])
    model = random_model(rng, whole=bool(rng.integers(2)), hold=int(rng.integers(1, 4)))
    desired = saturating(rng, model, samples=int(rng.integers(20, 60)))
    cyclic = bool(rng.integers(2))
    options = {
        "cyclic": cyclic,
        "norm": ["rms", "max"][int(rng.integers(2))],
        "max_step": float(model.v_max * model.period * rng.uniform(0.1, 3.0)),
        "smoothness": [0.0, 0.005, 0.05][int(rng.integers(3))],
    }
    if rng.integers(2):
        model = replace(model, dead_band=rng.uniform(0.0, 0.5) * model.theta_0, compliance=0.02)
        options["load"] = rng.uniform(-1.0, 1.0, size=len(desired))
    if rng.integers(2):
        room = 0.02 + model.dead_band
        options["limits"] = (desired.min() - room, desired.max() + room)
    return model, desired, options


@pytest.mark.parametrize("kind", ["plain", "inertia", "several"])
@pytest.mark.parametrize("seed", range(6))
def test_steps_and_requests_are_within_their_limits_whatever_else_is_asked_for(seed, kind):
    model, desired, options = random_instance(seed)
    if kind == "inertia":
        model = replace(model, time_constant=0.016)
    models = [model, replace(model, lag=model.lag + 0.01)] if kind == "several" else model
    made = invert_optimal(models, desired, **options)
    task, limit = made.plan.task, options["max_step"]
    assert np.max(np.abs(steps(made.requests, cyclic=made.cyclic))) <= limit * (1.0 + EXACT)
    assert made.largest_step <= limit * (1.0 + EXACT)
    if task.limits[0] is not None:
        assert task.limits[0][0] <= np.min(made.requests)
        assert np.max(made.requests) <= task.limits[0][1]
    if not made.cyclic:
        load = 0.0 if task.loads[0] is None else task.loads[0][0]
        holding = task.starts[0] - model.sag(load)  # the middle of the requests that hold it
        assert made.requests[0] == pytest.approx(holding, abs=model.dead_band + 1e-12)
    assert made.error >= made.lower_bound - 1e-9


def test_a_wide_limit_changes_nothing_much_and_a_narrow_one_leaves_a_constant():
    joint = REFERENCE_JOINTS[0]
    free = invert_optimal(ERS210A, joint.desired)
    wide = invert_optimal(ERS210A, joint.desired, max_step=2.0)
    assert wide.rms == pytest.approx(free.rms, rel=0.005)
    narrow = invert_optimal(ERS210A, joint.desired, max_step=1e-6)
    assert np.ptp(narrow.requests) <= 88e-6
    assert narrow.rms == pytest.approx(np.std(joint.desired), rel=1e-3)


@CYCLIC
def test_the_foot_keeps_one_limit_or_one_for_each_joint(cyclic):
    walk = reference_walk()
    limits = np.radians([4.0, 5.0, 6.0])
    made = invert_foot(ERS210A, walk.leg, walk.desired_foot, cyclic=cyclic, max_step=limits)
    assert np.all(np.abs(steps(made.requests, cyclic=cyclic)) <= limits * (1.0 + EXACT))
    if cyclic:
        free = invert_foot(ERS210A, walk.leg, walk.desired_foot)
        assert made.rms <= 1.02 * free.rms
