"""Rows that count by their motion: what they find that fast motion would hide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

import planner
from planner.identification.excitation import excite
from planner.identification.fit import fit_joint
from planner.identification.grid import timing_of
from planner.identification.weights import LEAST_SHARE, around, unweighted, weighted_by_motion
from planner.model.joint import JointModel
from planner.trajectory import rms

STICKS = replace(JointModel.ers210a(), tick=0.02, dead_band=np.radians(0.25), lag=0.04)
"""A joint with a little dry friction."""

RINGING, DAMPING = 2.0 * np.pi * 4.0, 0.1
"""Frequency [rad/s] and damping of the arm on the joint, which no model has."""

SEEN = 0.2
"""Share of the arm's bending that the sensor sees [-]."""


@pytest.fixture(scope="module")
def log():
    """The signal that ``excite`` proposes, by a joint whose arm rings."""
    signal = excite("combined", limits=(-0.8, 0.8), period=STICKS.period, duration=60.0)
    angles = planner.simulate(STICKS, signal.requests, cyclic=False)
    pushed = np.gradient(np.gradient(angles, STICKS.period), STICKS.period)
    arm = ([-1.0], [1.0, 2.0 * DAMPING * RINGING, RINGING**2])
    _, bent, _ = lsim(arm, pushed, signal.times)
    noise = np.radians(0.1) * np.random.default_rng(0).standard_normal(len(angles))
    angles = angles + SEEN * bent + noise
    return planner.Log(times=signal.times, requests=signal.requests, angles=angles)


@pytest.fixture(scope="module")
def fit(log):
    return fit_joint([log], timing_of([log], tick=0.02, hold=1))[0]


def test_dry_friction_is_found_where_the_model_misses_fast_motion(log):
    found = planner.identify(log, hold_out=False)
    # with all rows alike it is 40 % less
    assert found.model.dead_band == pytest.approx(STICKS.dead_band, rel=0.15)


def test_rows_count_inversely_to_the_error_of_their_motion(fit):
    weighted = weighted_by_motion(fit)
    weights = weighted.grid.weights
    errors = np.sqrt(around(fit.grid, (fit.predicted - fit.grid.angles) ** 2))
    assert np.corrcoef(weights, 1.0 / errors)[0, 1] > 0.8
    assert np.max(weights) <= np.min(weights) / LEAST_SHARE * (1.0 + 1e-9)
    assert rms(weights * (fit.predicted - fit.grid.angles)) == pytest.approx(fit.rms)
    assert weighted.rms >= fit.rms * (1.0 - 1e-6)  # of all rows alike


def test_a_fit_without_weights_is_the_same_joint(fit):
    weighted = weighted_by_motion(fit)
    bare = unweighted(weighted)
    assert bare.parameters == weighted.parameters
    assert bare.free_names == weighted.free_names
    np.testing.assert_array_equal(bare.residuals, bare.predicted - bare.grid.angles)


def test_the_mean_around_a_row_is_that_of_its_own_run(fit):
    numbers = fit.grid.run.astype(float)
    np.testing.assert_allclose(around(fit.grid, numbers), numbers)
