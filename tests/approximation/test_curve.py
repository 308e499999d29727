"""Curves and stacks of them as values: evaluation, slopes, the cycle boundary, what is refused."""

import dataclasses
import json

import numpy as np
import pytest

from planner import CurveStack, PiecewiseLinear

OVER = {"values": [1.0, -1.0, 0.5], "samples": 10, "tick": 0.5}
CYCLE = PiecewiseLinear(knots=[2.0, 5.5, 8.0], **OVER, cyclic=True)
PATH = PiecewiseLinear(knots=[0.0, 4.0, 9.0], **OVER, cyclic=False)

INDEX = np.linspace(-7.0, 17.0, 49) + 0.013
"""Places between samples, before, in and after the samples."""

OVER = {"samples": 10, "tick": 0.5}


def test_a_curve_takes_its_values_at_its_knots_and_repeats_or_goes_on_straight_beyond():
    assert all(np.array_equal(curve(curve.knots), curve.values) for curve in (CYCLE, PATH))
    index = np.linspace(-3.0, 13.0, 33)
    np.testing.assert_allclose(CYCLE(index + 10.0), CYCLE(index), atol=1e-14)
    np.testing.assert_allclose(CYCLE(index - 30.0), CYCLE(index), atol=1e-14)
    np.testing.assert_allclose(PATH([-2.0, 11.0]), [2.0, 1.1], atol=1e-14)


def test_slopes_are_rises_per_second_and_at_a_knot_those_of_the_segment_after():
    index = np.linspace(-4.0, 14.0, 181) + 0.05  # never on a knot
    for curve in (CYCLE, PATH):
        rises = (curve(index + 1e-4) - curve(index - 1e-4)) / (2e-4 * curve.tick)
        np.testing.assert_allclose(curve.slope_at(index), rises, atol=1e-9)
    assert np.array_equal(CYCLE.slope_at(CYCLE.knots), CYCLE.slopes)
    assert np.array_equal(PATH.slope_at(PATH.knots), PATH.slopes[[0, 1, 1]])


@pytest.mark.parametrize("curve", [CYCLE, PATH])
def test_plain_data_gives_the_curve_back_to_the_last_digit(curve):
    curve = dataclasses.replace(curve, knots=curve.knots + 1 / 3, values=curve.values / 3)
    again = PiecewiseLinear(**json.loads(json.dumps(curve.to_dict())))
    assert np.array_equal(again.knots, curve.knots)
    assert np.array_equal(again.values, curve.values)
    assert np.array_equal(again(INDEX), curve(INDEX))


@pytest.mark.parametrize("cyclic", [True, False])
def test_its_slopes_and_lengths_are_those_of_every_curve(cyclic):
    rows = [[0.0, 2.5, 7.0], [1.0, 3.0, 8.5]], [[0.0, 1.0, -2.0], [3.0, 3.0, 4.0]]
    stack = CurveStack(knots=rows[0], values=rows[1], cyclic=cyclic, **OVER)
    for k, v, lengths, slopes in zip(*rows, stack.lengths, stack.slopes, strict=True):
        curve = PiecewiseLinear(knots=k, values=v, cyclic=cyclic, **OVER)
        np.testing.assert_array_equal(lengths, curve.lengths)
        np.testing.assert_array_equal(slopes, curve.slopes)
