"""The compiled run against plain simulation, from one thread and from many."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.model.transition import Transitions, acting, reach, transitions
from tests.instances import random_model
from tests.strategies import models

SAME = 1e-14
"""Agreement of the compiled and the interpreted run over a few periods [rad, relative]."""


@pytest.mark.parametrize("hold", [1, 2, 3, 4])
@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("samples", [2, 7, 60])
def test_the_compiled_run_is_the_simulation(samples, cyclic, hold):
    rng = np.random.default_rng([samples, hold])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    requests = rng.uniform(-1.0, 1.0, size=samples)
    compiled = transitions(model, samples)
    numbers = acting(compiled.reach, samples, cyclic=cyclic)
    angles = simulate(model, requests, cyclic=cyclic)
    # From rest the run starts where the first request holds the joint.
    seam = float(angles[-1]) if cyclic else float(requests[0] + model.offset)
    run = compiled.run(seam, requests[np.maximum(numbers, 0)], 0.0)
    # Cyclic, the seam itself is closed to 1e-12 only.
    np.testing.assert_allclose(run.angles, angles, rtol=0.0, atol=2e-12 if cyclic else SAME)


@given(models(), st.integers(0, 2**32 - 1))
def test_every_request_said_to_act_acts_and_no_younger_one_does(model, seed):
    at = reach(model)
    rng = np.random.default_rng(seed)
    # Small errors leave every term of the window unsaturated, so that each of them counts.
    windows = rng.uniform(-0.01, 0.01, size=(2, at.width)) * model.theta_0 - model.offset
    assert np.all(transitions(model, 2).run(0.0, windows, 0.0).by_request[0] != 0.0)

    k = at.oldest + 1
    requests = rng.uniform(-1.0, 1.0, size=k + 1)
    changed = requests.copy()
    changed[k - at.youngest + 1 :] += 1.0
    before = simulate(model, requests, cyclic=False)[k]
    assert simulate(model, changed, cyclic=False)[k] == before


def test_the_reach_of_the_ers210a_is_its_window():
    assert tuple(reach(JointModel.ers210a())) == (5, 10)


@pytest.mark.parametrize(
    ("hold", "lag", "acceleration", "expected"),
    [(1, 0, 1, (1, 1)), (4, 0, 1, (1, 1)), (4, 3, 1, (1, 2)), (2, 3, 4, (2, 4)), (3, 2, 3, (1, 3))],
)
def test_the_reach_of_held_requests_is_counted_in_requests(hold, lag, acceleration, expected):
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
    assert tuple(reach(model)) == expected
    assert (min(felt), max(felt)) == expected


def test_from_rest_minus_one_stands_for_the_requests_before_the_first():
    numbers = acting(reach(JointModel.ers210a()), 7, cyclic=False)
    assert numbers[0].tolist() == [-1] * 6
    assert numbers[6].tolist() == [1, 0, -1, -1, -1, -1]
    assert acting(reach(JointModel.ers210a()), 7, cyclic=True)[0].tolist() == [2, 1, 0, 6, 5, 4]


def test_a_run_keeps_its_arrays_when_the_next_one_comes():
    compiled = Transitions(JointModel.ers210a(), 4)
    windows = np.zeros((4, 6))
    first = compiled.run(0.5, windows, 0.0)
    kept = [array.copy() for array in first]
    compiled.run(-0.5, windows + 1.0, 0.1)
    for array, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_the_same_model_and_length_are_compiled_once():
    assert transitions(JointModel.ers210a(), 12) is transitions(JointModel.ers210a(), 12)
    assert transitions(JointModel.ers210a(), 12) is not transitions(JointModel.ers210a(), 13)


def test_many_threads_get_what_one_thread_gets():
    compiled = transitions(JointModel.ers210a(), 88)
    rng = np.random.default_rng(7)
    jobs = [(rng.uniform(-1, 1), rng.uniform(-1, 1, size=(88, 6)), 0.01) for _ in range(200)]
    alone = [compiled.run(*job) for job in jobs]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda job: compiled.run(*job), jobs))
    for one, other in zip(alone, together, strict=True):
        for array, same in zip(one, other, strict=True):
            np.testing.assert_array_equal(array, same)
