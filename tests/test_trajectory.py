"""What passes for a trajectory, and what is said about what does not."""

from __future__ import annotations

import numpy as np
import pytest

from planner.exceptions import InvalidInput, InvalidTrajectory
from planner.trajectory import (
    as_rows,
    as_trajectory,
    check_radians,
    error_norm,
    index_of_largest,
    relative_gap,
    steps,
)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, np.nan, np.inf], r"desired: 2 of 3 samples are not finite.*index 1 \(nan\)"),
        (np.ma.array([1.0, 2.0], mask=[False, True]), "desired: got masked samples"),
        ([1.0, -2e9, 1e9], r"desired: got -2e\+09 at index 1, expected at most 1e\+09 either way"),
    ],
)
def test_anything_else_is_named_with_what_was_expected(values, message):
    with pytest.raises(InvalidTrajectory, match=message) as caught:
        as_trajectory(values, name="desired")
    assert isinstance(caught.value, InvalidInput)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    ("angles", "winds"),
    [
        (np.linspace(0.0, 30.0, 60), True),  # in steps of 0.08 turns
        (np.linspace(0.0, 30.0, 20), False),  # of 0.25 and a little
        (np.linspace(28.0, 32.0, 60), False),  # not from near 0
        (np.concatenate([np.linspace(0.0, 30.0, 60), np.linspace(30.0, 20.0, 20)]), True),
        (np.concatenate([np.linspace(0.0, 30.0, 60), np.linspace(30.0, 10.0, 40)]), False),
    ],
)
def test_angles_beyond_two_turns_are_those_of_a_joint_that_winds_or_in_degrees(angles, winds):
    for way in (1.0, -1.0):
        check_radians(way * 12.5 / np.max(angles) * angles, name="desired")
        if winds:
            check_radians(way * angles, name="desired")
            continue
        k, largest = int(np.argmax(angles)), way * np.max(angles)
        message = f"^desired: got {largest:g} rad, {abs(largest) / 6.2832:.1f} turns, expected at "
        with pytest.raises(InvalidTrajectory, match=f"{message}most 2 .*, at index {k}; if these"):
            check_radians(way * angles, name="desired")


def test_rows_name_the_column_that_is_wrong_and_one_row_alone_is_no_motion():
    assert as_rows([[0.0, 40.0]], name="requests").tolist() == [[0.0, 40.0]]
    assert as_rows([1, 2], name="requests").tolist() == [[1.0], [2.0]]
    for wrong, message in (
        ([[0.0, 40.0], [0.0, 0.0]], "requests, column 1: got 40 rad"),
        ([[0.0, 1.0], [0.0, np.nan]], "requests, column 1: 1 of 2 samples"),
        ([[0.0, 1.0], [0.0]], "requests: got rows of different lengths"),
        ([[[0.0]]], r"requests: got shape \(1, 1, 1\), expected \(n, k\)"),
        ([], r"requests: got shape \(0,\), expected \(n, k\)"),
    ):
        with pytest.raises(InvalidTrajectory, match=f"^{message}"):
            as_rows(wrong, name="requests")


def test_errors_and_bounds_are_compared_by_their_size():
    errors = np.array([1.0, -3.0, 1.0, 1.0])
    assert (error_norm(errors, "max"), error_norm(errors, "rms")) == (3.0, np.sqrt(3.0))
    gaps = [relative_gap(*each) for each in ((0.3, 0.2), (0.3, 0.0), (0.0, 0.0), (0.0, 0.2))]
    assert gaps == pytest.approx([0.5, np.inf, 0.0, -1.0])
    assert index_of_largest(np.array([-2.0, -1.0 - 1e-9, -1.0])) == 1
    assert steps(errors, cyclic=False).tolist() == [-4.0, 4.0, 0.0]
    assert steps(errors, cyclic=True).tolist() == [-4.0, 4.0, 0.0, 0.0]
