"""The steady cycle of a joint with inertia: the one into which the motion from rest settles."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from planner import InvalidModel, JointModel, line_offset, simulate
from tests.strategies import INTEGRALS

SETTLED = 1e-9
"""Distance of two cycles in a row that counts as none [rad]."""


def ringing_joints():
    """Joints of little damping that saturate, with requests that may have several cycles."""
    rng = np.random.default_rng(1)
    for _ in range(300):
        v_max, gain = rng.uniform(2.0, 7.0), rng.uniform(15.0, 120.0)
        model = JointModel(
            v_max=v_max,
            theta_0=v_max / gain,
            lag=0.01,
            acceleration_time=0.002,
            tick=0.002,
            hold=10,
            time_constant=rng.uniform(0.02, 0.12),
            max_acceleration=rng.uniform(20.0, 200.0),
            integral_rate=rng.choice([0.0, 3.0]),
        )
        turn, size = np.linspace(0.0, 2.0 * np.pi, rng.integers(8, 60)), rng.uniform(0.05, 0.5)
        yield model, size * (np.sin(turn[:-1]) + 0.3 * np.sin(3.0 * turn[:-1] + 1.0))


def test_the_cycle_is_the_one_into_which_the_motion_from_rest_settles():
    settled = elsewhere = 0
    for model, requests in ringing_joints():
        run = simulate(model, np.tile(requests, 150), cyclic=False).reshape(150, -1)
        if np.max(np.abs(run[-1] - run[-2])) <= SETTLED:
            settled += 1
            elsewhere += np.max(np.abs(simulate(model, requests) - run[-1])) > 100.0 * SETTLED
    assert settled >= 200
    assert elsewhere <= 0.01 * settled  # Newton's method alone leads elsewhere in a tenth


@pytest.mark.parametrize("sag", [0.0, 0.06])
@pytest.mark.parametrize("dead_band", [0.0, 0.02])
@pytest.mark.parametrize("name", INTEGRALS)
def test_a_joint_comes_to_rest_up_to_the_integral_that_is_refused(name, dead_band, sag):
    known = {"v_max": 5.0, "theta_0": 0.1, "lag": 0.0, "acceleration_time": 0.004, "tick": 0.004}
    known |= {"time_constant": 0.05, "dead_band": dead_band}
    known |= {"sag_sin": sag * math.cos(1.0), "sag_cos": -sag * math.sin(1.0)}  # steepest at 1
    with pytest.raises(InvalidModel, match=rf"^{name}: got 50 1/s, .*oscillate") as refused:
        JointModel(**known, **{name: 50.0})
    most = float(re.search(r"less than (\S+) 1/s", str(refused.value))[1])
    slower = JointModel(**known, **{name: 0.9 * most})
    angles = simulate(slower, np.r_[0.0, np.ones(4000)], cyclic=False)
    assert angles[-1] == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(InvalidModel, match="without a time_constant"):
        replace(slower, time_constant=0.0)


@pytest.mark.parametrize("name", INTEGRALS)
def test_an_integral_follows_lines_without_friction(name):
    """That of a position controller leaves only the lag."""
    known = {"v_max": 5.0, "theta_0": 0.3, "lag": 0.01, "acceleration_time": 0.004, "tick": 0.002}
    model = JointModel(**known, time_constant=0.03, dead_band=0.02, **{name: 5.0})
    line = 1.5 * model.tick * np.arange(3000)
    behind = line - simulate(model, line, cyclic=False)
    offset = line_offset(model, 1.5)
    assert offset == line_offset(replace(model, dead_band=0.0), 1.5)
    assert behind[-1] == pytest.approx(offset if name == "integral_rate" else 0.0165, abs=1e-6)
