"""IPOPT on the transcribed problem: its plans are as good, and failures are told."""

from dataclasses import replace

import numpy as np
import pytest

import planner
from planner import SolverFailed
from planner.planning import direct_transcription
from tests.instances import ERS210A, REFERENCE_JOINTS

CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])

ALIKE = 0.01
"""Difference of two optimisers' rms, relative; a random instance in a hundred differs by more."""


def both(model, desired, **options):
    """The plans of IPOPT and of our own search."""
    return (
        planner.invert_optimal(model, desired, solver=solver, **options)
        for solver in ("ipopt", "gauss-newton")
    )


@CYCLIC
def test_the_largest_step_is_kept_and_our_own_plan_is_no_worse(cyclic):
    joint, step = REFERENCE_JOINTS[0], np.radians(3.0)
    options = {"limits": joint.limits, "max_step": step, "cyclic": cyclic, "smoothness": 0.0}
    plans = theirs, ours = [*both(ERS210A, joint.desired, **options)]
    assert all(each.largest_step <= step * (1.0 + 1e-12) for each in plans)
    assert ours.rms <= 1.005 * theirs.rms


def test_with_inertia_and_friction_our_own_plan_is_hardly_worse():
    terms = {"acceleration_time": 0.016, "time_constant": 0.024, "dead_band": 0.02}
    sticky = replace(ERS210A, **terms, tick=0.004, hold=2)
    swing = 0.8 * np.sin(2.0 * np.pi * np.arange(30) / 30) ** 3
    theirs, ours = both(sticky, swing, smoothness=0.0)
    assert ours.rms <= 1.005 * theirs.rms + 1e-4


@CYCLIC
@pytest.mark.parametrize("samples", [4, 12])
def test_trajectories_shorter_than_the_window_are_planned(samples, cyclic):
    # Such cycles are saturated throughout: their closing condition is singular.
    desired = REFERENCE_JOINTS[0].desired[:samples]
    plan, own = both(ERS210A, desired, cyclic=cyclic)
    assert plan.rms == pytest.approx(own.rms, rel=ALIKE)


def test_a_plan_begins_at_the_angle_where_the_joint_rests():
    """The largest error is the first's."""
    desired = 2.0 + 0.15 * np.sin(2.0 * np.pi * np.arange(10) / 25)
    theirs, ours = both(ERS210A, desired, cyclic=False, norm="max", smoothness=0.0)
    assert theirs.error == pytest.approx(ours.error, rel=0.002)


def test_a_solver_that_stops_early_is_reported_with_its_own_status(monkeypatch):
    monkeypatch.setattr(direct_transcription, "ITERATIONS", 1)
    with pytest.raises(SolverFailed, match="inversion by ipopt: the solver stopped") as caught:
        planner.invert_optimal(ERS210A, REFERENCE_JOINTS[0].desired, solver="ipopt")
    assert caught.value.status.startswith("Max")
