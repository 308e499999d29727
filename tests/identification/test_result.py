"""The cloud of Figure 5: dots of a joint without noise lie on f wherever they can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.identification.excitation import excite
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.identification.result import LogFit, speed_against_error
from planner.model.joint import JointModel
from planner.model.response import simulate
from tests.identification.made import identified_rich, identified_steps

ON_THE_LINE = 1e-9
"""With a row every tick a dot is Equation 3 itself, up to rounding [share of the top speed]."""

OFF_THE_LINE = 0.1
"""A lag that is wrong by two thirds of a window moves dots by far more than this."""

MODEL = JointModel(
    v_max=4.0, theta_0=0.25, lag=0.0173, acceleration_time=0.041, tick=0.004, offset=0.03
)


def fit_of(model, kind="random_steps", *, used=None, late=0.0):
    signal = excite(kind, limits=(-0.6, 0.8), period=model.period, duration=12.0)
    log = Log(
        times=late + signal.times,
        requests=signal.requests,
        angles=simulate(model, signal.requests, cyclic=False),
    )
    rows = np.ones(len(log.times), dtype=bool) if used is None else used(log)
    nothing = np.zeros(len(rows))
    return LogFit(
        log=log,
        used=rows,
        predicted=log.angles,
        held_out=nothing.astype(bool),
        held_out_predicted=nothing * np.nan,
        weights=nothing + 1.0,
        rms=0.0,
    )


@pytest.mark.parametrize("kind", ["random_steps", "multisine", "triangle"])
def test_dots_lie_on_f_unless_their_window_is_on_both_sides_of_a_corner(kind):
    cloud = speed_against_error(MODEL, fit_of(MODEL, kind))
    expected = MODEL.speed(cloud.errors)
    off = np.abs(cloud.speeds - expected) / MODEL.v_max
    assert np.max(off[~cloud.apart]) < ON_THE_LINE
    assert np.mean(cloud.apart) < 0.5


def test_saturated_dots_are_at_the_top_speed_and_there_are_some():
    cloud = speed_against_error(MODEL, fit_of(MODEL))
    assert np.sum(cloud.saturated) > 50
    np.testing.assert_allclose(np.abs(cloud.speeds[cloud.saturated]), MODEL.v_max, rtol=1e-9)
    assert not np.any(cloud.saturated & cloud.apart)


def test_a_wrong_lag_takes_the_dots_off_the_line():
    wrong = JointModel(
        v_max=4.0, theta_0=0.25, lag=0.0573, acceleration_time=0.041, tick=0.004, offset=0.03
    )
    cloud = speed_against_error(wrong, fit_of(MODEL, "multisine"))
    expected = MODEL.speed(cloud.errors)
    off = np.abs(cloud.speeds - expected) / MODEL.v_max
    assert np.max(off[~cloud.apart]) > OFF_THE_LINE


def test_only_intervals_between_used_rows_have_a_dot():
    fit = fit_of(MODEL, used=lambda log: (log.times > 2.0) & (log.times < 4.0))
    assert len(speed_against_error(MODEL, fit).errors) == np.sum(fit.used) - 1


def test_the_clock_of_a_log_may_start_anywhere():
    now, later = (speed_against_error(MODEL, fit_of(MODEL, late=late)) for late in (0.0, 1000.0))
    np.testing.assert_allclose(later.errors, now.errors, atol=1e-8)


def test_the_delay_after_steps_is_as_uncertain_as_the_covariance_of_its_parameters_says():
    found, model = identified_steps(), identified_steps().model
    ways = {
        "v_max": -model.theta_0 / model.v_max**2,
        "theta_0": 1.0 / model.v_max,
        "lag": 1.0,
        "acceleration_time": 0.5,
    }
    way = np.array([ways.get(name, 0.0) for name in found.intervals])
    half = 1.96 * np.sqrt(way @ found.covariance @ way)
    # Intervals follow the loss where it is no parabola, by a few percent here.
    assert found.tested.delay_error == pytest.approx(half, rel=0.1)


@pytest.mark.parametrize(
    ("share", "tested"), [(0.0, False), (0.01, False), (0.1, True), (1.0, True)]
)
def test_the_delay_is_tested_where_requests_move_during_enough_of_the_travel(share, tested):
    found = identified_steps()
    times = 0.008 * np.arange(5000)
    angles = 0.4 * np.abs(np.mod(times, 4.0) - 2.0)
    requests = np.where(times < share * 40.0, angles, 0.0)
    log = Log(times=times, requests=requests, angles=angles)
    used = np.ones(len(times), dtype=bool)
    fit = replace(found.fits[0], log=log, used=used, predicted=angles)
    assert (replace(found, fits=(fit,)).tested.delay_error == 0.0) is tested


def test_a_joint_was_as_fast_as_in_rows_that_are_not_fitted():
    """A recording that begins with a large step, whose request came before it, and is slow then."""
    joint = JointModel(
        v_max=6.14, theta_0=0.35, lag=0.02, acceleration_time=0.06, tick=1.0 / 150.0, hold=5
    )
    times = np.arange(373) / 30.0
    asked = np.radians(20.0 * np.sin(0.9 * times) + 8.0 * np.sin(2.1 * times + 1.0))
    requests = asked - asked[0] + np.radians(42.0)
    angles = np.append(0.0, simulate(joint, requests, cyclic=False, start=0.0)[:-1])
    noise = np.radians(0.05) * np.random.default_rng(3).standard_normal(len(times))
    log = Log(times=times, requests=requests, angles=angles + noise)
    found = identify(log, hold_out=False)
    fast = np.max(angles[3:] - angles[:-3]) / 0.1
    assert found.intervals["v_max"].lower >= 0.95 * fast > 4.0
    assert found.intervals["v_max"].upper == np.inf
    assert found.model.v_max >= found.intervals["v_max"].lower
    (fit,) = found.fits
    (reason,) = fit.left_out
    assert reason == "on which requests before the log act"
    assert fit.left_out == {reason: int(np.sum(~fit.used))}
    assert found.to_dict()["logs"][0]["left_out"] == fit.left_out
    words = f"not fitted: {fit.left_out[reason]} {reason}"
    assert any(words in warning for warning in found.warnings)


def test_the_error_to_expect_is_the_larger_one_of_all_rows_and_of_those_held_out():
    found = identified_rich()
    for held_out, expected in ((2.0 * found.rms, 2.0), (0.5 * found.rms, 1.0), (None, 1.0)):
        other = replace(found, held_out_rms=held_out)
        assert other.expected_error == expected * found.rms
        assert other.model.evidence.error == expected * found.rms


def test_rows_that_are_fitted_do_not_bound_a_top_speed_that_others_exceed():
    """A servo whose speed was limited after the first step, whose request came before the log."""
    times = 0.02 * np.arange(700)
    turns = np.random.default_rng(5).choice([-0.8, 0.1, 0.9], 24)
    requests = np.repeat(turns, 30)[: len(times)]
    requests[:30] = 1.2
    fast = JointModel(v_max=6.0, theta_0=0.2, lag=0.02, acceleration_time=0.06, tick=0.02)
    start = simulate(fast, requests[:30], cyclic=False, start=-1.2)
    limited = replace(fast, v_max=2.0, theta_0=0.2 / 3.0)
    slow = simulate(limited, requests[29:], cyclic=False, start=float(start[-1]))
    angles = np.append(-1.2, np.concatenate([start[:-1], slow]))[: len(times)]
    noise = np.radians(0.05) * np.random.default_rng(3).standard_normal(len(times))
    found = identify(Log(times=times, requests=requests, angles=angles + noise))
    assert not found.fits[0].used[0]
    assert found.model.v_max >= 0.9 * np.max(np.diff(angles)) / 0.02
    assert found.intervals["v_max"].lower >= 0.9 * 6.0
    assert found.intervals["v_max"].upper == np.inf
    (warning,) = [words for words in found.warnings if "a limit in the servo" in words]
    assert "deg/s" in warning or "rad/s" in warning
