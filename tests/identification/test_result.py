"""What an identification says of its error, of requests that move, and of the top speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

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
