"""The baselines: the desired angles as requests, as they are and early."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.evaluation.reproduction import best_lead
from planner.model.joint import JointModel
from planner.model.response import simulate_joints
from planner.trajectory import angle_distance
from tests.independent import equation_3

JOINT = JointModel.ers210a()
PHASE = 2.0 * np.pi * np.arange(88) / 88
DESIRED = np.column_stack([0.5 * np.sin(PHASE), 0.3 * np.cos(2.0 * PHASE)])


def _distance(angles):
    return angle_distance(angles.ravel(), DESIRED.ravel())


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
    unshifted = simulate_joints([JOINT, JOINT], DESIRED, cyclic=True)
    assert best_lead(unshifted, _distance) == best
    least = _distance(np.roll(unshifted, -best, axis=0)).rms
    assert least == pytest.approx(distances[best].rms, abs=1e-10)
