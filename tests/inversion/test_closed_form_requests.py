"""Requests for many known curves at once: the same as one by one, and refused the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.approximation.curve import PiecewiseLinear, lines_in_force
from planner.approximation.curve_batch import CurveStack
from planner.exceptions import InvalidInput
from planner.inversion.closed_form import closed_form_requests, switching_time
from planner.inversion.line_inverse import RULES, line_offset
from planner.model.joint import JointModel
from tests.instances import REFERENCE_JOINTS, random_model

ERS210A = JointModel.ers210a()

SAME = 1e-12
"""Rounding of requests of a few radians [rad]."""


def random_stack(rng, model, *, curves, lines, cyclic, samples=88):
    """Curves within the slopes, with knots between samples and lines shorter than a sample."""
    size = lines if cyclic else lines + 1
    knots = np.sort(rng.uniform(0.0, samples, size=(curves, size)), axis=1)
    knots += 1e-6 * np.arange(size)
    rise = rng.uniform(-1.0, 1.0, size=(curves, size))
    values = model.v_max * model.period * rise
    stack = CurveStack(
        knots=knots, values=values, samples=samples, tick=model.period, cyclic=cyclic
    )
    steepest = np.max(np.abs(stack.slopes), axis=1, keepdims=True)
    return replace(stack, values=values * (model.v_max / steepest))


def curves_of(stack):
    return [
        PiecewiseLinear(
            knots=k, values=v, samples=stack.samples, tick=stack.tick, cyclic=stack.cyclic
        )
        for k, v in zip(stack.knots, stack.values, strict=True)
    ]


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_many_curves_at_once_have_the_requests_of_each_alone(seed, cyclic, rule):
    rng = np.random.default_rng(seed)
    inside = {"acceleration_time": 0.04, "theta_0": 0.2}  # keeps Equation 13
    model = replace(random_model(rng, whole=False, hold=1 + seed, offset=True), **inside)
    stack = random_stack(rng, model, curves=40, lines=2 + 3 * seed, cyclic=cyclic)
    together = closed_form_requests(model, stack, rule=rule)
    assert together.shape == (40, 88)
    for curve, requests in zip(curves_of(stack), together, strict=True):
        alone = closed_form_requests(model, curve, rule=rule)
        np.testing.assert_allclose(requests, alone, rtol=0.0, atol=SAME)
    np.testing.assert_array_equal(
        closed_form_requests(model, curves_of(stack), rule=rule), together
    )


@pytest.mark.parametrize("cyclic", [True, False])
def test_every_request_lies_on_the_line_in_force_raised_by_its_offset(cyclic):
    rng = np.random.default_rng(5)
    stack = random_stack(rng, ERS210A, curves=30, lines=5, cyclic=cyclic)
    requests = closed_form_requests(ERS210A, stack)
    ahead = switching_time(ERS210A) / ERS210A.period
    for curve, row in zip(curves_of(stack), requests, strict=True):
        later = np.arange(88) + ahead
        slopes = np.clip(curve.slope_at(later), -ERS210A.v_max, ERS210A.v_max)
        lines = curve(later) - slopes * ahead * curve.tick
        raised = lines + line_offset(ERS210A, slopes, rule="paper")
        np.testing.assert_allclose(row, raised, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_a_known_fit_gives_the_requests_of_the_whole_inversion(joint):
    plan = planner.invert_closed_form(ERS210A, joint.desired)
    requests = closed_form_requests(ERS210A, plan.approximation)
    np.testing.assert_allclose(requests, plan.requests, rtol=0.0, atol=SAME)


@pytest.mark.parametrize(
    ("first", "cyclic", "expected"),
    [
        ([0, 2, 4], True, [0, 0, 1, 1, 2, 2]),
        ([-3, 1, 2], True, [0, 1, 2, 0, 0, 0]),
        ([-3, 1, 3], True, [0, 1, 1, 0, 0, 0]),
        ([1, 1, 4], True, [2, 1, 1, 1, 2, 2]),
        ([0], True, [0, 0, 0, 0, 0, 0]),
        ([-2, -1, 9], False, [1, 1, 1, 1, 1, 1]),
        ([3, 4], False, [0, 0, 0, 0, 1, 1]),
    ],
)
def test_the_line_in_force_is_the_last_that_has_begun(first, cyclic, expected):
    np.testing.assert_array_equal(lines_in_force(np.array([first]), 6, cyclic=cyclic), [expected])


def test_one_curve_has_one_row_and_the_answer_is_read_only():
    curve = PiecewiseLinear(knots=[0, 40], values=[0.0, 0.1], samples=88, tick=0.008, cyclic=True)
    requests = planner.closed_form_requests(ERS210A, curve)
    assert requests.shape == (88,)
    assert not requests.flags.writeable


def test_what_does_not_fit_the_joint_is_refused():
    steep = PiecewiseLinear(knots=[0, 4], values=[0.0, 1.0], samples=88, tick=0.008, cyclic=True)
    with pytest.raises(InvalidInput, match=r"in curve 0, expected slopes within ±v_max"):
        closed_form_requests(ERS210A, steep)
    with pytest.raises(InvalidInput, match=r"every 0\.01 s, expected every 0\.008 s"):
        closed_form_requests(ERS210A, replace(steep, tick=0.01))
    with pytest.raises(InvalidInput, match="rule: got 'best'"):
        closed_form_requests(ERS210A, steep.scaled(0.0), rule="best")
