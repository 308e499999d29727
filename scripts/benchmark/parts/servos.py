"""Servos from their physics: what a plan on an identified model is worth beside a time shift."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import planner
from benchmark.compiled_servos import SERVOS, CompiledServo
from benchmark.parts import Options
from benchmark.table import Table
from planner.trajectory import rms

Array = npt.NDArray[np.float64]

SETTLED = 3
"""Cycles before the one that counts."""

LEADS = np.arange(0.0, 0.3, 0.004)
"""Leads among which the best time shift is sought on the servo itself [s]."""


def measure(_: Options) -> list[Table]:
    """One row for each servo and motion."""
    table = Table(
        "Plans for servos from their physics, over the best time shift on the servo itself",
        ("shift, deg", "own shift", "plan", "told, deg", "low", "high", "met, deg"),
        note="Each servo is identified from 60 s at 50 Hz (the recording that excite proposes; "
        "encoder of 12 bits, noise of 0.03 degrees), a cycle is planned and played. Errors are "
        "root mean squares of true angles; shift: the desired angles early by the best time, "
        "sought on the servo; own shift and plan: errors of invert_shift and invert_optimal over "
        "that; told: to expect, with its range; met: of the plan.",
        stub="servo, motion",
    )
    ratios, told = [], []
    for servo in SERVOS:
        found = planner.identify(servo.logs())
        for name, path in motions(servo.period).items():
            best = min(_error(servo, path, early(path, lead / servo.period)) for lead in LEADS)
            plan = planner.invert_optimal(found.model, path)
            met = _error(servo, path, plan.requests)
            own = _error(servo, path, planner.invert_shift(found.model, path).requests)
            ratios.append(met / best)
            told.append(plan.expected.error / met)
            ends = plan.expected.error, plan.expected.low, plan.expected.high, met
            shares = own / best, met / best
            table.add(
                f"{servo.name}: {name}", math.degrees(best), *shares, *map(math.degrees, ends)
            )
    near = 100.0 * float(np.mean([0.7 <= each <= 1.4 for each in told]))
    table.note += (
        f" The plan's median is {np.median(ratios):.2f}, its largest {max(ratios):.2f}; in "
        f"{near:.0f} % of the rows 0.7 to 1.4 of the error met is told."
    )
    return [table]


def motions(period: float) -> Mapping[str, Array]:
    """Cycles [rad], (n,): a slow sine, a walk's knee, pick and place with rests."""
    slow, quick, long = (period * np.arange(round(length / period)) for length in (2.0, 1.0, 3.0))
    phase = 2.0 * math.pi * quick
    knee = 16.0 * np.sin(phase) + 5.0 * np.sin(2.0 * phase + 0.7) + np.sin(3.0 * phase + 1.9)
    moves = ((40.0, 0.0, 0.6), (-40.0, 1.0, 0.5), (-15.0, 1.8, 0.3), (15.0, 2.3, 0.4))
    place = sum(size * _quintic((long - begin) / length) for size, begin, length in moves)
    return {
        "sine": np.radians(30.0 * np.sin(math.pi * slow)),
        "walk": np.radians(knee),
        "pick and place": np.radians(place),
    }


def _quintic(share: Array) -> Array:
    share = np.clip(share, 0.0, 1.0)
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


def early(path: Array, samples: float) -> Array:
    """A cycle that runs so many samples ahead."""
    rows = np.arange(len(path))
    return np.interp(
        (rows + samples) % len(path), np.arange(len(path) + 1), np.append(path, path[0])
    )


def _error(servo: CompiledServo, path: Array, requests: Array) -> float:
    return rms(servo.angles(requests, before=SETTLED) - path)
