"""The search for knots: moves, kinks of the squared error at samples, many samples."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from planner.approximation.fit import fit_pwl
from planner.approximation.knot_search import knots_at_kinks, moved, with_moved_knots
from planner.approximation.problem import Problem, candidate
from tests.approximation.samples import KINDS, samples_of

TENT = np.interp(np.arange(21.0), [0.0, 10.0, 20.0], [0.0, 1.0, 0.0])
"""A corner at sample 10."""


def tent_with(at_corner, knot):
    """The tent with its middle sample moved, and a curve whose knot is near it."""
    desired = TENT.copy()
    desired[10] = at_corner
    problem = Problem(desired=desired, step=1.0, cyclic=False)
    return problem, candidate(problem, np.array([0.0, knot, 20.0]), np.array([0.0, 1.0, 0.0]))


def test_a_knot_next_to_a_convex_kink_is_put_into_it_and_stays():
    # The curve bends down and lies below the sample: a step to either side costs at once.
    problem, curve = tent_with(1.5, 10.05)
    here, hold = knots_at_kinks(problem, curve)
    np.testing.assert_array_equal(here.knots, [0.0, 10.0, 20.0])
    np.testing.assert_array_equal(hold, [False, True, False])


@pytest.mark.parametrize(("at_corner", "knot"), [(0.5, 10.05), (1.5, 10.3)])
def test_a_knot_at_a_concave_kink_or_far_from_a_sample_is_free(at_corner, knot):
    problem, curve = tent_with(at_corner, knot)
    here, hold = knots_at_kinks(problem, curve)
    assert here is curve
    assert not np.any(hold)


def test_a_kink_too_near_another_knot_is_left_alone():
    problem, _ = tent_with(1.5, 10.05)
    knots = np.array([0.0, 10.05, 11.05, 20.0])
    curve = candidate(problem, knots, np.array([0.0, 1.0, 0.9, 0.0]))
    here, hold = knots_at_kinks(problem, curve)
    assert np.min(np.diff(here.knots)) >= problem.shortest - 1e-9
    assert hold.shape == knots.shape


def test_moves_keep_the_ends_and_the_shortest_segment():
    problem, curve = tent_with(1.0, 1.5)
    for each in moved(problem, curve):
        assert each.knots[0] == 0.0
        assert each.knots[-1] == 20.0
        assert np.min(np.diff(each.knots)) >= 1.0 - 1e-9


def test_a_curve_with_moved_knots_is_never_worse():
    problem, curve = tent_with(1.0, 7.0)
    assert with_moved_knots(problem, [curve]).error <= curve.error


CLOSED = 1e3
"""Weight of the condition that a cycle closes, in units of the samples' own."""


def least_error(desired, segments, step, cyclic):
    """Smallest squared error with all knots on samples: every set of knots, best first.

    The unknowns are one value and the slopes, so that bounds on slopes are bounds on unknowns. The
    error without bounds is a lower bound that ends the enumeration early.
    """
    n = desired.size
    index = np.arange(n, dtype=float)
    inner = combinations(range(n) if cyclic else range(1, n - 1), segments - (not cyclic))
    sets = np.array(list(inner), dtype=float).reshape(-1, segments - (not cyclic))
    if not cyclic:
        sets = np.column_stack([np.zeros(len(sets)), sets])
    starts = sets - sets[:, :1]
    ends = np.column_stack([starts[:, 1:], np.full(len(sets), n if cyclic else n - 1.0)])
    since = np.mod(index - sets[:, :1], n)
    runs = np.clip(since[:, :, None] - starts[:, None, :], 0.0, (ends - starts)[:, None, :])
    bases = np.concatenate([np.ones((len(sets), n, 1)), runs], axis=2)  # (sets, n, S + 1)
    targets = np.tile(desired, (len(sets), 1))
    if cyclic:
        closing = np.concatenate([np.zeros((len(sets), 1)), ends - starts], axis=1)
        bases = np.concatenate([bases, CLOSED * closing[:, None, :]], axis=1)
        targets = np.column_stack([targets, np.zeros(len(sets))])
    q, _ = np.linalg.qr(bases)
    free = np.sum(targets**2, axis=1) - np.sum(np.einsum("snk,sn->sk", q, targets) ** 2, axis=1)
    bounds = np.r_[-np.inf, np.full(segments, -step)], np.r_[np.inf, np.full(segments, step)]
    least = np.inf
    for number in np.argsort(free):
        if free[number] >= least:
            break
        least = min(least, 2.0 * lsq_linear(bases[number], targets[number], bounds).cost)
    return least


def test_the_search_reaches_an_exact_oracle_on_nearly_every_instance():
    ratios = []
    for seed in range(42):
        rng = np.random.default_rng(seed)
        cyclic, kind = bool(seed % 2), KINDS[seed % len(KINDS)]
        segments, n = (3, 22) if cyclic else (4, 20)
        desired = samples_of(kind, n, rng)
        step = rng.choice([1.0, 2.0, 4.0, 50.0]) * np.ptp(desired) / n
        least = np.sqrt(least_error(desired, segments, step, cyclic) / n)
        fit = fit_pwl(desired, v_max=step, tick=1.0, cyclic=cyclic, segments=segments)
        ratios.append((fit.rms + 1e-9) / (least + 1e-9))
    assert np.mean(np.array(ratios) <= 1.01) >= 0.95


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
