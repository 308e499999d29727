"""The joint's answer from rest and in a cycle, in numbers and in CasADi's symbols."""

import math
import re
from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import InvalidModel, JointModel, NoSteadyCycle, line_offset, simulate
from planner.model.joint import acting_requests
from planner.model.response import motion_under, path_speeds
from planner.model.symbolic import period_function
from tests.independent import next_cycle, of_whole_ticks
from tests.instances import ERS210A, joint_of
from tests.strategies import INTEGRALS, models, trajectories

SAME = 1e-12  # two ways to run the same recursion over a few hundred ticks agree to this [rad]
SETTLED = 1e-9  # distance of two cycles in a row that counts as none [rad]
BARE = joint_of(5.0, 0.25, 0.01, 0.01, tick=0.005, hold=2, offset=0.1, time_constant=0.03)

LOADED = replace(BARE, sag_sin=-0.06, sag_cos=0.02, compliance=0.05, speed_per_torque=1.0)
"""A joint that gravity pulls away, and a torque, whose physics is that of gravity."""

RATES = {"integral_rate": 8.0, "position_integral_rate": 4.0}
EACH = pytest.mark.parametrize("name", INTEGRALS)


@given(models(whole=True, holds=(1, 1), offsets=False), trajectories(), st.floats(-1.0, 1.0))
def test_whole_ticks_are_equation_3_to_the_letter(model, requests, start):
    expected = of_whole_ticks(model, requests, start)
    angles = simulate(model, requests, cyclic=False, start=start)
    np.testing.assert_allclose(angles, expected, rtol=0.0, atol=SAME)


def test_a_cycle_that_only_drifts_settles_where_the_requests_balance():
    requests = np.repeat([50.0, -50.0], [45, 43])  # radians: 2 ticks of drift in every 88
    angles = simulate(ERS210A, requests)
    np.testing.assert_allclose(next_cycle(ERS210A, requests, angles[-1]), angles, atol=1e-9)
    assert np.max(angles) == pytest.approx(50.0, abs=1.0)


def test_requests_without_a_steady_cycle_in_reach_are_an_error_with_the_mismatch():
    """Its acceleration limit makes the joint ring for ever."""
    terms = {"tick": 0.001, "hold": 20, "dead_band": 0.016, "max_acceleration": 22.0}
    joint = joint_of(5.25, 0.247, 0.01, 0.02, **terms)
    turns = 2.0 * np.pi * np.arange(11, 51) / 40
    requests = np.radians(
        18.0 * np.sin(turns) + 5.0 * np.sin(2.0 * turns + 1.0) + 3.0 * np.sin(3.0 * turns + 2.0)
    )
    with pytest.raises(NoSteadyCycle, match="no steady cycle after 200 cycles") as caught:
        simulate(joint, requests)
    assert caught.value.cycles == 200
    assert 1e-9 < caught.value.mismatch < 1.0


