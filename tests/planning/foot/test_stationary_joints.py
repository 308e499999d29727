"""Joints to which a path gives nothing to do rest, unless moving them helps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.gait.half_ellipse import reference_walk
from planner.model.joint import JointModel
from planner.planning import search
from planner.planning.inversion import invert_foot

ERS210A = JointModel.ers210a()
LEG = reference_walk().leg

UNSEEN = 1e-4
"""Error that no encoder shows [m]: a step of one of 12 bits in one joint of this leg."""


def stepping(swing_deg: float, *, samples: int = 60):
    """A foot path in a plane, along which the abductor has nothing to do: (n, 3) [m]."""
    phase = 2.0 * np.pi * np.arange(samples) / samples
    swing = math.radians(swing_deg)
    angles = np.column_stack(
        [
            swing * (np.sin(phase) + 0.2 * np.sin(3.0 * phase)),
            np.full(samples, math.radians(20.0)),
            math.radians(60.0) + swing * np.cos(phase),
        ]
    )
    return LEG.foot_positions(angles)


@pytest.mark.parametrize("norm", ["rms", "max"])
def test_a_joint_that_could_only_make_up_for_next_to_nothing_rests(norm, monkeypatch):
    path = stepping(10.0)
    plan = invert_foot(ERS210A, LEG, path, norm=norm)
    assert np.ptp(plan.requests[:, 1]) == 0.0
    monkeypatch.setattr(search, "STATIONARY", -1.0)
    moving = invert_foot(ERS210A, LEG, path, norm=norm, smoothness=0.0)
    assert np.ptp(moving.requests[:, 1]) > math.radians(0.01)
    assert plan.error <= 1.005 * moving.error + UNSEEN


def test_a_joint_that_makes_up_for_what_others_miss_moves():
    path = stepping(40.0)
    plan = invert_foot(ERS210A, LEG, path)
    assert np.ptp(plan.requests[:, 1]) > math.radians(1.0)
    resting = invert_foot(ERS210A, LEG, path, smoothness=10.0)
    assert np.ptp(resting.requests[:, 1]) == 0.0
    assert plan.rms < 0.99 * resting.rms


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
def test_where_no_joint_has_anything_to_do_all_rest(cyclic):
    path = np.repeat(stepping(0.0)[:1], 12, axis=0)
    plan = invert_foot(ERS210A, LEG, path, cyclic=cyclic)
    np.testing.assert_allclose(plan.requests, plan.requests[:1].repeat(12, axis=0), atol=1e-9)
    assert plan.max_error <= 1e-9
