"""What invert_foot refuses, and how it says so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from kinematics.exceptions import UnsupportedLeg
from planner.exceptions import InvalidInput, SolverFailed
from planner.model.joint import JointModel
from planner.planning import solve
from planner.planning.inversion import invert_foot
from tests.kinematics.made_up_robots import Joint, X, Y, made_up_leg, reference_leg

ERS210A = JointModel.ers210a()
LEG = reference_leg()
PATH = LEG.foot_positions(np.linspace([0.2, 0.1, 0.5], [0.4, 0.3, 0.9], 6))


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ([ERS210A] * 2, r"^models: got 2 .*\(rotator, abductor, knee\)"),
        (
            [ERS210A, ERS210A, replace(ERS210A, hold=2)],
            r"^models: their periods are 0.008, 0.016 s, expected one",
        ),
    ],
)
def test_models_that_do_not_fit_the_leg_or_each_other_are_refused(models, message):
    with pytest.raises(InvalidInput, match=message):
        invert_foot(models, LEG, PATH)


def test_a_leg_of_four_joints_has_no_inverse(tmp_path):
    joints = [Joint((0, 0, -0.1), axis) for axis in (Y, X, Y, X)]
    leg = made_up_leg(tmp_path, joints, (0, 0, -0.1))
    with pytest.raises(UnsupportedLeg, match="3 joints at most, this one has 4"):
        invert_foot(ERS210A, leg, PATH)


def test_a_leg_that_cannot_move_its_foot_at_all_is_refused(tmp_path):
    axes = (Y, X, Y)
    leg = made_up_leg(tmp_path, [Joint((0, 0, 0), axis) for axis in axes], (0, 0, 0))
    with pytest.raises(UnsupportedLeg, match=r"^leg: "):
        invert_foot(ERS210A, leg, np.zeros((5, 3)))


def test_weights_only_where_the_leg_cannot_move_its_foot_are_refused(tmp_path):
    joints = [Joint((0, 0, 0), Y), Joint((0, 0, -0.1), Y), Joint((0, 0, -0.1), Y)]
    leg = made_up_leg(tmp_path, joints, (0.0, 0.0, -0.1))
    path = leg.foot_positions(np.linspace([0.2, 0.1, 0.5], [0.4, 0.3, 0.9], 6))
    with pytest.raises(InvalidInput, match=r"^leg: .*weight"):
        invert_foot(ERS210A, leg, path, weights=(0.0, 1.0, 0.0))


def test_joints_under_whose_requests_no_cycle_closes_are_a_failure_of_the_search(monkeypatch):
    minimise = solve.minimise

    def fail_for_the_foot(problem, state, stages):
        if problem.foot is None:
            return minimise(problem, state, stages)
        return state.requests, math.inf

    monkeypatch.setattr(solve, "minimise", fail_for_the_foot)
    with pytest.raises(SolverFailed, match=r"foot.*no requests lead to a steady cycle"):
        invert_foot(ERS210A, LEG, PATH)
