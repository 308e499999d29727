"""The cloud of Figure 5: dots of a joint without noise lie on f wherever they can."""

from __future__ import annotations

import numpy as np
import pytest

from planner.identification.excitation import excite
from planner.identification.log import Log
from planner.identification.result import LogFit
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.report.identification.figures import speed_against_error

ON_THE_LINE = 1e-9
"""With a row every tick a dot is Equation 3 itself, up to rounding [share of the top speed]."""


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
