"""The paper's method: its figures on the reference walk, and its switching rule written out."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.approximation.curve import CurveStack
from planner.planning import pattern_search
from planner.planning.closed_form import (
    approximations,
    invert_closed_form,
    requests_of,
)
from planner.planning.line_inverse import RULES, line_offset
from planner.planning.problem import problem_of
from planner.planning.task import Task
from tests.independent import from_rest
from tests.instances import ERS210A, REFERENCE_JOINTS, random_model, saturating

NEAR_THE_BOUND = 1.01  # rms error over the bound on that of any requests
AT_A_SWITCH = 1e-6  # a request this close to a switch may belong to either line [samples]
SAME = 1e-10  # rounding of requests of a few radians at slopes of a few rad/s [rad]


def switched(model, fit, *, rule):
    """Requests by Sections 4.2 and 4.3, line by line; NaN where a switch is too close to call."""
    n = fit.samples
    early = (model.lag + model.acceleration_time / 2) / model.tick  # l + a/2 [ticks]
    early += (model.hold - 1) / 2  # a held request is that much older on average
    early /= model.hold  # [samples]
    requests = np.full(n, np.nan)
    lines = len(fit.slopes)
    for line in range(lines):
        start = fit.knots[line]
        cyclic_end = fit.knots[0] + n if line == lines - 1 else None
        end = fit.knots[line + 1] if line + 1 < len(fit.knots) else cyclic_end
        first, last = start - early, end - early
        if not fit.cyclic:
            first = -math.inf if line == 0 else first
            last = math.inf if line == lines - 1 else last
        for k in range(n):
            for cycle in range(-200, 3) if fit.cyclic else (0,):
                time = k + cycle * n
                if first + AT_A_SWITCH < time < last - AT_A_SWITCH:
                    along = (time - start) * model.tick * model.hold * fit.slopes[line]
                    raised = line_offset(model, fit.slopes[line], rule=rule)
                    requests[k] = fit.values[line] + along + raised
    return requests


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_six_lines_track_the_reference_walk_as_known_and_chosen_ones_come_near_the_bound(joint):
    six, chosen = (invert_closed_form(ERS210A, joint.desired, segments=n) for n in (6, None))
    assert math.degrees(six.rms) <= joint.closed_form_rms_deg
    assert six.approximation.segments == 6
    assert math.degrees(chosen.rms) <= NEAR_THE_BOUND * joint.exact_bound_deg


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_requests_change_from_line_to_line_l_plus_half_a_before_each_knot(seed, cyclic, rule):
    rng = np.random.default_rng(seed)
    inside = {"acceleration_time": 0.04, "theta_0": 0.2}  # keeps Equation 13
    model = replace(random_model(rng, whole=False, hold=1 + seed % 3, offset=True), **inside)
    plan = invert_closed_form(
        model, saturating(rng, model), cyclic=cyclic, segments=6 if seed else None, rule=rule
    )
    expected = switched(model, plan.approximation, rule=rule)
    clear = ~np.isnan(expected)
    assert np.count_nonzero(clear) >= 70
    if not cyclic:
        clear[0] = False  # the first request holds the joint
    np.testing.assert_allclose(plan.requests[clear], expected[clear], rtol=0.0, atol=SAME)


@pytest.mark.parametrize("hold", [1, 4])
def test_from_rest_the_first_request_holds_the_joint_at_the_first_desired_angle(hold):
    rng = np.random.default_rng(hold)
    model = random_model(rng, hold=hold, offset=True)
    desired = saturating(rng, model)
    plan = invert_closed_form(model, desired, cyclic=False, rule="exact")
    assert plan.plan.task.starts[0] == desired[0]
    assert plan.requests[0] == desired[0] - model.offset
    expected = from_rest(model, plan.requests, start=desired[0])
    np.testing.assert_allclose(plan.predicted, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_refining_the_lines_keeps_what_lines_must_keep_and_never_tracks_worse(seed, cyclic):
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=False, hold=1 + seed % 2, offset=True)
    desired = saturating(rng, model, samples=60)
    options = {"cyclic": cyclic, "segments": 6, "rule": "exact"}
    plain = invert_closed_form(model, desired, refine=False, **options)
    refined = invert_closed_form(model, desired, **options)
    assert refined.rms <= plain.rms
    assert refined.approximation.segments == plain.approximation.segments
    assert np.max(np.abs(refined.approximation.slopes)) <= model.v_max * (1.0 + 1e-9)
    assert np.min(refined.approximation.lengths) >= 1.0 - 1e-9


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize(
    ("terms", "load"),
    [
        ({}, None),
        ({"dead_band": 0.03, "tick": 0.002, "hold": 4}, None),
        ({"time_constant": 0.02, "sag_sin": -0.3, "sag_cos": 0.1}, None),
        ({"compliance": 0.05, "speed_per_torque": 0.4, "dead_band": 0.02, "offset": 0.1}, 0.6),
    ],
)
def test_the_search_for_knots_counts_the_error_of_the_simulated_requests(terms, load, cyclic):
    model = replace(ERS210A, **terms)
    shares = np.arange(88) / 88
    desired = 0.4 * np.sin(2.0 * np.pi * shares) + 0.15 * np.cos(6.0 * np.pi * shares)
    torques = None if load is None else load * np.cos(2.0 * np.pi * shares)
    task = Task.of([model], desired, names=("",), cyclic=cyclic, load=torques)
    problem = problem_of(task).unlimited
    for curve in approximations(problem, segments=6, refine=True):
        tracking = pattern_search.tracked(problem, curve, "exact")
        knots, values = np.array(curve.knots), np.array(curve.values)
        found = pattern_search.search(*tracking, knots, values, (0.0, 1.0, 0.0), 0)
        stack = CurveStack.of([curve])
        requests = requests_of(model, stack, rule="exact", load=problem.load_of_drives[0]).T
        error = problem.exact_error(problem.admissible(requests))
        # Offsets from a table are good to some 1e-5 of theta_0.
        assert math.sqrt(found / len(desired)) == pytest.approx(error, abs=1e-4 * model.theta_0)
        refined = pattern_search.refined_curve(problem, curve, rule="exact")
        better = requests_of(
            model, CurveStack.of([refined]), rule="exact", load=problem.load_of_drives[0]
        ).T
        assert problem.exact_error(problem.admissible(better)) < error


def test_lines_are_as_steep_each_way_as_the_joint_is_fast():
    model = replace(ERS210A, v_offset=1.5)
    rise = 0.9 * (model.v_max + 1.5) * model.period  # faster than it falls
    desired = np.interp(np.arange(40), [0, 10, 40], [0.0, 10.0 * rise, 0.0])
    lines = invert_closed_form(model, desired, segments=2, refine=False).approximation
    assert rise / model.period > model.v_max - 1.5
    np.testing.assert_allclose(lines.angles, desired, rtol=0.0, atol=1e-9)
