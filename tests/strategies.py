"""Joints and trajectories for property tests."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as numpy_strategies

from planner.model.joint import JointModel

TICK = 0.01  # time step of the models [s]
INTEGRALS = ("integral_rate", "position_integral_rate")
whole_ticks = st.integers(0, 7).map(float)
# Times within 1e-9 ticks of whole ones are whole to the model: no finer than this.
FINEST = 6  # decimals of a tick


def ticks(least, most):
    """Times that need not be whole ticks."""
    return st.floats(least, most).map(lambda time: round(time, FINEST))


@st.composite
def models(
    draw,
    *,
    whole=False,
    holds=(1, 4),
    offsets=True,
    friction=False,
    overshoots=True,
    inertia=False,
    integrals=(),
    poses=False,
    overcome=False,
):
    """Joints of every kind: Equation 13 kept or broken, corners of the parameters included.

    Those with friction can move against any load within ±1 N m; with poses they sag by their angle,
    and by less than what would hinder them from moving against that, too, unless gravity may
    overcome them.
    """
    lag = draw(whole_ticks if whole else ticks(0.0, 7.0))
    acceleration = draw(st.integers(1, 9).map(float) if whole else ticks(0.25, 9.0))
    theta_0 = draw(st.floats(0.02, 0.3))
    # v_max per tick over theta_0; 2 is impossible
    sag = draw(st.floats(0.0, 0.4)) if poses else 0.0
    ratio = draw(st.floats(0.02, (1.95 if overshoots else 1.0) / (1.0 + sag)))
    v_max = ratio * theta_0 / TICK
    dry = {}
    if friction:
        share = draw(st.floats(-0.9, 0.9))
        dry = {
            "dead_band": draw(st.one_of(st.just(0.0), st.floats(0.001, 0.3))),
            "v_offset": share * v_max,
            "compliance": draw(st.one_of(st.just(0.0), st.floats(0.0, 0.3))),
            "speed_per_torque": draw(st.floats(0.0, 0.9)) * (1.0 - abs(share)) * v_max,
        }
    if inertia:
        constant = draw(st.one_of(st.just(0.0), st.floats(0.1, 8.0)))
        share = -np.expm1(-1.0 / constant) if constant else 1.0
        slowed = share * ratio * dry.get("dead_band", 0.0) / TICK**2 if constant else 0.0
        limit = st.floats(0.05, 2.0).map(lambda a: slowed + a * v_max / TICK)
        dry["time_constant"] = constant * TICK
        dry["max_acceleration"] = draw(st.one_of(st.just(np.inf), limit))
        if integrals and constant:  # slow enough for the joint to come to rest
            most = {
                "integral_rate": min(0.3, 0.5 / max(constant - 1.0 / ratio, 1.0)),
                "position_integral_rate": min(0.3, 0.5 * share),
            }
            name = draw(st.sampled_from(integrals))
            dry[name] = draw(st.one_of(st.just(0.0), st.floats(0.001, most[name]))) / TICK
            if friction and name == "integral_rate":  # whose demand has to make up for the load
                left = 0.9 * theta_0 * (1.0 - abs(dry["v_offset"]) / v_max)
                dry["compliance"] = min(dry["compliance"], left)
    if poses:
        phase = draw(st.floats(-np.pi, np.pi))
        slowed = abs(dry.get("v_offset", 0.0)) + dry.get("speed_per_torque", 0.0)
        if not overcome:
            sag = min(sag, 0.9 * theta_0 * (1.0 - slowed / v_max))
        dry |= {"sag_sin": sag * np.cos(phase), "sag_cos": sag * np.sin(phase)}
    return JointModel(
        v_max=v_max,
        theta_0=theta_0,
        lag=lag * TICK,
        acceleration_time=acceleration * TICK,
        tick=TICK,
        hold=draw(st.integers(*holds)),
        offset=draw(st.floats(-0.5, 0.5)) if offsets else 0.0,
        **dry,
    )


def trajectories(*, least=3, most=20, reach=2.0):
    """Angles or requests within ±reach [rad]."""
    return numpy_strategies.arrays(
        np.float64, st.integers(least, most), elements=st.floats(-reach, reach, width=32)
    )
