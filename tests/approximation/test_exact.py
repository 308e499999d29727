"""The proved optimum against enumeration, and the search against the proved optimum."""

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from planner import Infeasible, fit_pwl
from planner.approximation.exact_fit import PROVED, Relaxation, proved_best
from planner.approximation.fit_problem import Problem
from planner.approximation.values import best_values
from tests.approximation.samples import KINDS, oracle_instance, oracle_instances, samples_of

CLOSE = 1.01  # error over the oracle's that the search is allowed, in at least 95 % of instances
ZERO = 1e-9  # errors below this [rad] are none; samples are of unit size
TABLE = json.loads((Path(__file__).parent / "oracle.json").read_text())
CLOSED = 1e3  # weight of the condition that a cycle closes, in units of the samples' own


@pytest.mark.parametrize("seed", range(8))
def test_the_proved_optimum_is_that_of_all_sets_of_knots(seed):
    """Of every kind of samples, cycles and paths, bounds tight and loose."""
    rng = np.random.default_rng(seed)
    cyclic = bool(seed % 2)
    segments, n = (3, 22) if cyclic else (4, 20)
    desired = samples_of(KINDS[seed % len(KINDS)], n, rng)
    step = float(rng.choice([1.0, 2.0, 4.0, 50.0]) * np.ptp(desired) / n)
    fit = fit_pwl(desired, v_max=step, tick=1.0, cyclic=cyclic, segments=segments, exact=True)
    rms = np.sqrt(least_error(desired, segments, step, cyclic) / n)
    assert fit.rms == pytest.approx(rms, rel=2.0 * PROVED, abs=1e-6)


@pytest.mark.parametrize("seed", [0, 7, 8, 9, 18, 27, 36, 45, 54])  # 7, 8: nudges fall short
def test_the_stored_oracle_is_what_is_proved_today(seed):
    each = oracle_instance(seed)
    fit = fit_pwl(each.desired, **each.settings, segments=each.segments, exact=True)
    assert TABLE[seed]["seed"] == seed
    assert fit.rms == pytest.approx(TABLE[seed]["rms"], rel=2.0 * PROVED, abs=ZERO)
    assert np.array_equal(fit.knots, np.round(fit.knots))


def test_the_search_comes_within_one_percent_of_the_oracle_in_95_of_100_instances():
    ratios = []
    for each, stored in zip(oracle_instances(), TABLE, strict=True):
        fit = fit_pwl(each.desired, **each.settings, segments=each.segments)
        ratios.append((fit.rms + ZERO) / (stored["rms"] + ZERO))
    assert np.mean(np.array(ratios) <= CLOSE) >= 0.95
    assert np.max(ratios) <= 1.05


@pytest.mark.parametrize("cyclic", [True, False])
def test_the_proof_respects_what_is_required(cyclic):
    desired = samples_of("walk", 24, np.random.default_rng(8))
    pin = float(desired[9])
    asked = {"cyclic": cyclic, "required": {9: pin}, "segments": 4}
    fit = fit_pwl(desired, v_max=0.3, tick=1.0, exact=True, **asked)
    assert fit(9.0) == pytest.approx(pin, abs=1e-12)
    rng = np.random.default_rng(0)
    others = [k for k in range(24) if k != 9] if cyclic else [k for k in range(1, 23) if k != 9]
    for _ in range(30):
        knots = np.sort(np.append(rng.choice(others, 3 if cyclic else 2, replace=False), 9))
        settings = {"cyclic": cyclic, "required": {9: pin}, "knots": knots}
        other = fit_pwl(desired, v_max=0.3, tick=1.0, **settings)
        assert fit.rms <= other.rms * (1.0 + PROVED)


@pytest.mark.parametrize("kind", KINDS)
def test_no_multipliers_lift_the_bound_above_the_optimum(kind):
    rng = np.random.default_rng(6)
    problem = Problem(desired=samples_of(kind, 30, rng), step=0.2, cyclic=True)
    start = best_values(problem, np.array([2.0, 11.0, 20.0]))
    best = proved_best(problem, start)
    relaxation = Relaxation(problem, best)
    levels = [np.arange(t, 30 - 3 + t + 1) for t in range(3)]
    for size in (0.0, 0.1, 1.0):
        moved = size * rng.normal(size=(3, 30))
        bound, *_ = relaxation.bound(levels, np.stack([moved, moved]))
        assert bound <= best.error * (1.0 + 1e-9) + 1e-12


def test_the_fewest_segments_for_an_rms_error_are_proved_fewest():
    desired = samples_of("sines", 40, np.random.default_rng(3))
    fit = fit_pwl(desired, v_max=1.0, tick=1.0, max_rms=0.2, exact=True)
    fewer = fit_pwl(desired, v_max=1.0, tick=1.0, segments=fit.segments - 1, exact=True)
    assert fit.rms <= 0.2 < fewer.rms
    assert (fit.fewest_segments, fit.proved) == (fit.segments, True)
    assert (fewer.fewest_segments, fewer.proved) == (None, True)
    with pytest.raises(Infeasible, match="segments and knots on samples the smallest"):
        fit_pwl(desired, v_max=1.0, tick=1.0, max_rms=0.2, segments=2, exact=True)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("steepness", [1e-5, 0.1])
def test_a_joint_that_can_hardly_move_has_its_proof_at_once(cyclic, steepness):
    desired = samples_of("noise", 40, np.random.default_rng(0))
    fit = fit_pwl(desired, v_max=steepness / 40, tick=1.0, cyclic=cyclic, segments=5, exact=True)
    assert fit.rms == pytest.approx(np.std(desired), rel=2.0 * steepness)


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
