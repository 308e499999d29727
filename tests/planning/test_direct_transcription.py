"""IPOPT on the transcribed problem: its plans are as good, and failures are told."""

from dataclasses import replace

import numpy as np
import pytest

import planner
from planner import SolverFailed
from planner.planning import direct_transcription
from tests.instances import ERS210A, REFERENCE_JOINTS, random_model, saturating

CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])

ALIKE = 0.01
"""Difference of two optimisers' rms, relative; a random instance in a hundred differs by more."""

ALIKE_MAX = 0.05  # the same for the largest error, where more local minima are as good


def instance(seed, *, hold=1):
    """A joint of fractional window, with a sag, and angles that it cannot follow."""
    rng = np.random.default_rng([77, seed])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    return model, saturating(rng, model, samples=60)


def both(model, desired, **options):
    """The plans of IPOPT and of our own search."""
    return (
        planner.invert_optimal(model, desired, solver=solver, **options)
        for solver in ("ipopt", "gauss-newton")
    )


@pytest.mark.parametrize(
    ("seed", "hold", "cyclic", "norm", "limited"),
    [
        (0, 1, False, "rms", False),
        (2, 3, True, "rms", True),
        (2, 3, False, "rms", True),
        (1, 1, True, "max", False),
        (2, 2, False, "max", False),
    ],
)
def test_any_window_hold_offset_norm_and_limits_are_planned_as_well(
    seed, hold, cyclic, norm, limited
):
    model, desired = instance(seed, hold=hold)
    held = desired - model.offset
    limits = (np.min(held) - 0.02, np.max(held) + 0.02) if limited else None
    plan, own = both(model, desired, cyclic=cyclic, norm=norm, limits=limits)
    assert plan.error == pytest.approx(own.error, rel=ALIKE if norm == "rms" else ALIKE_MAX)
    assert plan.error >= plan.lower_bound
    if limits is not None:
        assert np.min(plan.requests) >= limits[0]
        assert np.max(plan.requests) <= limits[1]
    if not cyclic:
        assert plan.requests[0] == pytest.approx(desired[0] - model.offset, abs=1e-12)


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


def test_a_solver_that_stops_early_is_reported_with_its_own_status(monkeypatch):
    monkeypatch.setattr(direct_transcription, "ITERATIONS", 1)
    with pytest.raises(SolverFailed, match="inversion by ipopt: the solver stopped") as caught:
        planner.invert_optimal(ERS210A, REFERENCE_JOINTS[0].desired, solver="ipopt")
    assert caught.value.status.startswith("Max")
