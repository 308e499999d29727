"""The integral terms of a servo under gravity and torque: they make up for both, in their time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import JointModel, line_offset, simulate
from planner.model.law import State, fastest_integral
from planner.model.response import motion_under, rest_angles, rest_requests
from tests.model.test_symbolic import chained
from tests.strategies import INTEGRALS, models, trajectories

SAME = 1e-12
"""Two ways to run the same recursion over a few hundred ticks agree to this [rad]."""

BARE = JointModel(
    v_max=5.0,
    theta_0=0.25,
    lag=0.01,
    acceleration_time=0.01,
    tick=0.005,
    hold=2,
    offset=0.1,
    time_constant=0.03,
)

LOADED = replace(BARE, sag_sin=-0.06, sag_cos=0.02, compliance=0.05, speed_per_torque=1.0)
"""A joint that gravity pulls away, and a torque, whose physics is that of gravity."""

RATES = {"integral_rate": 8.0, "position_integral_rate": 4.0}

EACH = pytest.mark.parametrize("name", INTEGRALS)


def servo(name, model=LOADED):
    """The joint with an integral."""
    return replace(model, **{name: RATES[name]})


@EACH
def test_at_rest_the_joint_is_at_its_request(name):
    model, load = servo(name), 0.7
    angles = simulate(model, np.full(40, 0.3), cyclic=False, load=load)
    np.testing.assert_allclose(angles, 0.4, rtol=0.0, atol=1e-12)  # with its offset
    assert model.rest(0.3, load) == pytest.approx(0.4)
    assert rest_requests([model], np.array([[0.4]]), [np.array([load])]) == pytest.approx(0.3)
    assert rest_angles([model], np.array([[0.3]]), [np.array([load])]) == pytest.approx(0.4)
    assert float(model.sag(load) + model.pose_sag(0.4)) == pytest.approx(0.1)
    _, _, integrals = motion_under(model, np.full(40, 0.3), cyclic=False, torques=np.full(40, load))
    sag = LOADED.pose_sag(0.4) + LOADED.compliance * load
    np.testing.assert_allclose(integrals, -model.gain_per_tick * sag, rtol=1e-12)
    assert float(model.rest_integral(0.4, load)) == pytest.approx(integrals[0])


@EACH
@pytest.mark.parametrize("cyclic", [True, False])
def test_a_torque_pulls_the_joint_away_for_a_time(name, cyclic):
    model = servo(name)
    load = np.repeat([0.0, 1.0], 400)
    requests = np.zeros(800)
    angles = simulate(model, requests, cyclic=cyclic, load=load) - model.offset
    assert np.max(angles) >= 0.25 * model.compliance
    assert abs(angles[-1]) <= 1e-4
    assert abs(angles[399]) <= 1e-4


@given(
    models(inertia=True, friction=True, integrals=INTEGRALS, poses=True, holds=(1, 1)),
    trajectories(least=2, most=12),
)
def test_gravity_is_the_torque_of_the_same_size(model, requests):
    model = replace(model, compliance=0.0, speed_per_torque=0.0, v_offset=0.0)
    angles = simulate(model, requests, cyclic=False)
    before = np.concatenate([model.rest(requests[:1]), angles[:-1]])
    torque = model.gravity(before) / 0.1
    pulled = replace(
        model,
        sag_sin=0.0,
        sag_cos=0.0,
        compliance=0.1,
        speed_per_torque=0.1 * model.v_max / model.theta_0,
    )
    if np.max(np.abs(model.gravity(before))) < 0.9 * model.theta_0:  # else it is refused
        start = float(before[0])
        by_torque = motion_under(pulled, requests, cyclic=False, start=start, torques=torque)[0]
        np.testing.assert_allclose(by_torque, angles, rtol=0.0, atol=SAME)


@given(
    models(inertia=True, friction=True, integrals=INTEGRALS, poses=True),
    trajectories(least=2, most=12),
    st.integers(0, 9),
)
def test_periods_in_symbols_in_a_row_are_the_simulation(model, requests, seed):
    load = np.random.default_rng(seed).uniform(-1.0, 1.0, len(requests))
    rest = float(model.rest(requests[0], load[0]))
    begin = State(rest, 0.0, float(model.rest_integral(rest, load[0])))
    run = chained(model, requests, begin, cyclic=False, load=load)
    angles = simulate(model, requests, cyclic=False, load=load)
    np.testing.assert_allclose(run, angles, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("slope", [0.0, 0.4, -0.4])
@pytest.mark.parametrize("inside", [True, False])
def test_an_integral_is_refused_from_where_the_joint_oscillates_on(inside, slope):
    """The eigenvalues of a tick near rest, of angle, speed and integral."""
    for gain in (0.02, 0.3, 1.2):
        for share in (0.1, 0.6):
            most = fastest_integral(gain, share, inside=inside, slope=slope)
            for rate, stable in ((0.99 * most, True), (1.01 * most, False)):
                speed = np.array([-share * gain * (1.0 - slope), 1.0 - share, share])
                angle = np.array([1.0, 0.0, 0.0]) + speed
                fed = np.array([-gain, 0.0, 0.0]) - (0.0 if inside else speed)
                integral = np.array([0.0, 0.0, 1.0]) + rate * fed
                largest = np.max(np.abs(np.linalg.eigvals([angle, speed, integral])))
                if most < 1.0 or stable:
                    assert (largest < 1.0) == stable


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_speed_loop_reaches_its_top_speed_against_any_load(way):
    model = servo("integral_rate")
    far = simulate(model, np.r_[0.0, np.full(400, 90.0 * way)], cyclic=False, load=-2.0)
    falling = replace(model, sag_sin=0.0, sag_cos=0.0)
    steady = simulate(falling, np.r_[0.0, np.full(400, 90.0 * way)], cyclic=False, load=-2.0)
    assert np.diff(steady)[-1] / model.period == pytest.approx(5.0 * way, rel=1e-6)
    assert np.mean(np.diff(far)[200:]) / model.period == pytest.approx(5.0 * way, rel=0.02)
    low, high = model.speed_limits(-2.0, 0.3)
    assert (float(low), float(high)) == pytest.approx((-5.0, 5.0))
    assert line_offset(model, 4.9 * way, load=-2.0) == pytest.approx(line_offset(model, 4.9 * way))
