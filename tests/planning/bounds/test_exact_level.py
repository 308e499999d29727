"""The exact bound: every response of the joint meets its conditions, and no plan goes below it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import invert_optimal
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.bounds.certify import certify, lower_bound
from planner.planning.bounds.reachable_set import BoundProblem
from planner.planning.bounds.saturation_relaxation import acting_pairs, without_load
from tests.instances import random_model, saturating
from tests.mixed_integer import SOLVER_TOLERANCE, mixed_integer_bound
from tests.strategies import models, trajectories

ROUNDING = 1e-9
"""Sums of a window's terms against the simulation's, in units of v_max a tick."""


@given(models(), st.integers(3, 12), st.booleans())
def test_every_tick_is_driven_by_weights_that_sum_to_one(model, samples, cyclic):
    ticks = samples * model.hold if cyclic else (samples - 1) * model.hold + 1
    acting = acting_pairs(model, ticks, cyclic=cyclic)
    sums = np.bincount(acting.tick, weights=acting.weight, minlength=ticks)
    np.testing.assert_allclose(sums, 1.0, rtol=1e-12)


@pytest.mark.parametrize("cyclic", [True, False])
@given(model=models(offsets=False), requests=trajectories(most=12))
def test_every_response_meets_the_conditions(cyclic, model, requests):
    # With one request held over many ticks the response is known at the requests alone, so the
    # joint is asked again as one whose requests come every tick.
    every_tick = JointModel(
        v_max=model.v_max,
        theta_0=model.theta_0,
        lag=model.lag,
        acceleration_time=model.acceleration_time,
        tick=model.tick,
    )
    held = np.repeat(requests, model.hold)
    if not cyclic:
        held = held[: (len(requests) - 1) * model.hold + 1]
    angles = simulate(every_tick, held, cyclic=cyclic)
    acting = acting_pairs(model, len(held), cyclic=cyclic)
    before = np.roll(angles, 1)
    if not cyclic:
        before[0] = held[0]
    speeds = (angles - before) / model.v_max_per_tick
    errors = np.asarray(requests)[acting.request] - before[acting.tick]
    contributions = np.clip(errors / model.theta_0, -1.0, 1.0)
    driven = np.bincount(acting.tick, weights=acting.weight * contributions, minlength=len(held))
    np.testing.assert_allclose(driven, speeds, rtol=0.0, atol=ROUNDING)
    pairs = np.flatnonzero(acting.following >= 0)
    change = contributions[acting.following[pairs]] - contributions[pairs]
    speed = speeds[acting.tick[pairs]] * model.v_max_per_tick / model.theta_0
    assert np.all(change <= np.maximum(-speed, 0.0) + ROUNDING)
    assert np.all(change >= -np.maximum(speed, 0.0) - ROUNDING)


@pytest.mark.parametrize(
    ("hold", "samples", "cyclic", "norm"), [(1, 16, True, "rms"), (2, 8, False, "max")]
)
def test_the_levels_are_ordered_and_no_plan_goes_below_them(samples, hold, cyclic, norm):
    rng = np.random.default_rng([samples, hold, cyclic])
    model = random_model(rng, whole=False, hold=hold)
    desired = saturating(rng, model, samples=samples)
    plan = invert_optimal(model, desired, cyclic=cyclic, norm=norm)
    for start in {None, plan.start}:
        options = {"cyclic": cyclic, "norm": norm, "start": start, "time_limit": 0.1}
        bounds = [
            lower_bound(model, desired, level=level, **options)
            for level in ("slope", "envelope", "exact")
        ]
        assert bounds[0] <= bounds[1] * (1.0 + 1e-7) + 1e-12
        assert bounds[1] <= bounds[2] <= plan.error


@given(models(friction=True), trajectories(most=12), st.floats(-1.0, 1.0), st.booleans())
def test_a_constant_load_is_part_of_the_offsets(model, requests, torque, cyclic):
    loaded = BoundProblem(model, requests, cyclic, "rms", None, np.full(len(requests), torque))
    same = without_load(loaded)
    assert same.load is None
    np.testing.assert_allclose(
        simulate(same.model, requests, cyclic=cyclic),
        simulate(model, requests, cyclic=cyclic, load=torque),
        rtol=0.0,
        atol=ROUNDING,
    )


def test_the_search_proves_as_much_as_scip_and_scip_no_more_than_any_plan():
    rng = np.random.default_rng(9)
    model = random_model(rng, whole=False)
    desired = saturating(rng, model, samples=10)
    scip, known = mixed_integer_bound(model, desired)
    search = lower_bound(model, desired, level="exact", time_limit=0.5)
    assert known <= scip * (1.0 + 2.0 * SOLVER_TOLERANCE)
    assert lower_bound(model, desired) <= scip
    assert scip <= search * (1.0 + SOLVER_TOLERANCE)
    assert search <= invert_optimal(model, desired).error


def test_a_solver_that_runs_out_of_time_reports_its_gap_and_still_bounds():
    model = random_model(np.random.default_rng(3))
    desired = saturating(np.random.default_rng(4), model, samples=120)
    certificate = certify(model, desired, level="exact", time_limit=0.3)
    assert certificate.solver_gap > 0.0
    assert certificate.bound >= lower_bound(model, desired)


def test_a_mixture_of_requests_without_a_weight_is_branched_on():
    model = JointModel(v_max=3.0, theta_0=0.1, lag=0.03, acceleration_time=0.01, tick=0.02)
    desired = [0.0, 0.01, -0.01, 0.02, 0.0]
    bound = lower_bound(model, desired, cyclic=False, level="exact", time_limit=1.0)
    assert 6.0e-3 < bound < 6.08e-3  # [rad]; 5.42e-3 without cuts, and a response has 6.08e-3
