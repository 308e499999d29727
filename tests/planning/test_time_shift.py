"""The best time shift: what it sends, and that no other shift is better."""

import math
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner import JointModel, NoSteadyCycle, Plan, simulate
from planner.arrays import error_norm, rms
from planner.model.evidence import Evidence
from planner.planning.plan import joined
from planner.planning.task import Task
from planner.planning.time_shift import USUAL, refining_recommended, shift_recommended, shifted
from tests.instances import ERS210A, random_model, saturating

NEARBY = 1e-3  # share of the error that a lead within the tolerance of the best one may cost
PATH = 0.3 * np.sin(2.0 * np.pi * np.arange(80) / 80)  # a path that the ERS-210A follows [rad]
SIZE = rms(np.diff(PATH, 2)) / ERS210A.period**2  # its acceleration [rad/s^2]


def test_requests_are_the_desired_angles_between_samples_the_lead_early():
    made = planner.invert_shift(ERS210A, PATH)
    assert made.method == "shift"
    places = np.arange(80) + made.lead / ERS210A.period
    expected = np.interp(places, np.arange(80), PATH, period=80)
    np.testing.assert_allclose(made.requests, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("norm", ["rms", "max"])
def test_no_shift_by_whole_samples_or_a_twentieth_of_one_is_better(seed, norm):
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=False, hold=1 + seed % 3, offset=seed % 2 == 1)
    desired = (0.2, 1.0, 3.0)[seed % 3] * saturating(rng, model, samples=60)
    made = planner.invert_shift(model, desired, norm=norm)
    delay = model.lag + model.acceleration_time / 2.0 + model.theta_0 / model.v_max
    leads = [*range(int(USUAL * delay / model.period) + 3)]
    leads += [max(made.lead / model.period + part, 0.0) for part in (-0.05, 0.05)]
    for lead in leads:
        sent = np.interp(np.arange(60) + lead, np.arange(60), desired, period=60)
        error = error_norm(simulate(model, sent) - desired, norm)
        assert made.error <= error * (1.0 + 1e-12)


def test_from_rest_the_first_request_holds_the_joint_and_the_last_angle_is_held():
    model = replace(ERS210A, offset=0.02)
    made = planner.invert_shift(model, PATH[:40], cyclic=False, start=-0.05)
    assert made.requests[0] == pytest.approx(-0.07, abs=1e-12)
    assert made.predicted[0] == pytest.approx(-0.05, abs=1e-12)
    assert np.all(made.requests[-5:] == PATH[39])


def test_the_load_is_that_of_the_path():
    heavy = replace(ERS210A, compliance=0.1)
    load = np.full(80, 0.5)
    made = planner.invert_shift(heavy, PATH, load=load)
    np.testing.assert_allclose(made.predicted, simulate(heavy, made.requests, load=load))
    light = planner.invert_shift(ERS210A, PATH)
    np.testing.assert_allclose(made.errors, light.errors + 0.05, atol=1e-3)


def test_every_joint_has_a_lead_of_its_own_and_a_plan_has_the_same():
    slow = replace(ERS210A, lag=0.08)
    desired = np.column_stack([PATH, PATH])
    made = planner.plan([ERS210A, slow], desired, method="shift", names=["hip", "knee"])
    alone = [planner.invert_shift(model, PATH) for model in (ERS210A, slow)]
    assert made.leads == tuple(each.lead for each in alone)
    assert made.leads[1] > made.leads[0] + 0.03
    np.testing.assert_array_equal(made.requests, np.column_stack([a.requests for a in alone]))
    assert [each.lead for each in made.inversions] == list(made.leads)
    assert planner.invert_optimal(ERS210A, PATH).lead is None
    parts = [made.joint(j) for j in range(2)]
    assert [part.leads for part in parts] == [(lead,) for lead in made.leads]
    assert joined(parts).leads == made.leads


def test_requests_of_a_shift_keep_limits_within_which_the_joint_is_held():
    """The joint rests 0.1 rad beside its requests: it reaches angles beyond the limit on these."""
    model = replace(JointModel.ers210a(), offset=0.1)
    desired = 0.05 + 0.55 * np.sin(2.0 * np.pi * np.arange(88) / 88)
    plan = planner.plan(model, desired, limits=(-0.7, 0.52), method="shift")
    assert np.max(desired) > 0.59
    assert (np.max(plan.requests), np.min(plan.requests) > -0.7) == (0.52, True)


