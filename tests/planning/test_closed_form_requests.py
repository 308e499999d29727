"""Requests for many known curves at once: the joint follows each; misfits are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approximation.curve import CurveStack, PiecewiseLinear, lines_in_force
from planner.planning.closed_form import closed_form_requests
from planner.planning.line_inverse import RULES
from tests.independent import from_rest, next_cycle
from tests.instances import random_model

SETTLED = 1e-6
"""Distance from a line of at least a hundred ticks, of which each leaves 5/6 of it [rad]."""


def curves_of(stack):
    return [
        PiecewiseLinear(
            knots=k, values=v, samples=stack.samples, tick=stack.tick, cyclic=stack.cyclic
        )
        for k, v in zip(stack.knots, stack.values, strict=True)
    ]


def long_lines(rng, model, *, curves, cyclic):
    """Curves of four lines, each so long that the joint comes to follow it, with their samples."""
    samples = 600 // model.hold
    knots = np.linspace(0, samples - (not cyclic), 4 + 1)[: 4 + (not cyclic)]
    knots = knots + rng.uniform(0.0, 0.1 * samples, size=(curves, 4 + (not cyclic)))
    if not cyclic:
        knots[:, 0], knots[:, -1] = 0.0, samples - 1
    stack = CurveStack(
        knots=knots,
        values=rng.uniform(-1.0, 1.0, size=knots.shape),
        samples=samples,
        tick=model.period,
        cyclic=cyclic,
    )
    steepest = np.max(np.abs(stack.slopes), axis=1, keepdims=True)
    return replace(stack, values=stack.values * (0.4 * model.v_max / steepest))


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_each_of_many_curves_is_where_equation_3_brings_the_joint(seed, cyclic, rule):
    """At the end of a line the joint is on it; by the paper's rule, half a tick ahead of it.

    That half tick is the difference between the sum and its integral, as long as a request is sent
    at every tick and none of the window saturates F: here, up to two fifths of the top speed.
    """
    rng = np.random.default_rng(seed)
    hold = 1 if rule == "paper" else 1 + seed
    model = random_model(rng, whole=False, hold=hold, offset=True)
    model = replace(model, acceleration_time=0.04, theta_0=6.0 * model.v_max * model.tick)
    stack = long_lines(rng, model, curves=5, cyclic=cyclic)
    together = closed_form_requests(model, stack, rule=rule)
    assert together.shape == (5, stack.samples)
    for curve, requests in zip(curves_of(stack), together, strict=True):
        if cyclic:
            before = next_cycle(model, requests, requests[-1])
            angles = next_cycle(model, requests, before[-1])
        else:
            angles = from_rest(model, requests)
        turning = curve.knots[0 if cyclic else 1 :] - model.acceleration_time / 2 / model.period
        ends = np.floor(turning).astype(int) - 1
        ahead = model.tick / 2 if rule == "paper" else 0.0
        there = curve(ends) + ahead * curve.slope_at(ends)
        np.testing.assert_allclose(angles[ends], there, rtol=0.0, atol=SETTLED)


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
