"""Means that stand for many samples."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.canonical_form import MEANS, from_means, to_means
from planner.approximation.problem import Candidate, Problem

SAMPLES = 5000


@pytest.mark.parametrize("cyclic", [True, False])
def test_means_keep_a_constant_and_the_slope_per_time(cyclic):
    problem = Problem(desired=np.full(SAMPLES, 0.7), step=0.01, cyclic=cyclic)
    few = to_means(problem)
    np.testing.assert_allclose(few.desired, 0.7, rtol=1e-12)
    assert few.samples == MEANS
    lasts = (MEANS, SAMPLES) if cyclic else (MEANS - 1, SAMPLES - 1)
    assert few.step * lasts[0] == pytest.approx(problem.step * lasts[1])


@pytest.mark.parametrize("cyclic", [True, False])
def test_every_sample_is_in_the_mean_nearest_to_it(cyclic):
    turns = np.arange(SAMPLES) / SAMPLES
    desired = np.sin(2.0 * np.pi * turns)
    few = to_means(Problem(desired=desired, step=1.0, cyclic=cyclic))
    at = np.arange(MEANS) * (SAMPLES / MEANS if cyclic else (SAMPLES - 1.0) / (MEANS - 1.0))
    expected = np.interp(at, np.arange(SAMPLES), desired)
    # Half a sample's slope, as far as a stretch's middle may be off; a path's ends are one-sided.
    inner = slice(1, -1)
    assert np.max(np.abs(few.desired - expected)[inner]) <= 1.1 * np.pi / SAMPLES


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_curve_through_the_means_goes_through_all_samples(cyclic):
    corners = np.array([0.0, 1200.0, 3400.0, SAMPLES if cyclic else SAMPLES - 1.0])
    values = np.array([0.0, 1.0, -1.0, 0.0])
    problem = Problem(
        desired=np.interp(np.arange(SAMPLES), corners, values), step=1.0, cyclic=cyclic
    )
    spacing = SAMPLES / MEANS if cyclic else (SAMPLES - 1.0) / (MEANS - 1.0)
    few = slice(None, -1) if cyclic else slice(None)
    curve = from_means(problem, Candidate(corners[few] / spacing, values[few], 0.0))
    assert curve.error <= 1e-20 * SAMPLES
    np.testing.assert_allclose(curve.knots, corners[few], rtol=1e-12)
