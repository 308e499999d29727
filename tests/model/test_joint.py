"""The joint's parameters, its window, and the one definition of Equation 2."""

from __future__ import annotations

import math
import re
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from hypothesis import given

from planner.exceptions import InvalidModel
from planner.model.joint import JointModel, joint_of_top_speed
from planner.model.response import simulate
from tests.strategies import models

ROUNDING = 1e-15
"""Disagreement that rounding leaves between two ways to write a sum [relative]."""


def test_a_joint_of_which_only_the_top_speed_is_known_is_the_papers_made_as_fast():
    paper = JointModel.ers210a()
    assert joint_of_top_speed(paper.v_max) == paper
    fast = joint_of_top_speed(3.0 * paper.v_max)
    assert fast.v_max / fast.theta_0 == pytest.approx(paper.v_max / paper.theta_0)
    assert (fast.lag, fast.acceleration_time, fast.tick) == (
        paper.lag,
        paper.acceleration_time,
        paper.tick,
    )


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_a_top_speed_that_is_none_is_refused(speed):
    with pytest.raises(InvalidModel):
        joint_of_top_speed(speed)


def test_table_1_of_the_paper_is_the_ers210a():
    model = JointModel.ers210a()
    assert math.degrees(model.v_max_per_tick) == pytest.approx(2.5)
    assert math.degrees(model.theta_0) == pytest.approx(7.0)
    assert (model.lag_ticks, model.acceleration_ticks) == (4.0, 6.0)
    assert (model.tick, model.hold, model.offset) == (0.008, 1, 0.0)


def test_the_window_of_whole_ticks_is_that_of_equation_3():
    window = JointModel.ers210a().window
    assert (window.first, window.last) == (5, 10)
    np.testing.assert_array_equal(window.weights, np.full(6, 1.0 / 6.0))


@pytest.mark.parametrize(
    ("lag", "acceleration", "first", "lengths"),
    [
        (0.0, 1.0, 1, [1.0]),
        (0.25, 0.5, 1, [0.5]),
        (2.5, 1.0, 3, [0.5, 0.5]),
        (1.75, 3.5, 2, [0.25, 1.0, 1.0, 1.0, 0.25]),
        (3.0, 2.5, 4, [1.0, 1.0, 0.5]),
        (0.5, 0.5, 1, [0.5]),
    ],
)
def test_the_window_of_fractional_ticks_measures_the_overlap(lag, acceleration, first, lengths):
    model = _model(lag=lag * 0.008, acceleration_time=acceleration * 0.008)
    assert model.window.first == first
    np.testing.assert_allclose(
        model.window.weights, np.array(lengths) / acceleration, rtol=0.0, atol=ROUNDING
    )


@given(models())
def test_weights_are_positive_and_sum_to_one(model):
    assert np.all(model.window.weights > 0.0)
    assert model.window.weights.sum() == pytest.approx(1.0, abs=4.0 * ROUNDING)
    assert model.window.first >= 1


@pytest.mark.parametrize("ticks", range(1, 60))
def test_times_that_are_whole_ticks_but_for_rounding_are_taken_as_whole(ticks):
    for tick in (0.008, 0.001, 0.005, 1.0 / 30.0):
        model = _model(tick=tick, lag=tick * ticks, acceleration_time=ticks * tick, theta_0=1.0)
        assert model.lag_ticks == ticks
        assert model.window.first == ticks + 1
        np.testing.assert_array_equal(model.window.weights, np.full(ticks, 1.0 / ticks))


