"""Models of one recording on the other recordings of the same joint: a test of the verdicts."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

import planner
from benchmark.compiled_servos import random_servo
from benchmark.parts import Options, recordings
from benchmark.plants import random_path
from benchmark.table import Table
from planner.arrays import Array, rms
from planner.identification.excitation import excite
from planner.identification.grid import resampled, timing_of
from planner.identification.joint_fit import fit_joint
from planner.identification.least_squares import respond
from planner.identification.parameters import Parameters
from planner.identification.result import Identification

JOINTS = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")

BAD = 0.25  # error over the standard deviation of the motion from which on a model does not fit


SMOOTHED = 5
"""Rows that are averaged before their speeds and accelerations are compared with those tested."""


PERIOD = 0.02  # time between requests of the virtual servos [s]
LIMITS = (-0.3, 1.9)  # of their requests [rad]
MARGIN = 0.1  # planned cycles stay so far within these [rad]
FASTEST = 3.0  # top speed of these cycles [rad/s]
CYCLES = (2.0, 4.0, 8.0)  # their lengths [s]
SIGNALS: dict[str, tuple[str, ...]] = {
    "levels held for 1 to 2.5 s": (),
    "steps": ("steps",),
    "random steps": ("random_steps",),
    "multisine": ("multisine",),
    "slow triangle, random steps, multisine": ("slow_triangle", "random_steps", "multisine"),
}
"""Logged motions, by signals of :func:`planner.identification.excitation.excite`."""


def measure(options: Options) -> list[Table]:
    """Virtual servos; every pair of recordings of a joint.

    With few instances (``--quick``) the humanoid's 26 joints are left out.
    """
    servos, recorded = promised(options.instances), joints(options)
    return [servos, *(pairs(recorded) if recorded else [])]


def promised(servos: int) -> Table:
    """The expected error of plans for virtual servos over the measured one, by logged motion."""
    table = Table(
        "The error to expect",
        "log | plans | by acceleration | held out | told | 10 % | 90 % | met < told, % | said, %",
        note=f"Over the error met, medians. {servos} servos from physics with random constants and "
        f"a log of 40 s each; cycles of {', '.join(f'{each:g}' for each in CYCLES)} s are planned "
        "and executed. By acceleration: without the interval of the delay; held out: that times "
        "the held-out over the fitted error; then what is told, with quantiles; how often that is "
        "more; and how often the plan says that it is outside of what was tested.",
    )
    for name in SIGNALS:
        rows = np.array([each for seed in range(servos) for each in _promises(name, seed)])
        ratios = rows[:, 2]
        told = np.quantile(ratios, (0.5, 0.1, 0.9))
        shares = 100.0 * np.mean(ratios > 1.0), 100.0 * np.mean(rows[:, 3])
        table.add(name, len(rows), *np.median(rows[:, :2], axis=0), *told, *shares)
    return table


def _promises(name: str, seed: int) -> list[tuple[float, ...]]:
    """Expected errors of each plan over the measured one, and whether it is outside."""
    servo, ratios = random_servo(seed), []
    result = planner.identify(servo.log(_log_requests(name, seed), seed))
    bare = result.tested._replace(delay_error=0.0)
    for length in CYCLES:
        low, high = LIMITS[0] + MARGIN, LIMITS[1] - MARGIN
        samples = round(length / PERIOD)
        path = random_path(seed, samples, span=high - low, fastest=FASTEST * PERIOD)
        desired = path - path.min() + low
        plan = planner.plan(result.model, desired).inversions[0]
        true = servo.angles(plan.requests, before=3)
        own, met = rms(plan.predicted - desired), rms(true - desired)
        error = bare.error_of(plan.predicted, period=PERIOD, cyclic=True)
        scaled = error * result.expected_error / result.rms
        expected = math.hypot(own, error), math.hypot(own, scaled), plan.expected.error
        ratios.append((*(each / met for each in expected), bool(plan.expected.untested)))
    return ratios


def _log_requests(name: str, seed: int) -> Array:
    """Requests of 40 s [rad]."""
    kinds = SIGNALS[name]
    if not kinds:
        random = np.random.default_rng(seed)
        levels = [np.full(random.integers(50, 125), random.uniform(*LIMITS)) for _ in range(40)]
        return np.concatenate(levels)[: round(40.0 / PERIOD)]
    parts = [
        excite(kind, limits=LIMITS, period=PERIOD, duration=40.0 / len(kinds), seed=seed)
        for kind in kinds
    ]
    return np.concatenate([part.requests for part in parts])


def four_numbers(logs: list[planner.Log]) -> planner.JointModel:
    """A model of the paper's four numbers and a static offset; identify would find friction."""
    timing = timing_of(logs, tick=None, hold=None)
    fit = fit_joint(logs, timing, choose_tick=True)[-1]
    timing = timing.ticking(fit.grid.tick)
    return fit.parameters.model(tick=timing.tick, hold=timing.hold)


