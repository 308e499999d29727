"""Descriptions of a joint: a delay, a first-order lag, the model, and how far it is right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

import planner
from benchmark.parts import Options
from benchmark.parts.identify import recovered
from benchmark.parts.pairs import joints
from benchmark.table import Table
from planner.arrays import Array, rms
from planner.model.evidence import expectation
from tests.identification.made import logged

TERMS = "dead band, mrad | time constant, ms | acceleration, rad/s^2"
"""Terms of a motor that a model may have."""

FITTED = ("prbs_excitation", "static_holding", "random_waypoints")
"""Recordings of the SO-101 that are fitted together; the rest are predicted."""

MOTION = 10.0  # length of the parts of a recording that are one motion each [s]
FAIR = (0.7, 1.4)  # range of the expected over the measured error that counts as right
SECONDS = 30.0  # length of the simulated logs
TICK = 0.0005  # of the joints that they are of [s]
PERIODS = (0.005, 0.0079, 0.0081, 0.01, 0.02)  # between the rows of logs of the same joint [s]


def measure(options: Options) -> list[Table]:
    """Simulated joints, and every available recording."""
    simulated, recorded = (
        [motors(4 * options.instances), rates(2 * options.instances)],
        joints(options),
    )
    arm = {name: logs for name, logs in recorded.items() if name.startswith("so101")}
    real = [halves(recorded), *unseen(arm)] if recorded else []
    return [*real, *simulated]


def halves(every: Mapping[str, Sequence[planner.Log]]) -> Table:
    """One row for each joint: the second halves of its recordings."""
    table = Table(
        "Models of joints on the second half of each recording, fitted to the first halves",
        f"joint | recordings | as it is | delay | first order | model | over a delay | {TERMS}",
        note="Root mean square errors in milliradians (Jaw and hands: thousandths of the range): "
        "of the request itself, the best pure delay, a delay with a first-order lag, and the model "
        "of this project, each fitted to all recordings of a joint together. so101: an arm of "
        "Feetech STS3215; sts3250, xl330: pendulums, the latter overloaded; g1: a humanoid.",
    )
    for name, logs in every.items():
        try:
            result = planner.identify(logs)
        except planner.InvalidInput:
            continue
        errors = [fit.held_out_rms for fit in result.alternatives] + [result.held_out_rms]
        scaled = [1e3 * error if error else math.nan for error in errors]
        table.add(name, len(logs), *scaled, scaled[3] / scaled[1], *terms(result))
    return table


def unseen(arm: Mapping[str, Sequence[planner.Log]]) -> list[Table]:
    """Models of three recordings of the arm on the others, and their expected errors."""
    tables = [
        Table(
            "Models of the SO-101's joints on recordings that were not fitted",
            f"joint | delay | model | worst | over a delay | {TERMS}",
            note="Root mean square errors in milliradians of motions of "
            f"{MOTION:g} s, median and worst; fitted are {', '.join(FITTED)}.",
        ),
        Table(
            "The error that is told of motions that were not fitted, over the one met",
            f"joint | motions | median | {FAIR[0]:g} to {FAIR[1]:g}, % | in the range, %",
            note="The same motions: the error to expect over the one met, in how many it is "
            f"between {FAIR[0]:g} and {FAIR[1]:g}, and how many are in the range of 5 to 95 %.",
        ),
    ]
    for name, logs in arm.items():
        fitted = [log for log in logs if log.name in FITTED]
        unfitted = [log for log in logs if log.name not in FITTED]
        if not fitted or not unfitted or "Jaw" in name:
            continue
        result = planner.identify(fitted)
        met, late, expected, low, high = motions_of(
            result, {log: parts_of(log) for log in unfitted}
        )
        model, pure = np.median(met), np.median(late)
        errors = 1e3 * pure, 1e3 * model, 1e3 * np.max(met), model / pure
        tables[0].add(name, *errors, *terms(result))
        shares = expected / met
        fair, inside = (shares >= FAIR[0]) & (shares <= FAIR[1]), (low <= met) & (met <= high)
        row = np.median(shares), 100.0 * np.mean(fair), 100.0 * np.mean(inside)
        tables[1].add(name, len(met), *row)
    return tables


def parts_of(log: planner.Log) -> list[slice]:
    """The rows of each motion of a recording, but for the first second of all."""
    length = round(MOTION / log.period)
    first = range(round(1.0 / log.period), len(log.times) - length + 1, length)
    parts = [slice(row, row + length) for row in first]
    return [part for part in parts if np.ptp(log.requests[part]) > 0.0]


def motions_of(result: planner.Identification, parts: Mapping[planner.Log, list[slice]]) -> Array:
    """Errors of the model and of the best delay in parts of logs, and the range to expect [rad].

    Shape (5, m): met, late, expected, low, high.
    """
    (delay,) = [each.parameters["delay"] for each in result.alternatives if each.name == "delay"]
    motions = []
    for log, some in parts.items():
        start = float(log.angles[0])
        predicted = planner.simulate(result.model, log.requests, cyclic=False, start=start)
        late = np.interp(log.times - delay, log.times, log.requests)
        for part in some:
            errors = [rms((angles - log.angles)[part]) for angles in (predicted, late)]
            planned = predicted[part]
            told = expectation(result.tested, planned, planned, period=log.period, cyclic=False)
            motions.append((*errors, told.error, told.low, told.high))
    return np.transpose(motions)


def terms(result: planner.Identification) -> tuple[float, ...]:
    """The terms of a motor, in the units of :data:`TERMS`; NaN where the model has none."""
    model = result.model
    limit = model.max_acceleration if np.isfinite(model.max_acceleration) else math.nan
    return 1e3 * model.dead_band or math.nan, 1e3 * model.time_constant or math.nan, limit


def motors(count: int) -> Table:
    """Joints with all terms of a motor."""
    truths = [motor(seed) for seed in range(count)]
    table = recovery(
        "Identification of motors, made",
        f"{count} joints with a time constant of 10 to 80 ms, an acceleration limit of 15 to 60 "
        "rad/s^2 and a dead band of 0.5 to 4 degrees together, each logged every 10 and every 20 "
        f"ms for {SECONDS:g} s: random steps, a triangle and sines within 1 rad; 0.1 degrees of "
        "noise, 0.09 of resolution, ticks of half a millisecond.",
    )
    rows(table, "", truths, (0.01, 0.02))
    return table


def rates(count: int) -> Table:
    """The same joints in logs of several rates."""
    without = {"time_constant": 0.0, "max_acceleration": math.inf}
    truths = [replace(motor(seed), **without) for seed in range(count)]
    table = recovery(
        "Identification of the same joints logged at several rates, made",
        f"As above, {count} joints without time constant and acceleration limit.",
    )
    for period in PERIODS:
        rows(table, f"{1e3 * period:g} ms: ", truths, (period,))
    return table


def motor(seed: int) -> planner.JointModel:
    """A random joint with inertia, a slow start and dry friction that it can overcome."""
    random = np.random.default_rng(seed)
    while True:
        speed, gain = random.uniform(3.0, 6.5), random.uniform(8.0, 20.0)
        try:
            return planner.JointModel(
                v_max=speed,
                theta_0=speed / gain,
                lag=random.uniform(0.005, 0.03),
                acceleration_time=random.uniform(0.002, 0.03),
                tick=TICK,
                time_constant=random.uniform(0.01, 0.08),
                max_acceleration=random.uniform(15.0, 60.0),
                dead_band=math.radians(random.uniform(0.5, 4.0)),
            )
        except planner.InvalidModel:
            continue


def recovery(title: str, note: str) -> Table:
    """A table of :func:`rows`."""
    columns = "found, % | in the interval, % | rms error | largest error | half interval"
    note += " Errors in % of the parameter, those of lag and window in ms."
    return Table(title, f"parameter | {columns}", note=note)


def rows(
    table: Table, stub: str, truths: Sequence[planner.JointModel], periods: Sequence[float]
) -> None:
    """One row for each parameter of joints with known parameters, logged at these periods."""
    results = [
        planner.identify(
            logged(joint, period=period, rows=round(SECONDS / period), seed=seed), hold_out=False
        )
        for period in periods
        for seed, joint in enumerate(truths)
    ]
    names = ["gain", "v_max", "lag", "acceleration_time", "dead_band"]
    names += ["time_constant", "max_acceleration"] if truths[0].has_inertia else []
    for name in names:
        late = name in ("lag", "acceleration_time")

        def unit(joint: planner.JointModel, name: str = name, late: bool = late) -> float:
            return 1e-3 if late else 0.01 * float(getattr(joint, name))

        table.add(stub + name, *recovered(results, [*truths] * len(periods), name, unit))