@pytest.mark.parametrize("acceleration_time", [1e-15, 1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("lag", [0.0, 0.032, 0.0333])
def test_an_acceleration_time_near_zero_leaves_one_request_that_counts_in_full(
    lag, acceleration_time
):
    window = _model(lag=lag, acceleration_time=acceleration_time).window
    assert window.weights.tolist() == [1.0]
    assert window.first == math.floor(lag / 0.008 + 1e-9) + 1


def test_the_period_is_the_time_between_requests():
    assert _model(tick=0.005, hold=4).period == pytest.approx(0.02)


def test_a_motor_that_dry_friction_stops_in_every_tick_is_refused():
    sticky = {"dead_band": 0.02, "tick": 0.008, "time_constant": 0.01}
    with pytest.raises(InvalidModel, match=r"^max_acceleration: got .*would never move") as refused:
        _model(max_acceleration=1e-3, **sticky)
    least = float(re.search(r"more than (\S+) rad", str(refused.value))[1])
    moves = _model(max_acceleration=1.01 * least, **sticky)
    assert simulate(moves, np.r_[0.0, np.ones(400)], cyclic=False)[-1] > 0.9
    slow = replace(moves, time_constant=0.0, max_acceleration=1.0)  # of the drive, not of the joint
    assert simulate(slow, np.r_[0.0, np.ones(400)], cyclic=False)[-1] > 0.9


@pytest.mark.parametrize("v_offset", [5.0, -5.0, 6.0])
def test_a_joint_must_be_able_to_move_in_both_directions(v_offset):
    with pytest.raises(InvalidModel, match=r"^v_offset: got .* rad/s, expected within ±v_max = ±5"):
        _model(v_offset=v_offset)


def test_integers_of_numpy_are_numbers_too():
    assert _model(hold=np.int64(3)).hold == 3
    assert type(_model(v_max=np.float32(2.0)).v_max) is float


@pytest.mark.parametrize(
    ("parameters", "window", "hold"),
    [
        ({"acceleration_time": 9.9, "tick": 1e-4}, 99000, 1),
        ({"acceleration_time": 9.9, "tick": 1e-4, "hold": 1000}, 99000, 1000),
        ({"acceleration_time": 0.099, "tick": 1e-6, "lag": 0.0, "hold": 1000}, 99000, 1000),
        ({"acceleration_time": 0.4, "tick": 0.001, "hold": 20}, 400, 20),
    ],
)
def test_a_window_and_a_hold_whose_product_no_simulation_ends_with_are_refused(
    parameters, window, hold
):
    expected = (
        rf"^acceleration_time / tick \* hold: got {window} ticks times {hold} ticks, expected"
    )
    with pytest.raises(InvalidModel, match=expected):
        _model(**parameters)


def test_a_joint_that_would_never_come_to_rest_is_refused():
    with pytest.raises(InvalidModel, match=r"v_max \* tick: got 0.2 rad, expected less than 2"):
        _model(v_max=25.0, theta_0=0.1)
    assert _model(v_max=24.99, theta_0=0.1).theta_0 == 0.1


@pytest.mark.parametrize("constant", [0.0, 0.03])
@pytest.mark.parametrize("parts", [2, 4])
def test_the_same_joint_with_requests_more_often_answers_the_same_motion(constant, parts):
    """To a tenth of a degree and a half: with lag and theta_0 as they were it is a whole one."""
    joint = replace(JointModel.ers210a(), time_constant=constant)
    phase = 2.0 * np.pi * np.arange(125) / 125
    requests = 0.5 * np.sin(phase) + 0.1 * np.sin(3.0 * phase)
    often = joint.requested_every(joint.period / parts)
    angles = simulate(often, np.repeat(requests, parts))[::parts]
    apart = angles - simulate(joint, requests)
    assert np.sqrt(np.mean(apart**2)) <= math.radians(0.15)


def test_a_joint_has_a_request_at_most_every_thousand_ticks():
    joint = _model(hold=2, acceleration_time=0.008)
    assert joint.requested_every(8.0).hold == 1000
    for period in (8.1, 1.5e-6):  # 8 ms are at most 5000 ticks, with the lag 100,000
        with pytest.raises(InvalidModel, match=r"expected one every 1.6e-06 to 8 s"):
            joint.requested_every(period)
    for period in (0.0, -1.0, math.nan, "a"):
        with pytest.raises(InvalidModel, match=r"period: got .*, expected more than 0 s"):
            joint.requested_every(period)


@pytest.mark.parametrize(
    ("theta_0", "acceleration", "keeps"),
    [(0.0401, 4, True), (0.0399, 1, False), (0.0599, 6, False), (0.0601, 6, True)],
)
def test_equation_13_holds_from_a_tick_and_from_a_fourth_of_the_acceleration_time_on(
    theta_0, acceleration, keeps
):
    joint = _model(theta_0=theta_0, acceleration_time=acceleration * 0.008)  # 0.04 rad a tick
    assert joint.keeps_equation_13 is keeps


def test_requests_change_from_line_to_line_by_the_delays_of_the_joint_before_the_angles():
    joint = _model(lag=0.01, acceleration_time=0.03, time_constant=0.02, tick=0.004, hold=3)
    assert joint.switching_time == pytest.approx(0.01 + 0.015 + 0.02 + 0.004)


def test_a_model_is_frozen_hashable_and_equal_by_value():
    model = JointModel.ers210a()
    with pytest.raises(FrozenInstanceError):
        model.lag = 0.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        model.window.weights[0] = 1.0
    assert hash(model) == hash(JointModel.ers210a())
    assert model == JointModel.ers210a()
    assert model != replace(model, offset=0.1)


def _model(**parameters):
    standard = {"v_max": 5.0, "theta_0": 0.12, "lag": 0.032, "acceleration_time": 0.048}
    return JointModel(**{**standard, **parameters})


def test_a_joint_with_friction_and_an_acceleration_limit_starts_alike_with_shorter_ticks():
    """Friction slows a joint by more in shorter ticks, so that its limit has to be larger."""
    joint = JointModel(
        v_max=5.0,
        theta_0=0.25,
        lag=0.02,
        acceleration_time=0.03,
        tick=0.005,
        dead_band=0.005,
        max_acceleration=80.0,
    )
    often = joint.requested_every(0.001)
    angles = simulate(joint, np.full(60, 0.4), cyclic=False, start=0.0)
    others = simulate(often, np.full(300, 0.4), cyclic=False, start=0.0)[4::5]
    assert float(np.max(np.abs(others - angles))) < 0.02
