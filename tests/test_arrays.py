"""What passes for a trajectory, and what is said about what does not."""

import numpy as np
import pytest

from planner.arrays import check_radians, error_norm, index_of_largest, relative_gap, steps
from planner.exceptions import InvalidTrajectory


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


def test_errors_and_bounds_are_compared_by_their_size():
    errors = np.array([1.0, -3.0, 1.0, 1.0])
    assert (error_norm(errors, "max"), error_norm(errors, "rms")) == (3.0, np.sqrt(3.0))
    pairs = (0.3, 0.2), (0.3, 0.002), (0.3, 0.0), (0.0, 0.0), (0.0, 0.2)
    gaps = [relative_gap(*each) for each in pairs]
    assert gaps == pytest.approx([0.5, np.inf, np.inf, 0.0, -1.0])
    assert index_of_largest(np.array([-2.0, -1.0 - 1e-9, -1.0])) == 1
    assert steps(errors, cyclic=False).tolist() == [-4.0, 4.0, 0.0]
    assert steps(errors, cyclic=True).tolist() == [-4.0, 4.0, 0.0, 0.0]
