"""Named instances with known answers, and random ones by seed, for tests and benchmarks alike."""

import math
from typing import NamedTuple

import numpy as np

from planner import JointModel, reference_walk, simulate
from planner.arrays import Array

ERS210A = JointModel.ers210a()

SERVO = JointModel(v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=0.005, hold=4)
"""A servo that is asked 50 times a second."""

TICK = 0.008  # time step of the random models [s]


def joint_of(
    v_max: float, theta_0: float, lag: float, acceleration_time: float, **terms: float
) -> JointModel:
    """A joint by its four numbers [rad/s, rad, s, s], and the other terms that it has."""
    four = {"v_max": v_max, "theta_0": theta_0, "lag": lag, "acceleration_time": acceleration_time}
    return JointModel(**four, **terms)


class ReferenceJoint(NamedTuple):
    """One joint of the reference walk, and what is known about it [degrees]."""

    name: str
    column: int
    limits_deg: tuple[float, float]
    direct_rms_deg: float
    slope_bound_deg: float
    envelope_bound_deg: float
    exact_bound_deg: float
    closed_form_rms_deg: float  # at most, with six segments

    @property
    def desired(self) -> Array:
        """Desired angles [rad], shape (88,)."""
        return reference_walk().desired[:, self.column]

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest request [rad]."""
        lower, upper = self.limits_deg
        return math.radians(lower), math.radians(upper)


REFERENCE_JOINTS = (
    ReferenceJoint("rotator", 0, (-117.0, 117.0), 32.80, 8.6936, 8.7112, 8.739, 8.95),
    ReferenceJoint("abductor", 1, (-11.0, 89.0), 28.86, 8.6424, 8.6739, 8.715, 8.95),
    ReferenceJoint("knee", 2, (-27.0, 147.0), 23.84, 6.0130, 6.0382, 6.071, 6.25),
)


def random_model(
    rng: np.random.Generator, *, whole: bool = True, hold: int = 1, offset: bool = False
) -> JointModel:
    """A joint with 1-3 degrees a tick, 3-15 degrees, a lag of 1-7 ticks and 2-9 to accelerate."""
    lag, acceleration = rng.uniform(1.0, 7.0), rng.uniform(2.0, 9.0)
    if whole:
        lag, acceleration = round(lag), round(acceleration)
    return JointModel(
        v_max=math.radians(rng.uniform(1.0, 3.0)) / TICK,
        theta_0=math.radians(rng.uniform(3.0, 15.0)),
        lag=lag * TICK,
        acceleration_time=acceleration * TICK,
        tick=TICK,
        hold=hold,
        offset=math.radians(rng.uniform(-20.0, 20.0)) if offset else 0.0,
    )


def random_model_outside_equation_13(rng: np.random.Generator) -> JointModel:
    """A joint with v_max < 2 theta_0 that breaks one half of Equation 13 or the other."""
    theta_0 = math.radians(rng.uniform(2.0, 8.0))
    if rng.random() < 0.5:
        v_max, acceleration = theta_0 * rng.uniform(1.0, 1.9), rng.uniform(0.3, 9.0)
    else:
        v_max = theta_0 * rng.uniform(0.5, 1.0)
        acceleration = 4.0 * theta_0 / v_max * rng.uniform(1.05, 2.0)
    return JointModel(
        v_max=v_max / TICK,
        theta_0=theta_0,
        lag=rng.uniform(0.0, 7.0) * TICK,
        acceleration_time=acceleration * TICK,
        tick=TICK,
    )


def saturating(rng: np.random.Generator, model: JointModel, *, samples: int = 88) -> Array:
    """Six sines whose peak slope is 1.1 to 2 times v_max: no joint can follow them [rad]."""
    return _six_sines(rng, samples, model.v_max * model.period * rng.uniform(1.1, 2.0))


def attainable(rng: np.random.Generator, model: JointModel, *, samples: int = 88) -> Array:
    """Six sines of peak slope up to 0.9 v_max that change their speed slowly enough [rad]."""
    angles = _six_sines(rng, samples, model.v_max * model.period * rng.uniform(0.3, 0.9))
    speeds = angles - np.roll(angles, 1)  # [rad/period]
    change = float(np.max(np.abs(np.roll(speeds, -1) - speeds)))
    # A window of a ticks can turn v_max around no faster than by 2 v_max / a a tick.
    most = model.v_max * model.period**2 / max(model.acceleration_time, model.period)
    return angles * min(1.0, 0.5 * most / change)


def answered(rng: np.random.Generator, model: JointModel, *, samples: int = 88) -> Array:
    """What the joint makes of random requests, so that some requests reach it exactly [rad]."""
    requests = _six_sines(rng, samples, 0.7 * model.v_max * model.period)
    return simulate(model, requests - model.offset)


def _six_sines(rng: np.random.Generator, samples: int, peak: float) -> Array:
    """A sum of the first six harmonics whose largest step is ``peak``."""
    phase = 2.0 * np.pi * np.arange(samples) / samples
    harmonics = np.arange(1, 7)
    amplitudes = rng.normal(size=6) / harmonics
    shifts = rng.uniform(0.0, 2.0 * np.pi, size=6)
    angles = np.sin(np.outer(phase, harmonics) + shifts) @ amplitudes
    return angles * (peak / float(np.max(np.abs(angles - np.roll(angles, 1)))))
