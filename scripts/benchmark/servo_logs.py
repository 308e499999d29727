"""Logs of random servos that are not the model: with play, friction, slow starts."""

from __future__ import annotations

import math

import numpy as np

import planner
from tests.identification.made import measured, random_motion

PERIODS = (0.01, 0.02)  # of the logs [s]


def random_servo(seed, *, kinds=("steps", "sines", "mixed"), seconds=30.0, **defects):
    """A log of a servo whose constants are random, with the defects that are asked for.

    Half of them have dry friction of 0.5 to 2 degrees; noise of 0.02 to 0.2 degrees, steps of the
    sensor of 0, 0.09 or 0.3.
    """
    random = np.random.default_rng(seed)
    period = float(random.choice(PERIODS))
    known = {
        "top": random.uniform(2.5, 6.0),
        "gain": random.uniform(8.0, 20.0),
        "delay": random.uniform(0.005, 0.03),
        "constant": random.uniform(0.01, 0.05),
        "friction": math.radians(random.choice([0.0, random.uniform(0.5, 2.0)])),
    }
    noise = math.radians(random.uniform(0.02, 0.2))
    quantum = math.radians(float(random.choice([0.0, 0.09, 0.3])))
    requests = random_motion(
        random, period, kind=str(random.choice(kinds)), seconds=seconds, span=0.6
    )
    angles = servo(requests, period, **known, **defects)
    rows = {"times": period * np.arange(len(requests)), "requests": requests}
    rows["angles"] = measured(angles, random, noise=noise, quantum=quantum)
    return planner.Log(**rows, name=f"servo {seed}")


def servo(
    requests, period, *, top, gain, delay, constant, friction, most=math.inf, play=0.0, behind=False
):
    """Angles of a servo that is not the model, in steps of a millisecond [rad].

    The speed that it is called to follows the error of ``delay`` before; it gains that speed with a
    time constant and at most ``most`` [rad/s^2]. Coulomb friction, which holds an error of
    ``friction``, opposes the speed; ``top`` is the top speed that it leaves.
    Between motor and joint is play; the error is that of the joint, or of the motor where the
    sensor of its loop is before the play and the joint is measured behind it.
    """
    fine = round(period / 0.001)
    step, half = period / fine, play / 2.0
    late = np.concatenate([np.full(round(delay / step), requests[0]), np.repeat(requests, fine)])
    motor = angle = requests[0]
    speed, angles = 0.0, []
    for k, request in enumerate(late[: fine * len(requests)].tolist()):
        if k % fine == 0:
            angles.append(angle)
        error, most_called = request - (motor if behind else angle), top + gain * friction
        called = min(max(gain * error, -most_called), most_called)
        speed += step * min(max((called - speed) / constant, -most), most)
        held = step / constant * gain * friction
        speed -= min(max(speed, -held), held)
        motor += step * speed
        angle = min(max(angle, motor - half), motor + half)
    return np.array(angles)
