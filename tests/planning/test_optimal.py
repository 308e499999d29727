"""The optimised plan: near its bound, within its limits, and never worse than the closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from planner import JointModel, invert_closed_form, invert_optimal, simulate
from planner.model.evidence import ENCODER_STEP
from planner.planning.line_inverse import RULES
from planner.trajectory import rms
from tests.instances import (
    ERS210A,
    REFERENCE_JOINTS,
    TICK,
    attainable,
    random_model,
    random_model_outside_equation_13,
    saturating,
)

GAP = 0.005  # most by which a plan may exceed that of a general solver
GAP_ON_THE_WALK = 0.002  # most by which a plan may exceed the exact bound on the reference walk
ATTAINED = math.radians(0.01)  # largest rms error on what the joint can do [rad]
NO_WORSE = 1e-12  # rounding between two simulations of the same requests [rad]


SAME_QUALITY = 1e-3
"""Difference of rms between two searches that take the same steps but for rounding [relative]."""

pytestmark = pytest.mark.filterwarnings("ignore::planner.exceptions.OutsideEquation13")


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_the_gap_on_the_reference_walk_is_at_most_a_fifth_of_a_percent(joint):
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, smoothness=0.0)
    assert math.degrees(plan.rms) <= (1.0 + GAP_ON_THE_WALK) * joint.exact_bound_deg
    assert math.degrees(plan.rms) >= joint.exact_bound_deg - 1e-3
    lower, upper = joint.limits
    assert np.all((plan.requests >= lower) & (plan.requests <= upper))


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_the_largest_error_on_the_reference_walk_comes_within_three_percent_of_its_bound(joint):
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, norm="max")
    assert plan.norm == "max"
    assert 0.0 <= plan.gap <= 0.03
    assert plan.max_error < invert_optimal(ERS210A, joint.desired, limits=joint.limits).max_error


@pytest.mark.parametrize("limited", [False, True], ids=["free", "limited"])
@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("seed", [1, 3, 5])
def test_no_closed_form_within_the_limits_does_better(seed, cyclic, limited):
    rng = np.random.default_rng([seed, cyclic, limited])
    model = (
        random_model_outside_equation_13(rng)
        if seed % 4 == 3
        else random_model(rng, whole=seed % 2 == 0, hold=1 + (seed == 1), offset=seed > 3)
    )
    desired = (saturating if seed % 3 else attainable)(rng, model, samples=60)
    limits = _barely_around(desired - model.offset) if limited else None
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


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
def test_no_closed_form_does_better_for_a_joint_at_top_speed_throughout(cyclic):
    # Without closed forms to start from, plans of these cycles are 0.01 to 0.14 % worse than them.
    model = JointModel(v_max=2.3, theta_0=0.086, lag=0.047, acceleration_time=0.031, tick=TICK)
    for seed in (4, 5, 7):
        rng = np.random.default_rng([seed, cyclic])
        desired = rng.normal(size=17 + 9 * (seed % 3))
        plan = invert_optimal(model, desired, cyclic=cyclic, smoothness=0.0)
        closed_forms_do_no_better(plan)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_within_tight_limits_no_general_least_squares_does_better(seed, cyclic):
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    desired = saturating(rng, model, samples=40)
    lower, upper = _barely_around(desired)
    plan = invert_optimal(model, desired, cyclic=cyclic, limits=(lower, upper))
    start = None if cyclic else desired[0]
    movable = slice(0 if cyclic else 1, None)

    def residuals(free):
        requests = np.append(desired[: movable.start], free)
        return simulate(model, requests, cyclic=cyclic, start=start) - desired

    inside = np.clip(plan.requests[movable], lower + 1e-9, upper - 1e-9)
    improved = least_squares(residuals, inside, bounds=(lower, upper), max_nfev=30)
    assert plan.rms <= math.sqrt(2.0 * improved.cost / len(desired)) * (1.0 + GAP)


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


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(2))
def test_shift_mirror_rotation_and_an_offset_of_the_joint_change_nothing_else(seed, cyclic):
    desired = saturating(np.random.default_rng(seed), ERS210A)
    same = pytest.approx(invert_optimal(ERS210A, desired, cyclic=cyclic).rms, rel=SAME_QUALITY)
    for other in (desired + 2.0, -desired, *([np.roll(desired, 31)] if cyclic else [])):
        assert invert_optimal(ERS210A, other, cyclic=cyclic).rms == same
    sagging = replace(ERS210A, offset=(-2.0, -0.5, 0.5)[seed])
    assert invert_optimal(sagging, desired, cyclic=cyclic).rms == same


def test_every_kind_of_joint_gets_a_plan_near_its_bound():
    rng = np.random.default_rng(99)
    gaps = []
    for seed in range(12):
        model = random_model(rng, whole=seed % 2 == 0, hold=1 + seed % 3, offset=True)
        gaps.append(invert_optimal(model, saturating(rng, model)).gap)
    assert np.median(gaps) <= 0.02
    assert min(gaps) >= 0.0


def _barely_around(requests):
    """Limits that leave the desired angles a thousandth of a radian of room."""
    return float(np.min(requests)) - 1e-3, float(np.max(requests)) + 1e-3
