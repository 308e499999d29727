"""The paper's experiment: baselines as published, plans as good as published."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import planner
from planner.evaluation import reproduction as paper
from planner.evaluation.reproduction import Clock, measure_step_response, plan_walk
from planner.model.joint import JointModel
from planner.model.response import simulate

PRINTED = 0.005
"""Figures known from an independent computation to two decimals [deg, cm]."""

KNOWN_DIRECT = {"rotator": (32.80, 57.14), "abductor": (28.86, 53.09), "knee": (23.84, 58.13)}
KNOWN_FOOT = {"direct": (3.156, 4.958), "shift": (1.470, 3.408)}


@pytest.mark.parametrize("joint", paper.JOINTS)
def test_the_direct_method_gives_the_known_distances(reproduction, joint):
    assert reproduction.table2[joint]["Des,Dir"] == pytest.approx(KNOWN_DIRECT[joint], abs=PRINTED)


@pytest.mark.parametrize("method", KNOWN_FOOT)
def test_the_foot_under_the_baselines_is_as_far_as_known(reproduction, method):
    assert reproduction.foot_table[method] == pytest.approx(KNOWN_FOOT[method], abs=PRINTED)


def test_the_ten_baseline_figures_agree_with_the_paper_within_a_tenth(reproduction):
    deviations = paper.deviations(reproduction.table2, reproduction.foot_table)
    assert len(deviations) == 10
    assert reproduction.baseline_deviation == pytest.approx(np.mean(deviations))
    assert reproduction.baseline_deviation < 0.1


def test_all_plans_beat_both_baselines_in_the_foot(reproduction):
    foot = {method: distance.rms for method, distance in reproduction.foot_table.items()}
    worst = max(foot["closed_form_plain"], foot["closed_form"], foot["optimal"])
    assert worst < foot["shift"] < foot["direct"]


def test_the_closed_form_as_in_the_paper_is_that_of_its_six_lines_without_refinement(reproduction):
    for joint in reproduction.joints:
        plain = planner.invert_closed_form(
            reproduction.model, joint.desired, segments=6, rule="paper", refine=False
        )
        assert np.array_equal(joint.closed_form_plain.requests, plain.requests)
    printed = f"{reproduction.foot_table['closed_form_plain'].rms:.2f}"
    assert printed == "1.08"  # as the README says


def test_the_plan_for_the_foot_keeps_it_closest_and_inside_the_limits(reproduction):
    foot = reproduction.foot_table["foot_optimal"]
    assert foot.rms <= 0.62
    assert foot.max <= 1.35
    lower, upper = reproduction.walk.leg.limits
    assert np.all(reproduction.foot_plan.requests >= lower)
    assert np.all(reproduction.foot_plan.requests <= upper)


def test_no_plan_beats_its_bound_and_the_optimised_one_is_worse_by_its_share_at_most(reproduction):
    for joint in reproduction.joints:
        most = 1.0051 * joint.closed_form.rms  # an encoder's step beside the noise's share
        assert joint.optimal.lower_bound <= joint.optimal.rms <= most


def test_every_distance_follows_from_the_requests_by_simulation(reproduction):
    for joint in reproduction.joints:
        angles = simulate(reproduction.model, joint.closed_form.requests)
        error = math.degrees(float(np.sqrt(np.mean((angles - joint.desired) ** 2))))
        assert reproduction.table2[joint.name]["Des,MB"].rms == pytest.approx(error, abs=1e-9)


def test_the_knee_is_one_upper_leg_from_the_hip_and_one_lower_leg_from_the_foot(reproduction):
    knee = reproduction.legs["desired"][:, 2]
    upper = np.linalg.norm(knee, axis=1)
    lower = np.linalg.norm(reproduction.walk.desired_foot - knee, axis=1)
    assert upper == pytest.approx(np.full(88, 0.064), abs=1e-12)
    assert lower == pytest.approx(np.full(88, 0.069), abs=1e-12)


@pytest.mark.parametrize("amplitude", paper.STEP_AMPLITUDES)
def test_a_step_test_shows_what_the_paper_reads_off_it(reproduction, amplitude):
    response = reproduction.steps[amplitude]
    assert (response.lag, response.acceleration) == (4, 6)
    assert response.v_max == pytest.approx(math.radians(2.5) / 0.008, rel=1e-9)


def test_lag_and_acceleration_time_are_read_off_any_joint():
    joint = JointModel(v_max=4.0, theta_0=0.15, lag=0.07, acceleration_time=0.03, tick=0.01)
    response = measure_step_response(joint, 1.0, samples=200)
    assert (response.lag, response.acceleration) == (7, 3)
    assert response.v_max == pytest.approx(4.0)


def test_joints_that_sag_are_optimised_for_where_they_can_rest_within_their_limits(monkeypatch):
    """Every plan of a joint is for its own model, limits and column of the walk."""
    asked = []

    def joint(model, desired, **options):
        asked.append((model, desired, options))
        return SimpleNamespace(lower_bound=0.0, requests=desired, predicted=desired)

    walk = planner.reference_walk()
    foot = SimpleNamespace(lower_bound=0.0, requests=walk.desired + 1.0, predicted=walk.desired - 1)
    models = [replace(JointModel.ers210a(), offset=sag) for sag in (0.0, 0.2, -0.9)]
    foot.models = tuple(models)
    monkeypatch.setattr("planner.evaluation.reproduction.invert_closed_form", joint)
    monkeypatch.setattr("planner.evaluation.reproduction.invert_optimal", joint)
    monkeypatch.setattr("planner.evaluation.reproduction.invert_foot", lambda *_: foot)
    told = []
    made = plan_walk(models, segments=5, clock=Clock(told.append))
    assert len(asked) == 9
    for j, (model, name) in enumerate(zip(models, paper.JOINTS, strict=True)):
        lower, upper = (float(each[j]) for each in walk.leg.limits)
        plain, refined, (own, resting, options) = asked[3 * j : 3 * j + 3]
        for (each, desired, lines), refine in ((plain, False), (refined, True)):
            assert each is model
            np.testing.assert_array_equal(desired, walk.desired[:, j])
            assert lines == {"segments": 5, "rule": "paper", "refine": refine}
        assert (own, options) == (model, {"limits": (lower, upper)})
        np.testing.assert_allclose(
            resting, np.clip(walk.desired[:, j], lower + model.offset, upper + model.offset)
        )
        outcome = made.joints[j]
        assert (outcome.name, outcome.limits) == (name, (lower, upper))
        np.testing.assert_array_equal(outcome.foot_requests, foot.requests[:, j])
        np.testing.assert_array_equal(outcome.foot_optimal, foot.predicted[:, j])
        np.testing.assert_array_equal(outcome.direct, simulate(model, walk.desired[:, j]))
        assert told[4 + 3 * j : 7 + 3 * j] == [
            f"the closed form for the {name}",
            f"the optimised requests for the {name}",
            f"the lower bound for the {name}",
        ]
    np.testing.assert_array_equal(made.requests["shift"], np.roll(walk.desired, -made.lead, axis=0))
    assert np.any(asked[8][1] != walk.desired[:, 2])
