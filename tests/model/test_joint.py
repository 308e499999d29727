"""The joint's parameters, its window, and the one definition of Equation 2."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from planner import InvalidModel, JointModel, simulate

ROUNDING = 1e-15  # disagreement that rounding leaves between two ways to write a sum [relative]


def test_the_ers210a_is_table_1():
    model = JointModel.ers210a()
    assert math.degrees(model.v_max_per_tick) == pytest.approx(2.5)
    assert math.degrees(model.theta_0) == pytest.approx(7.0)
    assert (model.lag_ticks, model.acceleration_ticks) == (4.0, 6.0)
    assert (model.tick, model.hold, model.offset) == (0.008, 1, 0.0)


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


def test_a_joint_that_would_never_move_or_never_come_to_rest_is_refused():
    sticky = {"dead_band": 0.02, "tick": 0.008, "time_constant": 0.01}
    with pytest.raises(InvalidModel, match=r"^max_acceleration: got .*would never move") as refused:
        _model(max_acceleration=1e-3, **sticky)
    least = float(re.search(r"more than (\S+) rad", str(refused.value))[1])
    moves = _model(max_acceleration=1.01 * least, **sticky)
    assert simulate(moves, np.r_[0.0, np.ones(400)], cyclic=False)[-1] > 0.9
    slow = replace(moves, time_constant=0.0, max_acceleration=1.0)  # of the drive, not of the joint
    assert simulate(slow, np.r_[0.0, np.ones(400)], cyclic=False)[-1] > 0.9
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
    followed = replace(joint, integral_rate=12.0)  # an integral makes up for the time constant
    assert followed.switching_time == pytest.approx(0.01 + 0.015 + 0.004)


def _model(**parameters):
    standard = {"v_max": 5.0, "theta_0": 0.12, "lag": 0.032, "acceleration_time": 0.048}
    return JointModel(**{**standard, **parameters})
