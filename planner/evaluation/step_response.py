"""Lag, acceleration time and top speed of a step test: the paper's Figures 3 and 4."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.model.step_test import step_test
from planner.trajectory import Array

VISIBLE = 0.01
"""A speed has changed, or is the top speed, when it is this close, relative to the top speed."""


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A joint's steady answer to the step test, and its features at the step down.

    Attributes:
        amplitude: Height of the step [rad].
        requests: Requests of Equation 1 [rad], shape (n,).
        angles: Angles [rad], shape (n,).
        step: Sample at which the requests step down.
        lag: Samples until the speed begins to change.
        acceleration: Samples from then until the joint moves down at its top speed.
        v_max: Its top speed [rad/s].
    """

    amplitude: float
    requests: Array
    angles: Array
    step: int
    lag: int
    acceleration: int
    v_max: float


def measure_step_response(
    model: JointModel, amplitude: float, *, samples: int = 88
) -> StepResponse:
    """Run the step test of Equation 1 and read its features off, in whole samples as by eye.

    Args:
        model: The joint.
        amplitude: Height of the step [rad]; high enough for the joint to reach its top speed.
        samples: Length of the test.
    """
    requests = step_test(amplitude, samples=samples)
    angles = simulate(model, requests)
    step = int(np.argmin(requests))
    speeds = angles - np.roll(angles, 1)  # speeds[k] leads from sample k - 1 to k [rad/sample]
    fastest = float(np.max(np.abs(speeds)))
    after = speeds[step:]
    begun = int(np.argmax(np.abs(after - after[0]) > VISIBLE * fastest))
    full = int(np.argmax(after <= -(1.0 - VISIBLE) * fastest))
    lag = begun - 1  # sample `begun` ends the first interval in which the speed is another
    return StepResponse(
        amplitude=amplitude,
        requests=requests,
        angles=angles,
        step=step,
        lag=lag,
        acceleration=full - lag,
        v_max=fastest / model.period,
    )
