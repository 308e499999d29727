"""A stack of curves: what it holds, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.curve import CurveStack, PiecewiseLinear
from planner.exceptions import InvalidInput

OVER = {"samples": 10, "tick": 0.5}


@pytest.mark.parametrize("cyclic", [True, False])
def test_its_slopes_and_lengths_are_those_of_every_curve(cyclic):
    rows = [[0.0, 2.5, 7.0], [1.0, 3.0, 8.5]], [[0.0, 1.0, -2.0], [3.0, 3.0, 4.0]]
    stack = CurveStack(knots=rows[0], values=rows[1], cyclic=cyclic, **OVER)
    for k, v, lengths, slopes in zip(*rows, stack.lengths, stack.slopes, strict=True):
        curve = PiecewiseLinear(knots=k, values=v, cyclic=cyclic, **OVER)
        np.testing.assert_array_equal(lengths, curve.lengths)
        np.testing.assert_array_equal(slopes, curve.slopes)


def test_knots_may_be_shared():
    stack = CurveStack(knots=[0.0, 4.0], values=np.zeros((3, 2)), cyclic=True, **OVER)
    np.testing.assert_array_equal(stack.knots, [[0.0, 4.0]] * 3)


def test_only_curves_that_agree_are_stacked():
    same = {"knots": [0.0, 4.0], "values": [0.0, 1.0], "cyclic": True, **OVER}
    one = PiecewiseLinear(**same)
    assert CurveStack.of([one, one]).values.shape == (2, 2)
    single = {"knots": [0.0], "values": [0.0]}
    for change in (single, {"samples": 11}, {"tick": 0.25}, {"cyclic": False}):
        with pytest.raises(InvalidInput, match="curve 2 has another number"):
            CurveStack.of([one, one, PiecewiseLinear(**{**same, **change})])
    with pytest.raises(InvalidInput, match="got none"):
        CurveStack.of([])
