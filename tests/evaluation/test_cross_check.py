"""The cross-check: sound plans pass, sabotaged ones fail the check that is meant for them."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given

import planner
from planner.evaluation.checks import CLAIMS, bound_checks, second_answer
from planner.evaluation.cross_check import METHODS, SECOND, compare_joint, cross_check, judge_foot
from planner.exceptions import NoSteadyCycle
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_foot, invert_optimal
from tests.instances import ERS210A, attainable, joint_of, random_model, saturating
from tests.plans import claiming, inversion
from tests.strategies import models, trajectories

ABOVE, AGREES, CLOSES, INSIDE, RESTS, SOLVED = (
    CLAIMS[key].name for key in ("above", "agrees", "closes", "inside", "rests", "solved")
)
PHASE = 2.0 * np.pi * np.arange(88) / 88
DESIRED = 0.6 * np.sin(PHASE) + 0.25 * np.cos(2.0 * PHASE)
PAPER, EXACT, OPTIMAL = (METHODS[m] for m in ("closed_form_paper", "closed_form_exact", "optimal"))


@pytest.fixture(scope="module")
def walk():
    return planner.reference_walk()


@pytest.fixture(scope="module")
def of_walk(walk):
    return cross_check(ERS210A, walk.desired, leg=walk.leg, segments=6)


def _plans(*, cyclic=True):
    return dict(_planned(cyclic))


@cache
def _planned(cyclic):
    closed = {
        f"closed_form_{rule}": invert_closed_form(
            ERS210A, DESIRED, cyclic=cyclic, segments=6, rule=rule
        )
        for rule in ("paper", "exact")
    }
    optimal = invert_optimal(ERS210A, DESIRED, cyclic=cyclic, limits=(-1.0, 1.0))
    return {**closed, "optimal": optimal}


def _broken(comparison):
    return {(check.plan, check.name) for check in comparison.checks if not check.passed}


def test_the_reference_walk_passes_and_in_the_foot_the_plan_for_all_joints_is_the_best(
    of_walk, walk
):
    assert of_walk.passed
    assert not of_walk.failures
    assert [joint.name for joint in of_walk.joints] == list(walk.joint_names)
    assert {check.subject for check in of_walk.checks} == {*walk.joint_names, "foot"}
    rms = {method: float(plan.rms[0]) for method, plan in of_walk.foot.plans.items()}
    assert list(rms) == list(METHODS)
    assert min(rms, key=rms.get) == "foot_optimal"
    assert of_walk.foot.differences["foot_optimal"] == (0.0, 0.0)
    assert of_walk.foot.differences["optimal"].max > 0.0


@pytest.mark.filterwarnings("ignore::planner.OutsideEquation13")
@pytest.mark.parametrize("seed", range(6))
def test_random_joints_pass(seed):
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=seed % 2 == 0, hold=1 + seed % 3, offset=True)
    desired = (saturating if seed % 2 else attainable)(rng, model, samples=44)
    norm = "max" if seed == 5 else "rms"
    check = cross_check(model, desired, cyclic=seed % 3 > 0, norm=norm)
    assert check.passed, check.failures
    (joint,) = check.joints
    errors = [joint.plans[method].error for method in (SECOND, "optimal")]
    # Of the largest error more local minima are as good.
    assert errors[0] == pytest.approx(errors[1], rel=0.01 if norm == "rms" else 0.05, abs=2e-4)


def test_limits_hold_for_all_joints_or_one_by_one():
    desired = np.where(np.arange(20) < 10, 0.0, 20 * ERS210A.v_max_per_tick / 3)
    check = cross_check(ERS210A, np.column_stack([desired] * 2), limits=([0.0, -1.0], [0.3, 1.0]))
    assert [joint.limits for joint in check.joints] == [(0.0, 0.3), (-1.0, 1.0)]
    assert check.passed
    plans = check.joints[0].plans
    closed_form, optimal = plans["closed_form_paper"], plans["optimal"]
    assert np.min(optimal.requests) >= 0.0
    assert np.max(optimal.requests) <= 0.3
    # The closed form knows no limits: being better beyond them fails no plan that keeps them.
    assert np.max(closed_form.requests) > 0.3
    assert closed_form.rms < optimal.rms


@pytest.mark.parametrize("cyclic", [True, False])
@given(model=models(friction=True, inertia=True, poses=True), requests=trajectories())
def test_the_second_answer_agrees_for_any_joint(cyclic, model, requests):
    load = np.random.default_rng(len(requests)).uniform(-1.0, 1.0, len(requests))
    plan = inversion(model, requests, requests, cyclic=cyclic, load=load).plan
    try:
        answer = second_answer(plan)
    except NoSteadyCycle:
        return
    assert answer.agreement <= CLAIMS["agrees"].tolerance
    assert not cyclic or answer.closure <= CLAIMS["agrees"].tolerance


def test_the_second_solvers_plan_is_a_plan_of_its_own_and_as_good(of_walk):
    for joint in of_walk.joints:
        second, optimal = joint.plans[SECOND], joint.plans["optimal"]
        assert (second.plan.solver, optimal.plan.solver) == ("ipopt", "gauss-newton")
        assert not np.array_equal(second.requests, optimal.requests)
        assert joint.gap(SECOND) == pytest.approx(joint.gap("optimal"), abs=2e-3)
        assert {check.name for check in joint.checks if check.plan == METHODS[SECOND]} >= {
            AGREES,
            CLOSES,
            ABOVE,
            INSIDE,
            SOLVED,
        }


def test_optimised_requests_that_are_not_as_good_as_the_second_solvers_fail():
    plans = _plans()
    better = replace(plans["optimal"], solver="ipopt")
    worse = np.clip(plans["optimal"].requests + 0.1, -1.0, 1.0)
    comparison = compare_joint(
        "hip", {**plans, "optimal": replace(plans["optimal"], requests=worse), SECOND: better}
    )
    assert (OPTIMAL, "as good as IPOPT's") in _broken(comparison)


WORSE = {f"no worse than {PAPER}", f"no worse than {EXACT}"}

SABOTAGED = {
    "another angle": (
        "optimal",
        lambda plan: claiming(plan, plan.predicted + 1e-8 * (PHASE == 0.0)),
        {AGREES},
    ),
    "a cycle that does not close": (
        "closed_form_exact",
        lambda plan: claiming(plan, plan.predicted + 1e-3),
        {AGREES, CLOSES},
    ),
    "a start where it does not rest": (
        "optimal",
        lambda plan: claiming(plan, np.roll(plan.predicted, 1)),
        {AGREES, RESTS} | WORSE,
    ),
    "another time": (
        "optimal",
        lambda plan: replace(plan, requests=np.roll(plan.requests, 3)),
        WORSE,
    ),
    "up to a limit": ("optimal", lambda plan: limited(plan, 0.0), set()),
    "beyond a limit": ("optimal", lambda plan: limited(plan, 1e-11), {INSIDE}),
}


def limited(plan, by):
    """The plan with a lower limit above its least request by so much [rad]."""
    return replace(plan, lower=np.array([np.min(plan.requests) + by]), upper=np.array([1.0]))


@pytest.mark.parametrize("name", SABOTAGED)
def test_a_sabotaged_plan_fails_the_checks_that_are_meant_for_it(name):
    method, change, broken = SABOTAGED[name]
    plans = _plans(cyclic="rest" not in name)
    plans[method] = change(plans[method])
    comparison = compare_joint("hip", plans)
    assert _broken(comparison) == {(METHODS[method], each) for each in broken}


def test_angles_too_good_to_be_true_are_below_the_bound():
    model = replace(ERS210A, v_max=0.3 * ERS210A.v_max)
    plans = {
        "closed_form_exact": invert_closed_form(model, DESIRED, rule="exact"),
        "optimal": invert_optimal(model, DESIRED),
    }
    plans["optimal"] = claiming(plans["optimal"], plans["optimal"].desired)
    assert (OPTIMAL, ABOVE) in _broken(compare_joint("hip", plans))


def test_bounds_out_of_order_are_noticed():
    bounds = {"slope": 0.2, "envelope": 0.1, "exact": 0.3}
    ordered, *plans = bound_checks("hip", bounds, {"optimised": 0.25})
    assert not ordered.passed
    assert ordered.name == "bounds ordered, slope ≤ envelope ≤ exact"
    assert [check.passed for check in plans] == [False]
    equal = bound_checks("hip", {"slope": 0.1, "envelope": 0.1}, {"o": 0.1})
    assert all(check.passed for check in equal)


def test_a_plan_for_the_foot_that_is_late_fails_in_the_foot(of_walk, walk):
    plan = invert_foot(ERS210A, walk.leg, walk.desired_foot)
    assert not _broken(judge_foot(of_walk.joints, plan))
    late = replace(plan, requests=np.roll(plan.requests, 8, axis=0))
    late.plan.__dict__["lower_bounds"] = (
        plan.plan.lower_bounds
    )  # that of the path, as no plan is searched
    broken = {name for _, name in _broken(judge_foot(of_walk.joints, late))}
    others = PAPER, EXACT, OPTIMAL, METHODS[SECOND]
    assert broken == {f"no worse than {label}" for label in others}
    lower, upper = plan.plan.task.lower, plan.plan.task.upper
    tight = replace(plan, lower=lower, upper=upper - 1.0)
    tight.plan.__dict__["lower_bounds"] = plan.plan.lower_bounds
    broken = _broken(judge_foot(of_walk.joints, tight))
    assert (METHODS["foot_optimal"], INSIDE) in broken


def test_requests_that_leave_the_angle_open_pass():
    # A triangle steeper than the joint is fast: the paper's rule saturates it all the time.
    desired = 2.0 * ERS210A.v_max_per_tick * np.abs(np.arange(40.0) - 20.0)
    joint = cross_check(ERS210A, desired).joints[0]
    assert not {check.name for check in joint.checks if not check.passed} & {AGREES, CLOSES}


@pytest.mark.parametrize("norm", ["rms", "max"])
def test_a_plan_that_rests_elsewhere_has_no_gap_to_the_foots_bound(norm):
    joint = joint_of(math.radians(250.0), math.radians(3.0), 0.0, 0.008)
    steps = np.maximum(np.arange(16) - 2, 0)[:, np.newaxis] / 13.0
    desired = np.radians(np.hstack([10.0 + 23.4 * steps, 20.0 + 0.0 * steps, -20.0 + 16.0 * steps]))
    leg = planner.reference_walk().leg
    foot = cross_check(joint, desired, cyclic=False, norm=norm, leg=leg).foot
    assert foot.gap("foot_optimal") >= 0.0  # it rests in the other pose that reaches the point
    assert foot.gap("optimal") is None
