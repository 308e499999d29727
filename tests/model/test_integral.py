"""The integral terms of a servo under gravity and torque: they make up for both, in their time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner import JointModel, line_offset, simulate
from planner.model.response import motion_under
from tests.strategies import INTEGRALS

BARE = JointModel(
    v_max=5.0,
    theta_0=0.25,
    lag=0.01,
    acceleration_time=0.01,
    tick=0.005,
    hold=2,
    offset=0.1,
    time_constant=0.03,
)

LOADED = replace(BARE, sag_sin=-0.06, sag_cos=0.02, compliance=0.05, speed_per_torque=1.0)
"""A joint that gravity pulls away, and a torque, whose physics is that of gravity."""

RATES = {"integral_rate": 8.0, "position_integral_rate": 4.0}

EACH = pytest.mark.parametrize("name", INTEGRALS)


def servo(name, model=LOADED):
    """The joint with an integral."""
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
