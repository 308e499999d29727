"""Logs whose joint is known, and the recorded ones."""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np

import planner

AIBO = planner.JointModel.ers210a()

NOISE = math.radians(0.2)
"""Standard deviation of the made logs' noise [rad]."""

QUANTUM = math.radians(0.3)
"""Step of the made logs' sensor [rad]."""

AMPLITUDES = tuple(map(math.radians, (30.0, 90.0)))
"""Step tests [rad]: small enough to see the joint close in, large enough to saturate it."""


def measured(angles, rng, *, noise=NOISE, quantum=QUANTUM):
    """Angles as a noisy sensor of finite resolution reports them."""
    noisy = angles + rng.normal(scale=noise, size=len(angles)) if noise else angles
    return np.round(noisy / quantum) * quantum if quantum else noisy


def step_logs(
    model=AIBO, *, seed=0, amplitudes=AMPLITUDES, samples=88, cycles=3, noise=NOISE, quantum=QUANTUM
):
    """Step tests of a joint that rests at 0 before, one log for each amplitude."""
    rng = np.random.default_rng(seed)
    logs = []
    for amplitude in amplitudes:
        requests = np.tile(planner.step_test(amplitude, samples=samples), cycles)
        angles = planner.simulate(model, requests, cyclic=False, start=model.offset)
        logs.append(
            planner.Log(
                times=np.arange(len(requests)) * model.period,
                requests=requests,
                angles=measured(angles, rng, noise=noise, quantum=quantum),
            )
        )
    return logs


def rich_log(model=AIBO, *, seed=0, rows=400, amplitude=0.6, noise=0.0, quantum=0.0, load=None):
    """Steps of random height and length."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(4, 30, size=rows)
    heights = rng.uniform(-amplitude, amplitude, size=rows)
    requests = np.repeat(heights, lengths)[:rows]
    angles = planner.simulate(model, requests, cyclic=False, load=load)
    return planner.Log(
        times=np.arange(rows) * model.period,
        requests=requests,
        angles=measured(angles, rng, noise=noise, quantum=quantum),
    )


def hobby_servo(requests, period, *, seed=0):
    """A loaded hobby servo, which is not the model: -350/+220 deg/s, its torque limited.

    The speed that it is called to follows the error of 30 ms before by 20 per second between its
    top speeds; it gains that speed with a time constant of 40 ms and at most 60 rad/s^2. The load
    lets it sag by 2 degrees. Noise of 0.2 and steps of 0.3 degrees.
    """
    up, down, gain, delay, constant, most, sag = 3.84, 6.11, 20.0, 0.03, 0.04, 60.0, -0.035
    fine = 10
    step = period / fine
    late = np.concatenate([np.full(round(delay / step), requests[0]), np.repeat(requests, fine)])
    angle, speed, angles = requests[0] + sag, 0.0, []
    for k, request in enumerate(late[: fine * len(requests)].tolist()):
        if k % fine == 0:
            angles.append(angle)
        called = min(max(gain * (request + sag - angle), -down), up)
        speed += step * min(max((called - speed) / constant, -most), most)
        angle += step * speed
    times = period * np.arange(len(requests))
    sensed = measured(np.array(angles), np.random.default_rng(seed))
    return planner.Log(times=times, requests=requests, angles=sensed)


@functools.cache
def identified_steps():
    """The joint of :func:`step_logs`, identified once for all tests."""
    return planner.identify(step_logs())


@functools.cache
def identified_rich():
    """The joint of :func:`rich_log` with noise, identified once for all tests."""
    return planner.identify(rich_log(noise=NOISE))


def changed(log, **changes):
    """The log with other columns."""
    columns = {"times": log.times, "requests": log.requests, "angles": log.angles}
    columns["torque_on"] = log.torque_on
    return planner.Log(**{**columns, **changes})


def so101(folder: Path, recording: str, joint: str) -> planner.Log:
    """One joint of the SO-101's recordings."""
    table = np.genfromtxt(folder / "so101" / f"{recording}.csv", delimiter=",", names=True)
    return planner.Log(
        times=table["t_s"],
        requests=table[f"req_{joint}"],
        angles=table[f"act_{joint}"],
        name=recording,
        joint=joint,
        unit="1" if joint == "Jaw" else "rad",
    )


def pendulum(folder: Path, servo: str, recording: str) -> planner.Log:
    """A servo that swings a weight."""
    table = np.genfromtxt(folder / servo / f"{recording}.csv", delimiter=",", names=True)
    return planner.Log(
        times=table["t_s"],
        requests=table["req_rad"],
        angles=table["act_rad"],
        torque_on=table["torque_on"] > 0.0,
        name=recording,
    )
