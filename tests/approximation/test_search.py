"""The search for knots: moves, many samples."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from planner.approximation.fit import fit_pwl
from planner.approximation.problem import Problem, candidate
from planner.approximation.search import moved, with_moved_knots
from tests.approximation.samples import samples_of

TENT = np.interp(np.arange(21.0), [0.0, 10.0, 20.0], [0.0, 1.0, 0.0])
"""A corner at sample 10."""


def tent_with(at_corner, knot):
    """The tent with its middle sample moved, and a curve whose knot is near it."""
    desired = TENT.copy()
    desired[10] = at_corner
    problem = Problem(desired=desired, step=1.0, cyclic=False)
    return problem, candidate(problem, np.array([0.0, knot, 20.0]), np.array([0.0, 1.0, 0.0]))


def test_moves_keep_the_ends_and_leave_a_sample_between_knots():
    problem, curve = tent_with(1.0, 1.5)
    for each in moved(problem, curve):
        assert each.knots[0] == 0.0
        assert each.knots[-1] == 20.0
        assert np.min(np.diff(each.knots)) >= 1.0 - 1e-9


def test_a_curve_with_moved_knots_is_never_worse():
    problem, curve = tent_with(1.0, 7.0)
    assert with_moved_knots(problem, [curve]).error <= curve.error


def test_ten_thousand_samples_are_fitted_with_hundreds_of_segments():
    rng = np.random.default_rng(0)
    desired = np.resize(samples_of("sines", 100, rng), 10_000) + 0.01 * rng.normal(size=10_000)
    fit = fit_pwl(desired, v_max=0.1, tick=1.0, segments=800)
    ideal = fit_pwl(desired[:100], v_max=0.1, tick=1.0, segments=8)
    assert np.max(np.abs(fit.slopes)) <= 0.1 * (1.0 + 1e-12)
    assert fit.rms <= 1.5 * ideal.rms


GROWTH = 200
"""Memory that a fit of 40 000 samples may take beyond its imports [MB]; their square is 12 GB."""


def test_memory_grows_in_proportion_to_the_samples():
    code = """
import resource, sys
import numpy as np
from planner.approximation.fit import fit_pwl
desired = np.sin(np.arange(40_000) / 80.0)
fit_pwl(desired[:600], v_max=0.02, tick=1.0, segments=40)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
fit_pwl(desired, v_max=0.02, tick=1.0, segments=400)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""
    child = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert int(child.stdout) <= GROWTH
