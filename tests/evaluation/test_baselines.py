"""The baselines: the desired angles as requests, as they are and early."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.evaluation.baselines import best_time_shift, direct
from planner.evaluation.metrics import angle_distance
from planner.exceptions import InvalidTrajectory
from planner.model.joint import JointModel
from planner.model.response import simulate
from tests.independent import equation_3

JOINT = JointModel.ers210a()
PHASE = 2.0 * np.pi * np.arange(88) / 88
DESIRED = np.column_stack([0.5 * np.sin(PHASE), 0.3 * np.cos(2.0 * PHASE)])


def _distance(angles):
    return angle_distance(angles.ravel(), DESIRED.ravel())


def test_the_direct_method_requests_the_desired_angles():
    angles = direct([JOINT, JOINT], DESIRED)
    for j in range(2):
        assert np.array_equal(angles[:, j], simulate(JOINT, DESIRED[:, j]))


def test_the_best_time_shift_is_the_best_of_all_simulated_one_by_one():
    shift = best_time_shift(DESIRED, direct([JOINT, JOINT], DESIRED), _distance)
    distances = []
    for lead in range(88):
        requests = np.roll(DESIRED, -lead, axis=0)
        angles = np.column_stack([simulate(JOINT, requests[:, j]) for j in range(2)])
        distances.append(_distance(angles).rms)
    assert shift.samples == int(np.argmin(distances))
    assert shift.distance.rms == pytest.approx(min(distances), abs=1e-10)  # closed to 1e-12
    assert np.array_equal(shift.requests, np.roll(DESIRED, -shift.samples, axis=0))


def test_the_best_lead_is_that_of_equation_3_with_the_figures_of_table_1():
    angles = []
    for wanted in DESIRED.T:
        done = equation_3(
            lambda t, wanted=wanted: wanted[t % 88],
            20 * 88,  # of which the last cycle repeats the one before it to 1e-12
            wanted[0],
            v_max=math.radians(2.5),
            theta_0=math.radians(7.0),
            lag=4,
            acceleration=6,
        )
        angles.append(done[-88:])
    distances = [_distance(np.roll(np.column_stack(angles), -lead, axis=0)) for lead in range(88)]
    best = min(range(88), key=lambda lead: distances[lead].rms)
    shift = best_time_shift(DESIRED, direct([JOINT, JOINT], DESIRED), _distance)
    assert shift.samples == best
    assert shift.distance.rms == pytest.approx(distances[best].rms, abs=1e-10)


def test_two_ticks_more_of_lag_make_the_best_lead_two_samples_longer():
    shift = best_time_shift(DESIRED, direct([JOINT, JOINT], DESIRED), _distance)
    later = replace(JOINT, lag=JOINT.lag + 2 * JOINT.tick)
    more = best_time_shift(DESIRED, direct([later, later], DESIRED), _distance)
    assert more.samples == shift.samples + 2
    assert more.distance.rms == pytest.approx(shift.distance.rms, abs=1e-10)


def test_what_comes_back_is_read_only():
    shift = best_time_shift(DESIRED, direct([JOINT, JOINT], DESIRED), _distance)
    for array in (shift.requests, shift.angles, direct([JOINT, JOINT], DESIRED)):
        assert not array.flags.writeable


def test_there_is_one_model_per_column():
    with pytest.raises(InvalidTrajectory, match=r"expected \(n, 1\), one column per model"):
        direct([JOINT], DESIRED)
