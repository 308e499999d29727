"""Distances: the paper's L2 is a root mean square, its Linf a largest value."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner.trajectory import Distance, angle_distance, foot_distance

ROUNDING = 1e-12
"""What rounding leaves of sums of a few dozen terms [relative]."""

PAIRS = st.integers(2, 40).flatmap(
    lambda n: st.tuples(
        *[arrays(np.float64, n, elements=st.floats(-10.0, 10.0, allow_subnormal=False))] * 2
    )
)


def test_known_distances():
    assert angle_distance(np.array([3.0, 4.0]), np.zeros(2)) == Distance(np.sqrt(12.5), 4.0)
    assert foot_distance(
        np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros((2, 3))
    ) == Distance(np.sqrt(13.0), 5.0)


@given(PAIRS)
def test_a_distance_is_symmetric_and_its_rms_never_above_its_largest(pair):
    one, other = pair
    distance = angle_distance(one, other)
    assert distance == angle_distance(other, one)
    assert distance.rms <= distance.max * (1.0 + ROUNDING)
    assert distance.max <= distance.rms * np.sqrt(len(one)) * (1.0 + ROUNDING) + 1e-150


@given(PAIRS, st.integers(0, 39))
def test_a_distance_does_not_depend_on_where_a_cycle_begins(pair, shift):
    one, other = pair
    shifted = angle_distance(np.roll(one, shift), np.roll(other, shift))
    assert shifted == pytest.approx(angle_distance(one, other), rel=ROUNDING, abs=1e-150)


def test_units_divide_both_figures():
    assert Distance(0.03, 0.05).in_units_of(0.01) == pytest.approx((3.0, 5.0))
