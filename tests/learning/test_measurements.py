"""Measured angles that cannot belong to the requests, of one of several joints."""

from __future__ import annotations

import math
from contextlib import nullcontext

import numpy as np
import pytest

from planner import InvalidTrajectory
from planner.learning.measurements import check_angles, check_trial
from planner.planning.trials import Trial

COUNT = 2.0 * math.pi / 4096.0
"""A count of a sensor of 12 bit [rad]."""

PHASE = 2.0 * np.pi * np.arange(60) / 60
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE)])
MODELLED = DESIRED + 0.01 * np.column_stack([np.cos(PHASE), np.sin(PHASE)])
REQUESTS = DESIRED + 0.05 * np.column_stack([np.cos(PHASE), -np.sin(PHASE)])
AWAY = 0.02 * np.sin(3.0 * PHASE)


def of_joint_2(angles):
    """Two cycles, in which joint 1 is measured as it is by its model, but for 0.02 rad."""
    return np.stack([np.column_stack([MODELLED[:, 0] + AWAY, angles])] * 2)


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        (DESIRED[:, 1] + AWAY, None),
        (0.1 + 1.4 * COUNT * (PHASE > 1.0), "joint 2 does not move: its angles have a range of"),
        (0.1 + 1.6 * COUNT * (PHASE > 1.0), None),
        (REQUESTS[:, 1] + 0.9e-4, "the angles of joint 2 are its requests"),
        (REQUESTS[:, 1] + 1.1e-4, None),
        (DESIRED[:, 1] + 0.9e-4, "the angles of joint 2 are the desired ones"),
        (DESIRED[:, 1] + 1.1e-4, None),
    ],
)
def test_the_joint_whose_angles_were_not_measured_is_named(angles, message):
    given = (of_joint_2(angles), REQUESTS, DESIRED, MODELLED, MODELLED)
    if message is None:
        check_angles(*given)
        return
    with pytest.raises(InvalidTrajectory, match=message):
        check_angles(*given)


@pytest.mark.parametrize(("counts", "refused"), [(14.0, False), (16.0, True)])
def test_a_joint_that_should_move_by_fifteen_counts_of_its_sensor_may_rest(counts, refused):
    share = [1.0, counts * COUNT / np.ptp(MODELLED[:, 1])]
    given = (of_joint_2(0.0 * PHASE), REQUESTS, DESIRED, share * MODELLED, MODELLED)
    with pytest.raises(InvalidTrajectory, match="joint 2 does") if refused else nullcontext():
        check_angles(*given)


def test_a_joint_that_is_expected_to_follow_exactly_may_be_equal_to_its_rounded_path():
    check_angles(of_joint_2(DESIRED[:, 1] + 1e-5), REQUESTS, DESIRED, MODELLED, DESIRED + 9e-4)


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (81.0, None),
        (79.0, "move 79 times as far as the model: are they degrees"),
        (41.0, "move 41 times as far"),
        (39.0, None),
        (1.0 / 39.0, None),
        (1.0 / 41.0, "move 1/41 as far as the model: are they radians"),
        (1.0 / 79.0, "1/79 as far"),
        (1.0 / 81.0, None),
    ],
)
@pytest.mark.parametrize("resting", [False, True])
def test_angles_of_another_unit_move_forty_to_eighty_times_as_far_or_as_little(
    resting, factor, message
):
    """All of them, though one of the joints may rest."""
    moving = [1.0, 0.0 if resting else 1.0]
    requests, desired, modelled = (each * moving for each in (REQUESTS, DESIRED, MODELLED))
    given = (factor * modelled[np.newaxis], requests, desired, modelled, modelled)
    if message is None:
        check_angles(*given)
        return
    with pytest.raises(InvalidTrajectory, match=message):
        check_angles(*given)


def test_another_motion_and_the_angles_of_an_earlier_trial_are_refused_by_number():
    trials = [Trial(requests=REQUESTS, measured=of_joint_2(k * AWAY), error=0.1) for k in range(3)]
    others, cycles = [0.5 * MODELLED] * 3, of_joint_2(MODELLED[:, 1])
    check_trial(cycles, MODELLED, trials, others)
    with pytest.raises(InvalidTrajectory, match=r"the angles of joint 2 are .* from those of the "):
        check_trial(of_joint_2(-1.1 * MODELLED[:, 1]), MODELLED, trials, others)
    again = np.concatenate([cycles, trials[1].measured[1:] + 0.9e-9])
    with pytest.raises(InvalidTrajectory, match="same angles as in trial 2, whose requests were o"):
        check_trial(again, MODELLED, trials, others)
    check_trial(again, MODELLED, trials, [MODELLED] * 3)