def test_a_path_is_too_fast_by_the_top_speed_of_its_direction_under_its_load():
    """1 rad/s faster up than down, and 0.5 rad/s faster under the half of 1 N m in a step."""
    joint = joint_of(4.0, 0.5, 0.0, 0.1, tick=0.1, v_offset=0.5, speed_per_torque=1.0)
    path = np.array([0.0, 0.4, 0.0, 0.5])
    found = path_speeds(joint, path, cyclic=True, load=np.array([0.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(found.speeds, [4.0, -4.0, 5.0, -5.0], atol=1e-12)
    np.testing.assert_allclose(found.limits, [4.5, -3.5, 5.0, -3.0], atol=1e-12)
    assert found.too_fast.tolist() == [False, True, False, True]
    assert found.highest == pytest.approx((5.0, 3.0))
    steady = path_speeds(joint, 0.45 * np.arange(9), cyclic=False)
    assert not steady.too_fast.any()


def ringing_joints():
    """Joints of little damping that saturate, with requests that may have several cycles."""
    rng = np.random.default_rng(1)
    for _ in range(300):
        v_max, gain = rng.uniform(2.0, 7.0), rng.uniform(15.0, 120.0)
        terms = {"time_constant": rng.uniform(0.02, 0.12), "tick": 0.002, "hold": 10}
        terms |= {"max_acceleration": rng.uniform(20, 200), "integral_rate": rng.choice([0.0, 3.0])}
        model = joint_of(v_max, v_max / gain, 0.01, 0.002, **terms)
        turn, size = np.linspace(0.0, 2.0 * np.pi, rng.integers(8, 60)), rng.uniform(0.05, 0.5)
        yield model, size * (np.sin(turn[:-1]) + 0.3 * np.sin(3.0 * turn[:-1] + 1.0))


def test_the_cycle_is_the_one_into_which_the_motion_from_rest_settles():
    settled = elsewhere = 0
    for model, requests in ringing_joints():
        run = simulate(model, np.tile(requests, 150), cyclic=False).reshape(150, -1)
        if np.max(np.abs(run[-1] - run[-2])) <= SETTLED:
            settled += 1
            elsewhere += np.max(np.abs(simulate(model, requests) - run[-1])) > 100.0 * SETTLED
    assert settled >= 200
    assert elsewhere <= 0.01 * settled  # Newton's method alone leads elsewhere in a tenth


@pytest.mark.parametrize("sag", [0.0, 0.06])
@pytest.mark.parametrize("dead_band", [0.0, 0.02])
@pytest.mark.parametrize("name", INTEGRALS)
def test_a_joint_comes_to_rest_up_to_the_integral_that_is_refused(name, dead_band, sag):
    known = {"v_max": 5.0, "theta_0": 0.1, "lag": 0.0, "acceleration_time": 0.004, "tick": 0.004}
    known |= {"time_constant": 0.05, "dead_band": dead_band}
    known |= {"sag_sin": sag * math.cos(1.0), "sag_cos": -sag * math.sin(1.0)}  # steepest at 1
    with pytest.raises(InvalidModel, match=rf"^{name}: got 50 1/s, .*oscillate") as refused:
        JointModel(**known, **{name: 50.0})
    most = float(re.search(r"less than (\S+) 1/s", str(refused.value))[1])
    slower = JointModel(**known, **{name: 0.9 * most})
    angles = simulate(slower, np.r_[0.0, np.ones(4000)], cyclic=False)
    assert angles[-1] == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(InvalidModel, match="without a time_constant"):
        replace(slower, time_constant=0.0)


@pytest.mark.parametrize("name", INTEGRALS)
def test_an_integral_follows_lines_without_friction(name):
    """That of a position controller leaves only the lag."""
    known = {"v_max": 5.0, "theta_0": 0.3, "lag": 0.01, "acceleration_time": 0.004, "tick": 0.002}
    model = JointModel(**known, time_constant=0.03, dead_band=0.02, **{name: 5.0})
    line = 1.5 * model.tick * np.arange(3000)
    behind = line - simulate(model, line, cyclic=False)
    offset = line_offset(model, 1.5)
    assert offset == line_offset(replace(model, dead_band=0.0), 1.5)
    assert behind[-1] == pytest.approx(offset if name == "integral_rate" else 0.0165, abs=1e-6)


def servo(name, model=LOADED):
    return replace(model, **{name: RATES[name]})


@EACH
def test_at_rest_the_joint_is_at_its_request(name):
    model, load = servo(name), 0.7
    angles = simulate(model, np.full(40, 0.3), cyclic=False, load=load)
    np.testing.assert_allclose(angles, 0.4, rtol=0.0, atol=1e-12)  # with its offset
    _, _, integrals = motion_under(model, np.full(40, 0.3), cyclic=False, torques=np.full(40, load))
    sag = LOADED.pose_sag(0.4) + LOADED.compliance * load
    np.testing.assert_allclose(integrals, -model.law.gain * sag, rtol=1e-12)
    assert model.at_rest(0.4, load)[2] == pytest.approx(integrals[0])


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


@given(models(), st.integers(0, 2**32 - 1))
def test_every_request_said_to_act_acts_and_no_younger_one_does(model, seed):
    at = acting_requests(model)
    rng = np.random.default_rng(seed)
    # Small errors leave every term of the window unsaturated, so that each of them counts.
    windows = rng.uniform(-0.01, 0.01, size=(1, at.width)) * model.theta_0 - model.offset
    symbols = casadi.SX.sym("state", model.states), casadi.SX.sym("requests", at.width)
    reached = period_function(model)(*symbols, 0.0, 1e-9)
    by_request = casadi.jacobian(reached[0], symbols[1])
    slopes = casadi.Function("slopes", symbols, [by_request])(0.0, windows)
    assert np.all(np.asarray(slopes) != 0.0)

    k = at.oldest + 1
    requests = rng.uniform(-1.0, 1.0, size=k + 1)
    changed = requests.copy()
    changed[k - at.youngest + 1 :] += 1.0
    before = simulate(model, requests, cyclic=False)[k]
    assert simulate(model, changed, cyclic=False)[k] == before
