"""Equation 3 for CasADi against the array form and the paper's, and the compiled run in threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.model.joint import JointModel, acting, request_ages, rounded_clip
from planner.model.response import advance, run_columns, simulate
from planner.model.symbolic import ExactRun, exact_run, period
from tests.independent import of_whole_ticks
from tests.instances import random_model
from tests.strategies import models, trajectories

SAME = 1e-14
"""Agreement of the compiled and the interpreted run over a few periods [rad, relative]."""

ROUNDING = 4e-15
"""Disagreement that rounding leaves between two ways to write a sum [relative]."""


@given(models(whole=True, holds=(1, 1), offsets=False), trajectories(), st.floats(-1.0, 1.0))
def test_whole_ticks_are_equation_3_to_the_letter(model, requests, start):
    expected = of_whole_ticks(model, requests, start)
    angles = ExactRun(model, len(requests))(start, windows_of(model, requests, cyclic=False))
    np.testing.assert_allclose(angles, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("hold", [1, 2, 3, 4])
@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("samples", [2, 7, 60])
def test_the_compiled_run_is_the_simulation(samples, cyclic, hold):
    rng = np.random.default_rng([samples, hold])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    requests = rng.uniform(-1.0, 1.0, size=samples)
    angles = simulate(model, requests, cyclic=cyclic)
    # From rest the run starts where the first request holds the joint.
    start = float(angles[-1]) if cyclic else float(requests[0] + model.offset)
    run = exact_run(model, samples)(start, windows_of(model, requests, cyclic=cyclic))
    # Cyclic, the cycle itself is closed to 1e-12 only.
    np.testing.assert_allclose(run, angles, rtol=0.0, atol=2e-12 if cyclic else SAME)


@given(models(), st.integers(0, 2**32 - 1))
def test_every_request_said_to_act_acts_and_no_younger_one_does(model, seed):
    at = request_ages(model)
    rng = np.random.default_rng(seed)
    # Small errors leave every term of the window unsaturated, so that each of them counts.
    windows = rng.uniform(-0.01, 0.01, size=(1, at.width)) * model.theta_0 - model.offset
    symbols = casadi.SX.sym("angle"), casadi.SX.sym("requests", at.width)
    by_request = casadi.jacobian(period(model, *symbols), symbols[1])
    slopes = casadi.Function("slopes", symbols, [by_request])(0.0, windows)
    assert np.all(np.asarray(slopes) != 0.0)

    k = at.oldest + 1
    requests = rng.uniform(-1.0, 1.0, size=k + 1)
    changed = requests.copy()
    changed[k - at.youngest + 1 :] += 1.0
    before = simulate(model, requests, cyclic=False)[k]
    assert simulate(model, changed, cyclic=False)[k] == before


@pytest.mark.parametrize("radius", [0.0, 0.02])
@given(model=models(), angle=st.floats(-1.0, 1.0), seed=st.integers(0, 2**32 - 1))
def test_one_definition_agrees_for_floats_arrays_and_casadi(radius, model, angle, seed):
    weights = model.window.weights.tolist()
    requests = np.random.default_rng(seed).uniform(-1.0, 1.0, size=len(weights))
    # Rounded with radius 0 each |x| is the root of its own square: the exact model again.
    rounded = model.law_per_tick(clip=rounded_clip(model.gain_per_tick * radius))
    exact = rounded if radius else model.law_per_tick()
    as_float = advance(angle, requests.tolist(), weights=weights, speed=rounded)
    as_array = advance(np.full(3, angle), requests, weights=weights, speed=exact)
    symbols = casadi.SX.sym("angle"), casadi.SX.sym("requests", len(weights))
    written = advance(symbols[0], casadi.vertsplit(symbols[1]), weights=weights, speed=rounded)
    compiled = casadi.Function("advance", symbols, [written])
    scale = max(1.0, abs(as_float), model.v_max_per_tick)
    np.testing.assert_allclose(as_array, as_float, rtol=0.0, atol=ROUNDING * scale)
    assert float(compiled(angle, requests)) == pytest.approx(as_float, abs=ROUNDING * scale)


@given(models(), trajectories(least=4), st.integers(1, 5))
def test_runs_side_by_side_are_the_runs_one_by_one(model, requests, columns):
    one = replace(model, hold=1)
    numbers = np.maximum(acting(request_ages(one), len(requests), cyclic=False), 0)
    targets = np.stack([requests[numbers] * (c + 1.0) for c in range(columns)], axis=-1)
    weights = np.broadcast_to(one.window.weights[:, np.newaxis], targets.shape)
    starts = np.arange(float(columns))
    together = run_columns(starts, targets, weights=weights, speed=one.law_per_tick())
    for c in range(columns):
        alone = simulate(
            replace(one, offset=0.0), requests * (c + 1.0), cyclic=False, start=starts[c]
        )
        np.testing.assert_allclose(together[:, c], alone, rtol=0.0, atol=1e-12)


def test_the_request_ages_of_the_ers210a_are_its_window():
    assert tuple(request_ages(JointModel.ers210a())) == (5, 10)


@pytest.mark.parametrize(
    ("hold", "lag", "acceleration", "expected"),
    [(1, 0, 1, (1, 1)), (4, 0, 1, (1, 1)), (4, 3, 1, (1, 2)), (2, 3, 4, (2, 4)), (3, 2, 3, (1, 3))],
)
def test_the_ages_of_held_requests_are_counted_in_requests(hold, lag, acceleration, expected):
    model = JointModel(
        v_max=1.0,
        theta_0=0.1,
        lag=lag * 0.01,
        acceleration_time=acceleration * 0.01,
        tick=0.01,
        hold=hold,
    )
    # Between samples the last tick feels ages first.. and the first tick, hold-1 earlier, last..
    felt = {
        -(-(age - back) // hold)
        for back in range(1 - hold, 1)
        for age in range(lag + 1, lag + acceleration + 1)
    }
    assert tuple(request_ages(model)) == expected
    assert (min(felt), max(felt)) == expected


def test_from_rest_minus_one_stands_for_the_requests_before_the_first():
    numbers = acting(request_ages(JointModel.ers210a()), 7, cyclic=False)
    assert numbers[0].tolist() == [-1] * 6
    assert numbers[6].tolist() == [1, 0, -1, -1, -1, -1]
    assert acting(request_ages(JointModel.ers210a()), 7, cyclic=True)[0].tolist() == [
        2,
        1,
        0,
        6,
        5,
        4,
    ]


def test_a_run_keeps_its_angles_when_the_next_one_comes():
    compiled = ExactRun(JointModel.ers210a(), 4)
    windows = np.zeros((4, 6))
    first = compiled(0.5, windows)
    kept = first.copy()
    compiled(-0.5, windows + 1.0)
    np.testing.assert_array_equal(first, kept)


def test_the_same_model_and_length_are_compiled_once():
    assert exact_run(JointModel.ers210a(), 12) is exact_run(JointModel.ers210a(), 12)
    assert exact_run(JointModel.ers210a(), 12) is not exact_run(JointModel.ers210a(), 13)


def test_many_threads_get_what_one_thread_gets():
    compiled = exact_run(JointModel.ers210a(), 88)
    rng = np.random.default_rng(7)
    jobs = [(rng.uniform(-1, 1), rng.uniform(-1, 1, size=(88, 6))) for _ in range(200)]
    alone = [compiled(*job) for job in jobs]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda job: compiled(*job), jobs))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


def windows_of(model, requests, *, cyclic):
    """The requests that act before each sample, youngest first."""
    return requests[np.maximum(acting(request_ages(model), len(requests), cyclic=cyclic), 0)]
