"""IPOPT on the transcribed problem: its plans are as good, and failures are told."""

from __future__ import annotations

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


@CYCLIC
@pytest.mark.parametrize(("seed", "hold", "limited"), [(0, 1, False), (2, 3, True)])
def test_any_window_hold_offset_and_limits_are_planned_as_well(seed, hold, cyclic, limited):
    model, desired = instance(seed, hold=hold)
    held = desired - model.offset
    limits = (np.min(held) - 0.02, np.max(held) + 0.02) if limited else None
    plan, own = (
        planner.invert_optimal(model, desired, cyclic=cyclic, limits=limits, solver=each)
        for each in ("ipopt", "gauss-newton")
    )
    assert plan.rms == pytest.approx(own.rms, rel=ALIKE)
    assert plan.rms >= plan.lower_bound
    if limits is not None:
        assert np.min(plan.requests) >= limits[0]
        assert np.max(plan.requests) <= limits[1]
    if not cyclic:
        assert plan.requests[0] == pytest.approx(desired[0] - model.offset, abs=1e-12)


@pytest.mark.parametrize(("seed", "cyclic"), [(1, True), (2, False)])
def test_the_largest_error_is_minimised_as_well(seed, cyclic):
    model, desired = instance(seed, hold=seed)
    plan, own = (
        planner.invert_optimal(model, desired, cyclic=cyclic, norm="max", solver=each)
        for each in ("ipopt", "gauss-newton")
    )
    assert plan.max_error == pytest.approx(own.max_error, rel=ALIKE_MAX)
    assert plan.max_error >= plan.lower_bound


@CYCLIC
@pytest.mark.parametrize("samples", [4, 12])
def test_trajectories_shorter_than_the_window_are_planned(samples, cyclic):
    # Such cycles are saturated throughout: their closing condition is singular.
    desired = REFERENCE_JOINTS[0].desired[:samples]
    plan = planner.invert_optimal(ERS210A, desired, cyclic=cyclic, solver="ipopt")
    own = planner.invert_optimal(ERS210A, desired, cyclic=cyclic)
    assert plan.rms == pytest.approx(own.rms, rel=ALIKE)


def test_a_solver_that_stops_early_is_reported_with_its_own_status(monkeypatch):
    monkeypatch.setattr(direct_transcription, "ITERATIONS", 1)
    with pytest.raises(SolverFailed, match="inversion by ipopt: the solver stopped") as caught:
        planner.invert_optimal(ERS210A, REFERENCE_JOINTS[0].desired, solver="ipopt")
    assert caught.value.status.startswith("Max")
