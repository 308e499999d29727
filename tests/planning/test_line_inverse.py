"""Both rules for C_m: Equations 10-12 written out once more, and the joint on the line itself."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import InvalidInput, OutsideEquation13, line_offset
from planner.planning.line_inverse import advanced, interpolated_offset
from tests.independent import windowed
from tests.instances import ERS210A, TICK, joint_of, random_model_outside_equation_13
from tests.strategies import models

STEADY = 1e-9  # steady error that the exact rule may leave [rad]
FRICTIONAL = replace(
    ERS210A, dead_band=0.03, v_offset=0.4, compliance=0.05, speed_per_torque=1.1, offset=0.01
)


def equations_10_to_12(model, slope):
    """C_m of the appendix for a slope m in [0, v_max) [rad/tick]."""
    v_max, theta_0 = model.v_max * model.tick, model.theta_0
    lag, acceleration = model.lag / model.tick, model.acceleration_time / model.tick
    if slope * (theta_0 / v_max + acceleration / 2) < theta_0:
        return slope * (theta_0 / v_max + lag + acceleration / 2)
    root = math.sqrt(2 * theta_0 / slope * acceleration * (v_max - slope) / v_max)
    return theta_0 + slope * (lag + acceleration - root)


def steady_error(model, slope, offset, *, ticks=40, load=0.0):
    """How far the joint is driven off a line that it is on, under requests line + offset [rad]."""
    per_tick = slope * model.tick

    def request_at(tick):  # tick 0 comes after a sample with the joint on the line, at 0
        return per_tick * ((tick + 1) // model.hold * model.hold) + offset

    every = windowed(model, request_at, ticks * model.hold, 0.0, lambda _: load)
    angles = every[model.hold - 1 :: model.hold]
    return angles - per_tick * model.hold * np.arange(1, ticks + 1)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.5, 0.69, 0.71, 0.9, 0.999])
@pytest.mark.parametrize("kind", ["Aibo", 1, 2, 3, "friction"])
def test_the_papers_rule_is_equations_10_to_12(kind, share):
    """With the top speed of the direction, beside the dead band and less the sag."""
    known = {"Aibo": ERS210A, "friction": FRICTIONAL}
    model = known[kind] if kind in known else _inside_equation_13(np.random.default_rng(kind))
    for load in (0.0, 0.4, -0.4) if kind == "friction" else (0.0,):
        low, high = model.speed_limits(load)
        for sign, top in ((1.0, float(high)), (-1.0, -float(low))):
            one_way = replace(model, v_max=top, theta_0=model.theta_0 * top / model.v_max)
            expected = equations_10_to_12(one_way, share * top * model.tick) + model.dead_band
            answer = line_offset(model, sign * share * top, rule="paper", load=load)
            assert answer == pytest.approx(sign * expected - float(model.sag(load)), rel=1e-12)


def test_at_v_max_the_papers_rule_takes_the_papers_threshold():
    threshold = ERS210A.theta_0 + 10 * ERS210A.v_max_per_tick
    assert line_offset(ERS210A, ERS210A.v_max, rule="paper") == pytest.approx(threshold, rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_the_papers_rule_warns_outside_equation_13(seed):
    model = random_model_outside_equation_13(np.random.default_rng(seed))
    told = (
        f"which this joint breaks: theta_0 = {model.theta_0:.4g} rad, v_max = "
        f"{model.v_max * model.tick:.4g} rad/tick, a = {model.acceleration_time / model.tick:.4g} "
        "ticks; rule='exact' holds"
    )
    with pytest.warns(OutsideEquation13, match=re.escape(told)):
        line_offset(model, 0.5 * model.v_max, rule="paper")


@given(models(), st.floats(0.0, 1.0))
def test_the_exact_offset_is_the_smallest_that_keeps_the_joint_on_the_line(model, share):
    slope = share * model.v_max
    error = steady_error(model, slope, line_offset(model, slope) - 1e-6, ticks=1)
    assert error[0] < -1e-12  # some request of the window is unsaturated and the joint falls behind


@pytest.mark.parametrize("rule", ["paper", "exact"])
def test_an_array_of_slopes_is_answered_one_by_one(rule):
    slopes = np.linspace(-1.0, 1.0, 12).reshape(3, 4) * ERS210A.v_max
    offsets = line_offset(ERS210A, slopes, rule=rule)
    assert offsets.shape == (3, 4)
    one_by_one = [line_offset(ERS210A, float(slope), rule=rule) for slope in slopes.ravel()]
    assert all(isinstance(offset, float) for offset in one_by_one)
    np.testing.assert_allclose(offsets.ravel(), one_by_one, rtol=0.0, atol=1e-14)
    assert line_offset(ERS210A, np.array([]), rule=rule).shape == (0,)


def _inside_equation_13(rng):
    v_max, acceleration = rng.uniform(0.02, 0.05), rng.uniform(1.0, 9.0)
    theta_0 = v_max * max(1.1, acceleration / 4.0) * rng.uniform(1.05, 3.0)
    lag = rng.uniform(0.0, 7.0) * TICK
    return joint_of(v_max / TICK, theta_0, lag, acceleration * TICK, tick=TICK)


@settings(max_examples=60)
@given(
    st.one_of(models(), models(friction=True)),
    st.floats(-1.0, 1.0),
    st.one_of(st.floats(-1.0, 1.0), st.sampled_from([0.0, 1.0, -1.0, 1e-4, -1e-4])),
)
def test_the_exact_rule_keeps_any_joint_on_the_line(model, load, share):
    low, high = model.speed_limits(load)
    slope = share * float(high if share > 0.0 else -low)
    error = steady_error(model, slope, line_offset(model, slope, load=load), load=load)
    assert np.max(np.abs(error)) < STEADY


def test_the_slopes_end_at_the_top_speed_of_either_direction():
    low, high = (float(limit) for limit in FRICTIONAL.speed_limits(0.4))
    line_offset(FRICTIONAL, [low, high], load=0.4)
    for slope in (1.01 * low, 1.01 * high):
        told = f"slope: got {slope:.6g} rad/s, expected from {low:.6g} rad/s to {high:.6g} rad/s;"
        with pytest.raises(InvalidInput, match=re.escape(told)):
            line_offset(FRICTIONAL, [0.0, slope], load=0.4)
    with pytest.raises(InvalidInput, match=r"load: got .* N m at sample 0, against which"):
        line_offset(FRICTIONAL, 0.1, load=50.0)
    with pytest.raises(InvalidInput, match=r"load: got .*one for every slope"):
        line_offset(FRICTIONAL, [0.1, 0.2], load=[0.1, 0.2, 0.3])


@pytest.mark.parametrize("rule", ["exact", "paper"])
def test_the_table_is_the_offset_of_a_joint_with_friction_and_load(rule):
    slopes = np.linspace(-0.99, 0.99, 331) * FRICTIONAL.v_max * 0.8
    load = 0.4 * np.cos(np.arange(331))
    table = interpolated_offset(FRICTIONAL, slopes, rule=rule, load=load)
    exact = line_offset(FRICTIONAL, slopes, rule=rule, load=load)
    np.testing.assert_allclose(table, exact, rtol=0.0, atol=2e-4 * FRICTIONAL.theta_0)


@pytest.mark.parametrize(("cyclic", "last"), [(True, 1.5), (False, 3.0)])
def test_each_request_knows_the_load_of_the_time_at_which_it_acts(cyclic, last):
    load = advanced(np.arange(4.0), 0.5, cyclic=cyclic)
    np.testing.assert_allclose(load, [0.5, 1.5, 2.5, last])