def planned(evidence, path=PATH, **terms):
    """The plan of a joint of which so much is known."""
    return planner.invert_optimal(replace(ERS210A, **terms).with_evidence(evidence), path).plan


def test_an_error_of_the_model_is_no_reason_for_a_shift_whose_lead_is_that_models():
    plan = planned(Evidence(error=1.0, over_delay=0.1))
    assert plan.expected[0].error > 10.0 * planner.invert_shift(ERS210A, PATH).rms
    assert not shift_recommended(plan, shifted(plan.task))


UNTESTED = {
    "accelerates": (
        (150.0, 1.0, 0.0, True),
        (150.0, 1.0, 20.0, False),
        (150.0, 100.0, 0.0, False),
        (math.inf, 0.48 * SIZE, None, True),  # far beyond, where the model has no limit
        (math.inf, 0.52 * SIZE, None, False),
    ),
    "moves": (
        (math.inf, 1.0, math.inf, True),
        (math.inf, 1.0, 9.0, False),
        (math.inf, 9.0, math.inf, False),
    ),
}
"""Largest acceleration, what was tested of acceleration or speed, an end of the interval of its
largest, and whether a shift is better."""


@pytest.mark.parametrize("way", UNTESTED)
def test_a_shift_is_recommended_beyond_tested_motion_where_the_largest_is_unknown(way):
    for limit, tested, end, recommended in UNTESTED[way]:
        known = {"speed": tested, "intervals": {"v_max": (1.0, end)}}
        if way == "accelerates":
            known = {"by_acceleration": ((0.0, 1e-4), (tested, 1e-4))}
            known |= {} if end is None else {"intervals": {"max_acceleration": (end, 300.0)}}
        evidence = Evidence(error=1e-4, over_delay=0.1, **known)
        plan = planned(evidence, max_acceleration=limit)
        why = shift_recommended(plan, shifted(plan.task))
        more = {"accelerates": "accelerates more", "moves": "moves faster"}[way]
        assert why.startswith(f"the joint {more} than in its logs" if recommended else "")
        assert bool(why) == recommended


def test_requests_are_better_refined_where_the_error_is_the_models_and_near_that_of_the_shift():
    shift = planner.invert_shift(ERS210A, PATH)
    for share, recommended in ((0.7, True), (5.0, True), (0.4, False)):
        plan = planned(Evidence(error=share * shift.rms, over_delay=0.1))
        best = shifted(plan.task)
        expected = plan.expected[0].error
        assert (expected > 0.5 * best.expected[0].error) == recommended
        assert bool(refining_recommended(plan, best)) == recommended
    # Not where the joint is too slow for the path, nor below the step of an encoder.
    slow = planned(Evidence(error=0.01), saturating(np.random.default_rng(0), ERS210A))
    assert slow.rms[0] > 0.01
    exact = planned(Evidence(error=0.0014), 0.01 * PATH)
    assert exact.expected[0].error > 0.5 * shifted(exact.task).expected[0].error
    for plan in (planned(Evidence(error=0.02), 0.3 * PATH), slow, exact):
        assert not refining_recommended(plan, shifted(plan.task))


def test_a_shift_is_recommended_where_its_error_to_expect_is_clearly_smaller():
    """A plan that stands still is worse than any shift."""
    known = ERS210A.with_evidence(Evidence(error=1e-3, over_delay=0.1))
    task = Task.of([known], PATH, names=("",))
    shift = shifted(task)
    still = Plan(task=task, requests=np.zeros((len(PATH), 1)), method="optimal")
    assert shift_recommended(still, shift) == "its error to expect is smaller"
    assert not shift_recommended(shift, shift)


def test_leads_at_which_a_joint_rings_for_ever_are_left_out():
    """It overshoots, and does not settle for requests that are 11 periods early."""
    four = {"v_max": 5.25, "theta_0": 0.247, "lag": 0.01, "acceleration_time": 0.02}
    joint = JointModel(**four, tick=0.001, hold=20, dead_band=0.016, max_acceleration=22.0)
    turns = 2.0 * np.pi * np.arange(40) / 40
    path = np.radians(
        18.0 * np.sin(turns) + 5.0 * np.sin(2.0 * turns + 1.0) + 3.0 * np.sin(3.0 * turns + 2.0)
    )
    with pytest.raises(NoSteadyCycle):
        simulate(joint, np.roll(path, -11))
    errors = [rms(simulate(joint, np.roll(path, -samples)) - path) for samples in range(9)]
    assert planner.invert_shift(joint, path).rms <= min(errors) * (1.0 + NEARBY)