def pairs(every: dict[str, list[planner.Log]]) -> list[Table]:
    """Each model of one recording on each other recording of the joint."""
    counted = Table(
        "Models of one recording on the other recordings of the joint",
        "joint | pairs | holds | and off | and not said | not said, % | intervals that agree, %",
        note="Pairs; those of models that hold; of these those whose error on the other recording "
        "is above 25 % of its motion; of these those of which nothing says that the other is "
        "outside of what was tested, also in percent of those that hold; and how often a parameter "
        "lies in the interval from the other recording.",
    )
    named = Table(
        "Models that hold, and are off by more than 25 % of another motion",
        "pair | share, % | outside of what was tested",
    )
    total = np.zeros(6)
    for joint, logs in every.items():
        results = _identified(logs)
        sums = np.zeros(6)
        for k, model in results.items():
            for j in set(results) - {k}:
                _, share = errors_of(model.model, logs[j])
                beyond = outside(model, logs[j])
                holds = model.verdict == "holds"
                off = holds and share > BAD
                sums += [1, holds, off, off and not beyond, 0, 0]
                sums[4:] += _agreement(model, results[j])
                if off:
                    name = f"{joint}, {logs[k].name} on {logs[j].name}"
                    named.add(name, 100.0 * share, len(beyond))
        total += sums
        if len(results) > 1:
            counted.add(joint, *_row(sums))
    counted.add("all", *_row(total))
    return [counted, named]


def _row(sums: Array) -> tuple[float, ...]:
    *counts, agree, compared = sums.tolist()
    _, holds, _, silent = counts
    shares = (silent, holds), (agree, compared)
    return *counts, *(100.0 * part / whole if whole else math.nan for part, whole in shares)


def _identified(logs: list[planner.Log]) -> dict[int, Identification]:
    results = {}
    for k, log in enumerate(logs):
        try:
            results[k] = planner.identify(log)
        except planner.InvalidInput:  # the joint is not moved in it
            continue
    return results


def _agreement(result: Identification, other: Identification) -> tuple[int, int]:
    """In how many parameters the value lies in the other's interval, and how many there are."""
    names = ["lag", "acceleration_time", "offset", "dead_band"]
    shared = [name for name in names if name in result.intervals and name in other.intervals]
    values = [getattr(result.model, name) for name in shared] + [result.gain]
    intervals = [other.intervals[name] for name in shared] + [other.gain_interval]
    pairs = zip(values, intervals, strict=True)
    return sum(low <= value <= high for value, (low, high) in pairs), len(values)


def outside(result: Identification, log: planner.Log) -> tuple[str, ...]:
    """Quantities of a log beyond the tested range of a model that was not fitted to it."""
    kept = np.flatnonzero(log.torque_on)
    smooth = np.convolve(log.angles[kept], np.ones(SMOOTHED) / SMOOTHED, "valid")
    load = 0.0 if log.load is None else log.load
    return result.tested.exceeded(smooth, period=log.period, cyclic=False, load=load)


def errors_of(model: planner.JointModel, log: planner.Log) -> tuple[float, float]:
    """Error of a model on a log [rad], rms, and over the standard deviation of the motion."""
    joint = Parameters.of(model)
    window = joint.lag + joint.acceleration_time
    grid = resampled([log], tick=model.tick, reach=max(0.5, 1.2 * window), burn_in=window)
    error = rms(respond(grid, joint, grid.measured_starts).predicted - grid.angles)
    return error, error / grid.signal


def joints(options: Options) -> dict[str, list[planner.Log]]:
    """Every recording by joint, where they are at hand; the humanoid's with many instances."""
    folder = recordings()
    if folder is None:
        return {}
    found = {**so101(folder), **pendulums(folder)}
    return found | (humanoid(folder) if options.instances > 3 else {})


def so101(folder: Path) -> dict[str, list[planner.Log]]:
    """The recordings of the arm's joints in which they are moved."""
    logs: dict[str, list[planner.Log]] = {f"so101, {joint}": [] for joint in JOINTS}
    options = planner.LogOptions(joint="all", unit="rad,Jaw=range")
    for path in sorted((folder / "so101").glob("*.csv")):
        for log in planner.read_logs(path, options=options):
            if np.ptp(log.requests) > 0.0:
                logs[f"so101, {log.joint}"].append(replace(log, name=path.stem))
    return logs


def pendulums(folder: Path) -> dict[str, list[planner.Log]]:
    """The recordings of servos with pendulums, by servo and gain."""
    logs: dict[str, list[planner.Log]] = {}
    for servo in ("sts3250", "xl330"):
        for path in sorted((folder / servo).glob("*.csv")):
            name = ", ".join(path.stem.split("_")[:2])
            (log,) = planner.read_logs(path)
            logs.setdefault(name, []).append(replace(log, name=path.stem))
    return logs


def humanoid(folder: Path) -> dict[str, list[planner.Log]]:
    """The episodes of the humanoid's joints; hands in shares of their range."""
    info = json.loads((folder / "lerobot_g1" / "meta" / "info.json").read_text("utf-8"))
    (names,) = info["features"]["action"]["names"]
    joints = {}
    for name in names:
        options = planner.LogOptions(joint=name, unit="range" if "Hand" in name else "rad")
        logs = planner.read_logs(folder / "lerobot_g1", options=options)
        joints[f"g1, {name}"] = [log for log in logs if np.ptp(log.requests) > 0.0]
    return joints
