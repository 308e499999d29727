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


@given(PAIRS, st.integers(0, 39))
def test_a_distance_does_not_depend_on_where_a_cycle_begins(pair, shift):
    one, other = pair
    shifted = angle_distance(np.roll(one, shift), np.roll(other, shift))
    assert shifted == pytest.approx(angle_distance(one, other), rel=ROUNDING, abs=1e-150)
