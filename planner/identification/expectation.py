"""What a test signal would tell about an expected joint: simulate, disturb, identify."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.excitation import Excitation
from planner.identification.identification import Identification
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.model.joint import JointModel
from planner.model.response import simulate


def expect(
    excitation: Excitation,
    model: JointModel,
    *,
    noise: float = math.radians(0.2),
    resolution: float = math.radians(0.3),
    seed: int = 0,
) -> Identification:
    """Identify the expected joint from what it would answer to the signal.

    Its intervals are those to expect from the robot, as far as the robot is like the model.

    Args:
        excitation: The signal.
        model: The expected joint, at any rate.
        noise: Standard deviation of the measured angles [rad].
        resolution: Step of the sensor [rad]; 0 for none.
        seed: Of the noise.

    Raises:
        InvalidInput: Noise or resolution is negative.
    """
    log = expected_log(excitation, model, noise=noise, resolution=resolution, seed=seed)
    joint = at_period(model, excitation.period)
    return identify(log, tick=joint.tick, hold=joint.hold, hold_out=False)


def expected_log(
    excitation: Excitation, model: JointModel, *, noise: float, resolution: float, seed: int = 0
) -> Log:
    """The log of the expected joint under the signal, as a sensor would record it.

    Raises:
        InvalidInput: Noise or resolution is negative.
    """
    for name, value in (("noise", noise), ("resolution", resolution)):
        if not 0.0 <= value < math.inf:
            raise InvalidInput(f"{name}: got {value:g} rad, expected 0 or more")
    joint = at_period(model, excitation.period)
    angles = simulate(joint, excitation.requests, cyclic=False)
    measured = angles + noise * np.random.default_rng(seed).standard_normal(len(angles))
    if resolution > 0.0:
        measured = resolution * np.round(measured / resolution)
    return Log(
        times=excitation.times,
        requests=excitation.requests,
        angles=measured,
        name=f"simulated {excitation.kind}",
    )


def at_period(model: JointModel, period: float) -> JointModel:
    """The same joint, with a request every ``period`` [s] and ticks at most as long as its own."""
    hold = max(1, math.ceil(period / model.tick - 1e-9))
    return dataclasses.replace(model, tick=period / hold, hold=hold)
