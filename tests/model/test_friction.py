"""Dry friction and load: Equation 2 with its further terms, and what must hold of any answer."""

from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.model.joint import JointModel, acting_requests
from planner.model.response import load_by_period, motion_under, simulate
from planner.model.symbolic import period_function
from tests.independent import equation_2, from_rest, next_cycle
from tests.instances import random_model
from tests.model.rounded_periods import rounded_periods
from tests.strategies import INTEGRALS, models, trajectories

SAME = 1e-12  # two ways to run the same recursion over a few hundred ticks agree to this [rad]
CLOSED = 2e-12  # how far a cycle may be from closed, at angles of a few radians [rad]
TERMS = {"dead_band": 0.05, "v_offset": 1.5, "compliance": 0.1, "speed_per_torque": 0.8}
DRY = replace(JointModel.ers210a(), **TERMS)

ANY = models(friction=True, inertia=True, integrals=INTEGRALS, poses=True)


def loads(samples, seed=0):
    """Torques within ±1 N m."""
    return np.random.default_rng([samples, seed]).uniform(-1.0, 1.0, samples)


def random_dry_model(rng, **options):
    """A random joint with friction that feels loads within ±1 N m."""
    model = random_model(rng, **options)
    return replace(
        model,
        dead_band=rng.uniform(0.1, 0.6) * model.theta_0,
        v_offset=rng.uniform(-0.5, 0.5) * model.v_max,
        compliance=rng.uniform(0.0, 0.1),
        speed_per_torque=rng.uniform(0.0, 0.4) * model.v_max,
    )


@given(models(friction=True), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_the_speed_is_equation_2_with_friction_and_load(model, error, load):
    expected = equation_2(
        error,
        v_max=model.v_max,
        theta_0=model.theta_0,
        dead_band=model.dead_band,
        v_offset=model.v_offset + model.speed_per_torque * load,
    )
    assert model.speed(error, load) == pytest.approx(expected, abs=1e-13 * model.v_max / 0.02)


@given(ANY, trajectories(), st.floats(-1.0, 1.0), st.integers(0, 9))
def test_from_rest_friction_and_load_are_the_sum_over_overlaps(model, requests, start, seed):
    load = loads(len(requests), seed)
    expected = from_rest(model, requests, start=start, load=load)
    angles = simulate(model, requests, cyclic=False, start=start, load=load)
    np.testing.assert_allclose(angles, expected, rtol=0.0, atol=SAME)


STEADY = st.one_of(
    models(friction=True, poses=True), models(friction=True, inertia=True, overshoots=False)
)


@settings(max_examples=60)
@given(STEADY, trajectories(least=2), st.integers(0, 9))
def test_a_cycle_with_friction_and_inertia_is_followed_by_itself(model, requests, seed):
    load = loads(len(requests), seed)
    torques = load_by_period(load, cyclic=True)
    motion = motion_under(model, requests, cyclic=True, torques=torques)
    following = next_cycle(model, requests, motion[0, -1], load=load, moving=motion[1:, -1])
    np.testing.assert_allclose(following, motion[0], rtol=0.0, atol=2.0 * CLOSED + SAME)


def test_the_request_that_holds_an_angle_holds_it_in_the_middle_of_the_dead_band():
    request = DRY.request_at(0.7, 0.4)
    assert np.all(simulate(DRY, np.full(9, request), load=0.4) == pytest.approx(0.7, abs=1e-15))
    for aside in (-0.99, 0.99):
        requests = np.full(60, request + aside * DRY.dead_band)
        moved = simulate(DRY, requests, cyclic=False, start=0.7, load=0.4)
        np.testing.assert_allclose(moved, 0.7, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("hold", [1, 3])
@pytest.mark.parametrize("smoothing", [0.0, 0.01, 0.4])
@pytest.mark.parametrize("inert", ["", *INTEGRALS])
def test_rounded_periods_and_derivatives_are_those_that_casadi_writes(smoothing, hold, inert):
    rng = np.random.default_rng([3, hold])
    samples = 9
    plain = random_model(rng, whole=False, hold=hold, offset=True)
    sags = {"sag_sin": 0.3 * plain.theta_0, "sag_cos": -0.4 * plain.theta_0}
    for model, load_ in (
        (random_dry_model(rng, whole=False, hold=hold, offset=True), loads(samples)),
        (plain, None),
        (replace(plain, **sags), None),
        (
            replace(random_dry_model(rng, whole=False, hold=hold, offset=True), **sags),
            loads(samples),
        ),
    ):
        model = with_inertia(rng, model, inert) if inert else model
        own = acting_requests(model)
        before = rng.uniform(-1.0, 1.0, samples)
        size = model.states
        moving = rng.uniform(-1.0, 1.0, (max(size, 2) - 1, samples)) * model.v_max_per_tick
        errors = rng.uniform(-2.0, 2.0, (samples, own.width)) * model.theta_0
        windows = before[:, np.newaxis] + errors - model.offset
        compiled = rounded_periods(model, before, windows, smoothing, moving=moving, load=load_)
        begin, load = casadi.SX.sym("state", size), casadi.SX.sym("load")
        requests, radius = casadi.SX.sym("requests", own.width), casadi.SX.sym("radius")
        state = period_function(model)(begin, requests, load, radius)
        slopes = [casadi.jacobian(state, begin), casadi.jacobian(state, requests)]
        written = casadi.Function("period", [begin, requests, load, radius], [state, *slopes])
        for k in range(samples):
            torque = 0.0 if load_ is None else load_[k]
            # A corner that is not rounded at all has no derivative; none is met here.
            rounding = max(smoothing * model.theta_0, 1e-150)
            state_ = [before[k], *moving[:, k]][:size]
            answers = written(state_, windows[k], torque, rounding)
            reached, by_state, by_request = (np.asarray(answer) for answer in answers)
            np.testing.assert_allclose(
                compiled.states[k, :size], reached[:, 0], rtol=0.0, atol=1e-13
            )
            np.testing.assert_allclose(
                compiled.by_state[k, :size, :size], by_state, rtol=0.0, atol=1e-12
            )
            np.testing.assert_allclose(
                compiled.by_request[k, :size], by_request, rtol=0.0, atol=1e-12
            )


def with_inertia(rng, model, integral="integral_rate"):
    """The joint with a time constant, an acceleration limit, and half of them an integral."""
    inert = replace(model, time_constant=rng.uniform(0.5, 4.0) * model.tick)
    slower = inert.time_constant / model.tick - 1.0 / model.law.gain
    rate = rng.uniform(0.02, min(0.2, 0.5 / max(slower, 1.0)))  # so that it comes to rest
    if rng.random() < 0.5:  # with little friction: else it may stick and slip for ever
        slight = min(model.dead_band, 0.1 * model.theta_0)
        rate = min(rate, 0.5 * inert.law.share) if integral != "integral_rate" else rate
        inert = replace(inert, **{integral: rate / model.tick}, dead_band=slight)
    slowed = inert.law.share * inert.law.friction / model.tick**2  # in a tick, by dry friction
    most = slowed + rng.uniform(0.2, 1.0) * model.v_max / model.tick
    return replace(inert, max_acceleration=most)
