"""Identifications made by hand: what a fit of a simulated joint would be, without the fit."""

import dataclasses
import math

import numpy as np

from planner import Identification, JointModel, Log, simulate
from planner.identification.excitation import excite
from planner.identification.result import Alternative, Finding, Interval, LogFit

NOISE = math.radians(0.2)  # standard deviation of the made-up sensor [rad]

JOINT = dataclasses.replace(JointModel.ers210a(), tick=0.02 / 3.0, hold=3)
"""The truth: a request every 20 ms."""


def made_up_log(kind="random_steps", *, duration=20.0, name="bench.csv", joint="hip", unit="rad"):
    """What the Aibo's joint would answer to a test signal at 50 Hz."""
    signal = excite(kind, limits=(-0.7, 0.9), period=0.02, duration=duration)
    model = JOINT
    noise = NOISE * np.random.default_rng(5).standard_normal(len(signal.times))
    angles = simulate(model, signal.requests, cyclic=False) + noise
    return Log(
        times=3.0 + signal.times,
        requests=signal.requests,
        angles=angles,
        torque_on=signal.times < 0.9 * duration,
        name=name,
        joint=joint,
        unit=unit,
        notes=("requested: column 'goal' [deg], guessed by its name",),
    )


def made_up_fit(log, model):
    """The true model on a log, its last third held out."""
    used = log.torque_on.copy()
    used[:4] = False
    held_out = used & (np.arange(len(used)) > 0.6 * len(used))
    angles = simulate(model, log.requests, cyclic=False)
    predicted = np.where(used, angles, np.nan)
    return LogFit(
        log=log,
        predicted=predicted,
        held_out_predicted=np.where(held_out, angles + 0.004, np.nan),
        weights=np.where(used, np.where(np.arange(len(used)) % 97 == 0, 0.3, 1.0), 0.0),
    )


def made_up(*logs, **changes):
    """An identification of such logs that found the truth; fields may be changed."""
    logs = logs or (made_up_log(),)
    model = JOINT
    fits = tuple(made_up_fit(log, model) for log in logs)
    raw = np.concatenate([(fit.log.requests - fit.log.angles)[fit.used] for fit in fits])
    rms = float(np.sqrt(np.mean([fit.rms**2 for fit in fits])))
    half = {"v_max": 0.03, "theta_0": 0.004, "lag": 5e-4, "acceleration_time": 2e-3, "offset": 4e-4}
    fields = {
        "model": model,
        "fits": fits,
        "rms": rms,
        "held_out_rms": 1.1 * rms,
        "noise": NOISE,
        "signal": 0.4,
        "intervals": {
            name: Interval(getattr(model, name) - by, getattr(model, name) + by)
            for name, by in half.items()
        },
        "gain_interval": Interval(43.1, 46.2),
        "alternatives": tuple(
            Alternative(name=name, rms=error, held_out_rms=share * error, parameters=found)
            for name, error, share, found in (
                ("raw", float(np.sqrt(np.mean(raw**2))), 1.02, {}),
                ("delay", 0.06, 1.05, {"delay": 0.11, "offset": 0.001}),
                (
                    "first_order",
                    0.04,
                    1.025,
                    {"delay": 0.05, "time_constant": 0.06, "offset": 0.001},
                ),
            )
        ),
        "findings": (),
    }
    return Identification(**{**fields, **changes})


def never_saturated():
    """The same, where the logs bound the top speed from below only."""
    right = made_up()
    return dataclasses.replace(
        right,
        intervals={
            **right.intervals,
            "v_max": Interval(3.0, math.inf),
            "theta_0": Interval(0.07, math.inf),
        },
        findings=(
            Finding(
                "top speed",
                "the joint never saturates in this log: only v_max/theta_0 = 44.6 per second is "
                "known; record steps larger than about 0.5 rad",
            ),
        ),
    )
