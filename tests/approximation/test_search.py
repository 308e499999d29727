"""The search for knots: moves, many samples."""

from __future__ import annotations

import numpy as np

from planner.approximation.fit import fit_pwl
from tests.approximation.samples import samples_of


def test_ten_thousand_samples_are_fitted_with_hundreds_of_segments():
    rng = np.random.default_rng(0)
    desired = np.resize(samples_of("sines", 100, rng), 10_000) + 0.01 * rng.normal(size=10_000)
    fit = fit_pwl(desired, v_max=0.1, tick=1.0, segments=800)
    ideal = fit_pwl(desired[:100], v_max=0.1, tick=1.0, segments=8)
    assert np.max(np.abs(fit.slopes)) <= 0.1 * (1.0 + 1e-12)
    assert fit.rms <= 1.5 * ideal.rms
