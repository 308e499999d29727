"""A joint whose requests have the wrong sign is refused, and the sign is named."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from tests.identification.made import AIBO, NOISE, changed, measured, rich_log

PERIOD = 0.02
"""Of the made logs [s]."""

JOINT = planner.JointModel(
    v_max=5.0, theta_0=0.3, lag=0.02, acceleration_time=0.05, tick=0.005, hold=4
)


def waves(shape, frequency):
    times = PERIOD * np.arange(1000)
    sine = np.sin(2.0 * np.pi * frequency * times)
    requests = 0.4 * {"sine": sine, "square": np.sign(sine), "swept": np.sin(times**2)}[shape]
    angles = planner.simulate(JOINT, requests, cyclic=False, start=requests[0])
    return planner.Log(
        times=times, requests=requests, angles=measured(angles, np.random.default_rng(0))
    )


def names_the_sign(found):
    return any("moves against" in text or "move against" in text for text in found.warnings)


@pytest.mark.parametrize(
    ("shape", "frequency"), [("sine", 0.5), ("sine", 2.0), ("square", 2.0), ("swept", 0.0)]
)
def test_an_inverted_sign_is_refused_by_name_even_if_the_motion_repeats_itself(shape, frequency):
    log = waves(shape, frequency)
    assert not names_the_sign(planner.identify(log, hold_out=False))
    inverted = planner.identify(changed(log, angles=-log.angles), hold_out=False)
    assert not inverted.accepted
    assert "invert the sign of one column" in inverted.warnings[0]


def test_it_does_not_matter_which_column_is_inverted_or_where_zero_is():
    log = rich_log(noise=NOISE)
    for requests, angles in ((-log.requests, log.angles), (log.requests, 1.0 - log.angles)):
        found = planner.identify(changed(log, requests=requests, angles=angles), hold_out=False)
        assert not found.accepted
        assert names_the_sign(found)


def test_motion_that_does_not_repeat_itself_leaves_no_other_reading():
    log = rich_log(noise=NOISE)
    found = planner.identify(changed(log, angles=-log.angles), hold_out=False)
    assert not any("does not repeat itself" in text for text in found.warnings)


def test_a_joint_that_is_late_by_less_than_half_a_cycle_has_no_wrong_sign():
    times = AIBO.period * np.arange(1500)
    requests = 0.1 * np.sin(2.0 * np.pi * 5.0 * times)  # half a cycle of 100 ms, 90 of delay
    angles = planner.simulate(AIBO, requests, cyclic=False, start=0.0)
    found = planner.identify((times, requests, angles), hold_out=False)
    assert found.accepted
    assert not names_the_sign(found)


def test_angles_that_have_nothing_to_do_with_the_requests_have_no_sign():
    log = rich_log()
    found = planner.identify(changed(log, angles=rich_log(seed=1).angles), hold_out=False)
    assert not found.accepted
    assert not names_the_sign(found)
