"""What is known is found, whatever the unit, the origin, the clock and the disturbance."""

import math
from dataclasses import replace

import numpy as np
import pytest

import planner
from tests.identification.made import (
    AIBO,
    NOISE,
    identified_rich,
    logged,
    rich_log,
    step_logs,
)
from tests.instances import joint_of

EXACT = 1e-6
"""Without noise parameters are found to this, relative to their size; an offset relative to 1 rad,
a lag to a tick at least."""

ROUNDING = 1e-14  # of a parameter that is 0

SAME_FIT = 2e-3
"""Two fits of the same rows, scaled or shifted, stop at the same parameters to this share."""

OF_ANGLES, OF_TIMES = ("v_max", "theta_0", "offset"), ("lag", "acceleration_time", "tick")
"""Parameters that scale with the angles of a log, and with its times."""

SERVO = joint_of(6.0, 0.3, 0.0123, 0.0417, tick=0.005, hold=4, offset=0.02)


def assert_close(model, expected, share):
    assert not model.has_inertia
    for name, true in expected.parameters().items():
        found = getattr(model, name)
        size = {"offset": 1.0, "lag": max(true, expected.tick)}.get(name, true)
        assert abs(found - true) <= share * size + ROUNDING, name


# More than two ticks of acceleration: over two only the ratio of their weights is told, and other
# lags with other acceleration times have the same ratio.
@pytest.mark.parametrize("model", [AIBO, SERVO, replace(AIBO, lag=0.0, acceleration_time=0.0184)])
def test_a_log_without_noise_gives_the_model_back(model):
    hold = {} if model is AIBO else {"hold": model.hold}
    found = planner.identify(rich_log(model, amplitude=1.0), **hold)
    assert found.model.hold == model.hold
    assert found.model.tick == pytest.approx(model.tick, rel=0.0 if model is AIBO else EXACT)
    assert_close(found.model, model, EXACT)
    assert found.accepted
    assert found.held_out_rms <= EXACT


@pytest.mark.parametrize(
    ("constant", "period"), [(0.0, 0.0079), (0.0, 0.02), (0.02, 0.005), (0.02, 0.0081)]
)
def test_what_is_found_belongs_to_the_joint_and_not_to_the_rate_of_its_log(constant, period):
    joint = replace(
        SERVO,
        v_max=5.2,
        theta_0=0.26,
        lag=0.02,
        acceleration_time=0.03,
        tick=0.0005,
        hold=1,
        time_constant=constant,
    )
    log = logged(joint, period=period, rows=round(24.0 / period))
    found = planner.identify(log, hold_out=False)
    model, gain = found.model, found.gain_interval
    assert abs(model.gain / 20.0 - 1.0) <= 0.02
    assert abs(model.lag - joint.lag) <= 0.001
    assert abs(model.time_constant - constant) <= 0.001
    assert gain.lower <= 20.0 <= gain.upper
    assert gain.upper / gain.lower <= 1.04


@pytest.mark.parametrize(
    ("changes", "factors", "raised"),
    [
        ({"requests": (3.0, 0.0), "angles": (3.0, 0.0)}, dict.fromkeys(OF_ANGLES, 3.0), 0.0),
        ({"requests": (1.0, 2.0), "angles": (1.0, 2.0)}, {}, 0.0),
        ({"angles": (1.0, 0.1)}, {}, 0.1),
        ({"times": (0.5, 0.0)}, {"v_max": 2.0} | dict.fromkeys(OF_TIMES, 0.5), 0.0),
        ({"times": (1.0, 1.7e9)}, {}, 0.0),  # seconds since 1970, good to 0.2 us
    ],
    ids=["scaled", "shifted together", "angles shifted", "a slower clock", "begun later"],
)
def test_what_is_scaled_or_shifted_in_a_log_is_so_in_its_model(changes, factors, raised):
    """The slower clock has rows of 4 ms: still a tick a row."""
    log, one = rich_log(noise=NOISE), identified_rich()
    columns = {name: a * getattr(log, name) + b for name, (a, b) in changes.items()}
    found = planner.identify(replace(log, **columns), hold_out=False)
    scaled = {name: factor * getattr(one.model, name) for name, factor in factors.items()}
    scaled["offset"] = scaled.get("offset", one.model.offset) + raised
    assert_close(found.model, replace(one.model, **scaled), SAME_FIT)
    assert math.isclose(found.rms, factors.get("offset", 1.0) * one.rms, rel_tol=SAME_FIT)


def test_a_request_acts_at_its_own_time_where_the_reading_failed():
    log = rich_log()
    failed = np.diff(log.requests, prepend=log.requests[:1]) != 0.0
    angles = np.where(failed, 1.0, log.angles)
    found = planner.identify(replace(log, angles=angles, measured=~failed), hold_out=False)
    assert not found.fits[0].used[failed].any()
    assert_close(found.model, AIBO, EXACT)


@pytest.mark.parametrize("form", ["triple", "array", "mapping", "list", "generator"])
def test_logs_may_be_plain_arrays(form):
    log = step_logs()[0]
    columns = {"times": log.times, "requests": log.requests, "angles": log.angles}
    given = {
        "triple": tuple(columns.values()),
        "array": np.array(list(columns.values())),
        "mapping": columns,
        "list": [columns],
        "generator": (each for each in [columns]),
    }[form]
    expected = planner.identify(log, hold_out=False).model
    assert planner.identify(given, hold_out=False).model == expected
