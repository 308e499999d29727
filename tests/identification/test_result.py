"""What an identification says of its error, of requests that move, and of the top speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.identification.identify import identify
from planner.identification.log import Log
from planner.model.joint import JointModel
from planner.model.response import simulate
from tests.identification.made import identified_rich, identified_steps


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
    rows = {"used": used, "held_out": ~used, "predicted": angles, "held_out_predicted": angles}
    fit = replace(found.fits[0], log=log, **rows)
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
    calm = slice(100, None)
    slow = Log(times=times[calm], requests=log.requests[calm], angles=log.angles[calm], name="slow")
    found = identify([log, slow], hold_out=False)
    fast = np.max(angles[3:] - angles[:-3]) / 0.1
    assert found.intervals["v_max"].lower >= 0.95 * fast > 4.0
    assert found.intervals["v_max"].upper == np.inf
    assert found.model.v_max >= found.intervals["v_max"].lower
    fit, _ = found.fits
    (reason,) = fit.left_out
    assert reason == "on which requests before the log act"
    assert fit.left_out == {reason: int(np.sum(~fit.used))}
    told = found.to_dict()["logs"][0]
    assert (told["rows"], told["used"]) == (len(times), np.sum(fit.used))
    assert told["left_out"] == fit.left_out
    words = f"not fitted: {fit.left_out[reason]} {reason}"
    (warning,) = [each for each in found.warnings if "its least top speed" in each]
    assert words in warning  # and nothing of the other log


def test_the_error_to_expect_is_the_larger_one_of_all_rows_and_of_those_held_out():
    found = identified_rich()
    for held_out, expected in ((2.0 * found.rms, 2.0), (0.5 * found.rms, 1.0), (None, 1.0)):
        other = replace(found, held_out_rms=held_out)
        assert other.expected_error == expected * found.rms
        told = (found.rms, "the rows it was fitted to") if held_out is None else (held_out, "rows")
        assert f"{told[0]:.3g} rad rms on {told[1]}" in repr(other)
        assert other.model.evidence.error == expected * found.rms


def test_what_a_model_gains_over_a_delay_is_told_by_rows_held_out():
    found = identified_rich()
    (delay,) = [each.held_out_rms for each in found.alternatives if each.name == "delay"]
    for factor in (1.0, 3.0):
        other = replace(found, held_out_rms=factor * found.held_out_rms)
        expected = factor * found.held_out_rms / delay
        assert other.tested.over_delay == pytest.approx(expected, rel=1e-3)
    assert np.isnan(replace(found, held_out_rms=None).tested.over_delay)


def test_the_error_by_motion_is_that_of_rows_held_out():
    """By the model of the other rows and, as much, by that of all rows, which is planned with."""
    found = identified_rich()
    (fit,) = found.fits
    beside = np.where(fit.held_out, fit.log.angles + 0.05, np.nan)
    for final in (0.05, 0.0008):
        whole = replace(fit, held_out_predicted=beside, predicted=fit.log.angles - final)
        off = replace(found, fits=(whole,), noise=0.0)
        told = [error for _, error in off.tested.by_acceleration]
        assert told == pytest.approx(len(told) * [np.sqrt(0.05 * final)], rel=1e-3)
    none = np.zeros(len(beside), dtype=bool)
    alone = replace(found, fits=(replace(fit, held_out=none),), noise=0.0)
    assert max(error for _, error in alone.tested.by_acceleration) <= 2.0 * fit.rms
