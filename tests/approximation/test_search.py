"""The search for knots: its derivatives, its small QP, and its answers against an exact oracle."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from planner.approximation.fit import fit_pwl
from planner.approximation.objective import (
    Problem,
    constraint_rows,
    evaluate,
    slacks,
)
from planner.approximation.small_qp import minimize_quadratic
from tests.approximation.samples import KINDS, samples_of

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


@pytest.mark.parametrize("cyclic", [True, False])
def test_gradient_and_hessian_are_those_of_finite_differences(cyclic):
    rng = np.random.default_rng(0)
    weights = rng.uniform(0.5, 1.5, size=40)
    problem = Problem(desired=rng.normal(size=40), step=1.0, cyclic=cyclic, weights=weights)
    at = np.r_[0.3, 7.2, 18.9, 30.4, 38.6, rng.normal(size=5)]
    here = evaluate(problem, at[:5], at[5:])
    for i, way in enumerate(1e-6 * np.eye(10)):
        ahead = evaluate(problem, *np.split(at + way, 2))
        behind = evaluate(problem, *np.split(at - way, 2))
        half = 0.5 * (ahead.error - behind.error) / 2e-6
        assert here.gradient[i] == pytest.approx(half, rel=1e-6, abs=1e-7)
        change = (ahead.gradient - behind.gradient) / 2e-6
        np.testing.assert_allclose(here.hessian[i], change, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_step_along_the_rows_uses_up_the_slacks(cyclic):
    rng = np.random.default_rng(1)
    problem = Problem(desired=np.zeros(40), step=0.7, cyclic=cyclic)
    knots, values = np.array([1.0, 9.0, 20.0, 33.0]), rng.normal(size=4)
    step = rng.normal(size=8)
    expected = (
        slacks(problem, knots, values) - constraint_rows(4, problem.step, cyclic=cyclic) @ step
    )
    moved = slacks(problem, knots + step[:4], values + step[4:])
    np.testing.assert_allclose(moved, expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_the_small_qp_is_solved_like_an_independent_solver_does(seed):
    rng = np.random.default_rng(seed)
    root, rows = rng.normal(size=(6, 6)), rng.normal(size=(9, 6))
    hessian, gradient = root @ root.T + 0.1 * np.eye(6), 3.0 * rng.normal(size=6)
    bounds = rng.uniform(0.0, 0.5, size=9) * (rng.random(9) < 0.7)
    step = minimize_quadratic(hessian, gradient, rows, bounds)
    x = cp.Variable(6)
    cost = 0.5 * cp.quad_form(x, cp.psd_wrap(hessian)) + gradient @ x
    expected = cp.Problem(cp.Minimize(cost), [rows @ x <= bounds]).solve(solver="CLARABEL")
    assert np.all(rows @ step <= bounds + 1e-9)
    assert 0.5 * step @ hessian @ step + gradient @ step == pytest.approx(expected, abs=1e-7)


def test_a_hessian_that_is_not_convex_has_no_minimum():
    assert minimize_quadratic(-np.eye(2), np.ones(2), np.ones((1, 2)), np.ones(1)) is None


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


@pytest.mark.parametrize("cyclic", [True, False])
def test_thousands_of_samples_need_few_segments_for_a_largest_error(cyclic):
    rng = np.random.default_rng(4)
    desired = np.resize(samples_of("sines", 90, rng), 2700)
    fit = fit_pwl(desired, v_max=2.0, tick=1.0, cyclic=cyclic, max_error=0.1)
    assert fit.max_error <= 0.1 * (1.0 + 1e-9)
    short = fit_pwl(desired[:90], v_max=2.0, tick=1.0, max_error=0.1)
    assert fit.segments <= 1.1 * 30 * short.segments
