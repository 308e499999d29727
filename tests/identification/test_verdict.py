"""Held-out rows are predicted, alternatives compared, and a joint that is no such joint refused."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from planner.identification.intervals import intervals_of
from planner.identification.judgement import verdict_on
from planner.identification.result import HeldOut
from tests.identification.made import (
    NOISE,
    fitted_rich,
    identified_rich,
    identified_steps,
    rich_log,
)

WHITE = 1.3  # a good fit leaves little more than the noise, by this factor


def test_what_was_held_out_is_predicted_to_the_noise():
    log, found = rich_log(noise=NOISE), identified_rich()
    assert NOISE / WHITE <= found.held_out_rms <= WHITE * NOISE
    assert NOISE / WHITE <= found.noise <= WHITE * NOISE
    (fit,) = found.fits
    assert fit.held_out.sum() == 200
    assert not fit.held_out[:200].any()
    errors = (fit.held_out_predicted - log.angles)[fit.held_out]
    assert np.isclose(np.sqrt(np.mean(errors**2)), found.held_out_rms)
    assert np.isnan(fit.held_out_predicted[~fit.held_out]).all()


@pytest.fixture(scope="module")
def fitted():
    """A good fit, with what an identification knows of it beside."""
    return fitted_rich(), intervals_of(fitted_rich())


def judged(fitted, *, held=None, simple=None, **known):
    """The verdict on the fit, were other things known of it; errors are shares of its own."""
    fit, bounds = fitted
    simple = {"raw": 40.0, "delay": 30.0, "first_order": 20.0} | (simple or {})
    if held is not None:
        sizes = {name: held.pop(name, simple[name]) * fit.rms for name in simple}
        rms = held.pop("rms", 1.0) * fit.rms
        sound = held.pop("sound_rms", 1.0) * fit.rms
        rows = np.zeros(len(fit.residuals), dtype=bool)
        held = HeldOut(rows, np.empty(0), rms, sound, sizes, beyond=held.pop("beyond", False))
    options = {
        "columns": (None, None, None),
        "signal": 100.0 * fit.rms,
        "tested": True,
        "friction": 0.0,
        "shaken": (),
        **known,
    }
    simple = {name: share * fit.rms for name, share in simple.items()}
    verdict, reason, notes = verdict_on(fit, bounds, held, simple, **options)
    return Judged(verdict, reason.words, notes)


class Judged(NamedTuple):
    verdict: str
    reason: str
    notes: list


def topics(judged):
    return [each.topic for each in judged.notes]


@pytest.mark.parametrize(("share", "verdict"), [(0.99, "holds"), (0.96, "usable"), (0.94, "worse")])
def test_a_delay_that_is_five_percent_closer_to_held_out_rows_wins(share, verdict, fitted):
    found = judged(fitted, held={"delay": share})
    assert found.verdict.startswith(verdict)
    if verdict == "worse":
        assert found.reason == "on held-out rows a pure delay has 94 % of the model's error"
    # On all rows only where none are held out.
    alone = judged(fitted, simple={"delay": share})
    assert alone.verdict.startswith(verdict)
    assert "held out" not in alone.reason
    assert judged(fitted, held={"delay": 30.0}, simple={"delay": share}).verdict == "holds"


def test_the_larger_error_of_all_rows_and_of_those_held_out_decides(fitted):
    fit, _ = fitted
    signal = fit.rms / 0.08
    worse = judged(fitted, held={"sound_rms": 2.0}, signal=signal)
    assert (worse.verdict, topics(worse)) == ("usable", ["error"])
    assert worse.reason == "it misses 16 % of the motion in the part that was held out"
    better = judged(fitted, held={"sound_rms": 0.5}, signal=signal)
    assert better.verdict == "holds"
    assert better.reason.startswith("it misses 8 % of the motion; ")


@pytest.mark.parametrize(
    ("missed", "delay", "verdict"),
    [
        (0.09, 1.3, "holds"),
        (0.09, 1.2, "usable"),  # a pure delay predicts nearly as well
        (0.09, 1.05, "usable"),
        (0.11, 1.05, "usable"),
        (0.19, 1.05, "usable"),
        (0.21, 1.05, "refused"),
        (0.21, 1.2, "usable"),
        (0.24, 1.2, "usable"),
        (0.26, 9.0, "refused"),
    ],
)
def test_shares_of_the_motion_that_a_model_misses_decide(missed, delay, verdict, fitted):
    fit, _ = fitted
    signal = float(np.sqrt(np.mean(fit.residuals**2))) / missed
    found = judged(fitted, signal=signal, simple={"delay": delay, "first_order": 2.0})
    assert found.verdict == verdict
    assert ("a pure delay predicts nearly as well" in found.reason) is (
        verdict == "usable" and delay < 1.25
    )


def test_dry_friction_that_may_be_a_tenth_of_the_motion_is_hidden(fitted):
    fit, _ = fitted
    for share, hidden in ((9.0, False), (11.0, True), (np.inf, True)):
        found = judged(fitted, friction=share * fit.rms)
        assert ("friction" in topics(found)) is hidden
        assert found.verdict == ("usable" if hidden else "holds")
        assert ("the log does not determine dry friction" in found.reason) is hidden
    refused = judged(fitted, friction=np.inf, signal=2.0 * fit.rms)
    assert refused.verdict == "refused"
    assert "friction" not in topics(refused)  # of a model that is not used anyway


def test_the_delay_after_steps_is_as_uncertain_as_the_covariance_of_its_parameters_says():
    found, model = identified_steps(), identified_steps().model
    ways = {"theta_0": -1.0 / model.gain**2, "lag": 1.0, "acceleration_time": 0.5}
    ends = found.intervals | {"theta_0": found.gain_interval}
    way = [ways.get(name, 0.0) * (high - low) / 2.0 for name, (low, high) in ends.items()]
    half = np.sqrt(way @ np.array(found.correlations) @ way)
    # Intervals follow the loss where it is no parabola, by a few percent here.
    assert found.tested.delay_error == pytest.approx(half, rel=0.1)


def test_the_error_to_expect_is_the_larger_one_of_all_rows_and_of_those_held_out():
    found = identified_rich()
    (delay,) = [each.held_out_rms for each in found.alternatives if each.name == "delay"]
    for held_out, expected in ((2.0 * found.rms, 2.0), (0.5 * found.rms, 1.0), (None, 1.0)):
        other = replace(found, held_out_rms=held_out)
        assert other.expected_error == expected * found.rms
        told = (found.rms, "the rows it was fitted to") if held_out is None else (held_out, "rows")
        assert f"{told[0]:.3g} rad rms on {told[1]}" in repr(other)
        assert other.model.evidence.error == expected * found.rms
        gained = np.nan if held_out is None else held_out / delay
        np.testing.assert_allclose(other.tested.over_delay, gained, rtol=1e-3)


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
    none = np.full(len(beside), np.nan)
    alone = replace(found, fits=(replace(fit, held_out_predicted=none),), noise=0.0)
    assert max(error for _, error in alone.tested.by_acceleration) <= 2.0 * fit.rms
