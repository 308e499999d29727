"""Servos from their physics: plans on identified models compared with a time shift."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

import planner
from benchmark.compiled_servos import SERVOS, CompiledServo
from benchmark.parts import Options
from benchmark.table import Table
from planner.arrays import Array, rms

SETTLED = 3  # cycles before the one that counts
LEADS = np.arange(0.0, 0.3, 0.004)
"""Leads among which the best time shift is sought on the servo itself [s]."""

TRIALS = 3  # trials of learning


def measure(_: Options) -> list[Table]:
    """One row for each servo and motion."""
    table = Table(
        "Plans for servos from their physics, over the best time shift on the servo itself",
        "servo, motion | shift, deg | own shift | plan | "
        + "".join(f"trial {k + 1} | " for k in range(TRIALS))
        + "mean | worst | told/met | low | high",
        note="Each servo is identified from 60 s at 50 Hz (the recording that excite proposes; "
        "encoder of 12 bits, noise of 0.03 degrees; of servos with a pendulum the load is known, "
        "but where it says otherwise), a cycle is planned and played. Errors are root mean squares "
        "of true angles; shift: the desired angles early by the best time, sought on the servo. "
        "Errors over that: own shift and plan, of invert_shift and invert_optimal; trials, of "
        "refine, one measured cycle each; mean and worst, of robust plans. Told: error to expect "
        "of the plan over that met, with its range.",
    )
    rows = []
    for servo in SERVOS:
        model = planner.identify(servo.log()).model
        for name, path in motions(servo.period).items():
            row = row_of(servo, model, path)
            rows.append(row)
            met, told = np.array(row.met) / row.shift, np.array(row.expected) / row.met[1]
            table.add(f"{servo.name}: {name}", math.degrees(row.shift), *met, *told)
    table.note += summary(rows)
    return [table]


class Row(NamedTuple):
    """Errors on a servo [rad], rms."""

    shift: float  # of the best time shift, sought on the servo
    met: list[float]  # of the model's own shift, the plan, the trials, the robust plans
    expected: tuple[float, float, float]  # error of the plan, and its range
    predicted: list[float]  # errors that the trials predict over those that were measured then


def row_of(servo: CompiledServo, model: planner.JointModel, path: Array) -> Row:
    """Errors of the servo on a cycle."""
    load = servo.load(path)
    best = min(_error(servo, path, early(path, lead / servo.period)) for lead in LEADS)
    own = planner.invert_shift(model, path, load=load)
    plan = planner.invert_optimal(model, path, load=load)
    trials, predicted = learnt(servo, plan)
    robust = [math.nan] * 2
    if model.evidence is not None and model.evidence.intervals:
        ways = "mean", "worst"
        plans = [planner.invert_optimal(model, path, load=load, robust=way) for way in ways]
        robust = [_error(servo, path, each.requests) for each in plans]
    met = [_error(servo, path, each.requests) for each in (own, plan)]
    told = plan.expected
    return Row(best, [*met, *trials, *robust], (told.error, told.low, told.high), predicted)


def learnt(servo: CompiledServo, plan: planner.Inversion) -> tuple[list[float], list[float]]:
    """True errors of the trials after a plan [rad], and predicted over measured ones [-]."""
    random, met, ratios = np.random.default_rng(1), list[float](), list[float]()
    sensed = servo.seen(servo.angles(plan.requests, before=SETTLED), random)
    for _ in range(TRIALS):
        plan = planner.refine(plan, sensed)
        assert plan.learning is not None, "of a plan that has learnt"
        played = servo.angles(plan.requests, before=SETTLED)
        sensed = servo.seen(played, random)
        met.append(rms(played - plan.desired))
        ratios.append(plan.learning.next_error / rms(sensed - plan.desired))
    return met, ratios


def summary(rows: list[Row]) -> str:
    """A summary of the rows."""

    def median(column: int) -> str:
        return f"{np.nanmedian([row.met[column] / row.shift for row in rows]):.2f}"

    plans = [row.met[1] / row.shift for row in rows]
    near = np.mean([0.7 <= row.expected[0] / row.met[1] <= 1.4 for row in rows])
    inside = np.mean([row.expected[1] <= row.met[1] <= row.expected[2] for row in rows])
    steps = [row.met[k + 1] / row.met[k] for row in rows for k in range(1, TRIALS + 1)]
    ratios = [each for row in rows for each in row.predicted]
    within = np.mean([1.0 / 1.5 <= each <= 1.5 for each in ratios])
    return (
        f" The plan's median is {median(1)}, its largest {max(plans):.2f}; in "
        f"{100.0 * near:.0f} % of the rows 0.7 to 1.4 of the error met is told, in "
        f"{100.0 * inside:.0f} % it is in the range. The third trial's median is "
        f"{median(TRIALS + 1)}; a trial's error is at most {max(steps):.2f} of the one before, "
        f"and in {100.0 * within:.0f} % of the trials within a factor of 1.5 of what was predicted."
    )


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
