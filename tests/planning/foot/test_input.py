"""What invert_foot refuses, and how it says so."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.exceptions import UnsupportedLeg
from planner.exceptions import InvalidInput
from planner.model.joint import JointModel
from planner.planning.inversion import invert_foot
from tests.kinematics.made_up_robots import Joint, X, Y, made_up_leg, reference_leg

ERS210A = JointModel.ers210a()
LEG = reference_leg()
PATH = LEG.foot_positions(np.linspace([0.2, 0.1, 0.5], [0.4, 0.3, 0.9], 6))


def test_a_leg_of_four_joints_has_no_inverse(tmp_path):
    joints = [Joint((0, 0, -0.1), axis) for axis in (Y, X, Y, X)]
    leg = made_up_leg(tmp_path, joints, (0, 0, -0.1))
    with pytest.raises(UnsupportedLeg, match="3 joints at most, this one has 4"):
        invert_foot(ERS210A, leg, PATH)


def test_weights_only_where_the_leg_cannot_move_its_foot_are_refused(tmp_path):
    joints = [Joint((0, 0, 0), Y), Joint((0, 0, -0.1), Y), Joint((0, 0, -0.1), Y)]
    leg = made_up_leg(tmp_path, joints, (0.0, 0.0, -0.1))
    path = leg.foot_positions(np.linspace([0.2, 0.1, 0.5], [0.4, 0.3, 0.9], 6))
    with pytest.raises(InvalidInput, match=r"^leg: .*weight"):
        invert_foot(ERS210A, leg, path, weights=(0.0, 1.0, 0.0))
