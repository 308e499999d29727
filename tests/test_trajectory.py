"""What passes for a trajectory, and what is said about what does not."""

from __future__ import annotations

import numpy as np
import pytest

from planner.exceptions import InvalidInput, InvalidTrajectory
from planner.trajectory import as_trajectory


@pytest.mark.parametrize(
    "values", [[1, 2], (1.0, 2.0), np.array([1, 2], dtype=np.int8), np.float32([1, 2])]
)
def test_real_numbers_of_any_kind_become_read_only_float64(values):
    trajectory = as_trajectory(values, name="desired")
    assert trajectory.dtype == np.float64
    assert trajectory.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        trajectory[0] = 0.0


def test_a_trajectory_is_a_copy_that_later_changes_do_not_reach():
    given = np.array([1.0, 2.0, 3.0])
    trajectory = as_trajectory(given, name="desired")
    given[:] = 9.0
    assert trajectory.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, np.nan, np.inf], r"desired: 2 of 3 samples are not finite.*index 1 \(nan\)"),
        ([[1.0, 2.0]], r"desired: got shape \(1, 2\).*one at a time"),
        (3.0, r"desired: got shape \(\)"),
        ([1.0], "desired: got 1 samples, expected at least 2"),
        ([], "desired: got 0 samples"),
        (["1", "2"], "desired: got an array of <U1, expected real numbers"),
        ([True, False], "desired: got an array of bool"),
        ([1j, 2.0], "desired: got an array of complex128"),
        (None, "desired: got an array of object"),
        ([None, 1.0], "desired: got an array of object"),
    ],
)
def test_anything_else_is_named_with_what_was_expected(values, message):
    with pytest.raises(InvalidTrajectory, match=message) as caught:
        as_trajectory(values, name="desired")
    assert isinstance(caught.value, InvalidInput)
    assert isinstance(caught.value, ValueError)


def test_ragged_lists_are_an_invalid_trajectory_too():
    with pytest.raises(InvalidTrajectory, match="desired"):
        as_trajectory([[1.0, 2.0], [3.0]], name="desired")


def test_the_minimum_is_inclusive():
    assert len(as_trajectory([0.0] * 4, name="desired", minimum=4)) == 4
    with pytest.raises(InvalidTrajectory, match="got 3 samples, expected at least 4"):
        as_trajectory([0.0] * 3, name="desired", minimum=4)
