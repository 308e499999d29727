"""Identification: how near to the truth, how honest, how good on recordings, how fast."""

from __future__ import annotations

import math
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import planner
from benchmark.parts import Options
from benchmark.table import Table
from planner.identification.fit import fit_joint, with_observed_speed
from planner.identification.grid import timing_of
from planner.identification.terms import backlash_of, with_motor, with_terms
from tests.identification.made import random_servo

SEEDS = 10
"""Repetitions for each requested instance."""

AMPLITUDES = (30.0, 90.0), (40.0, 110.0), (30.0,)
"""Step tests [deg]; the second pair is the paper's."""

NOISE, QUANTUM = 0.2, 0.3
"""Noise and resolution of the sensor [deg]."""

FINE_NOISE, FINE_QUANTUM, STICKY_ROWS = 0.1, 0.09, 800
"""The same of a good encoder, and the rows of the logs with dry friction."""

CYCLES, SAMPLES = 3, 88

PENDULUMS = {
    "sts3250, three runs": ("sts3250", ("sin_sin", "sin_time_square", "up_and_down"), 32),
    "xl330, gain 100": ("xl330", ("sin_sin",), 100),
    "xl330, gain 800": ("xl330", ("sin_time_square",), 800),
}


def measure(options: Options) -> list[Table]:
    """Simulated logs, and the recordings where they are available."""
    seeds = SEEDS * options.instances
    tables = [coverage(seeds), friction(seeds), servos(2 * options.instances)]
    folder = os.environ.get("REQUEST_PLANNER_RECORDINGS", "")
    if folder and Path(folder).is_dir():
        tables.append(recordings(Path(folder)))
    return tables


def coverage(seeds: int) -> Table:
    """One row for each parameter and set of step tests."""
    table = Table(
        "Identification of step tests, made",
        ("in the interval, %", "rms error", "largest error", "half interval", "time, s"),
        note=f"The ERS-210A, {CYCLES} cycles of each amplitude, {NOISE:g} deg noise, {QUANTUM:g} "
        f"deg resolution, {seeds} seeds. v_max and theta_0 in %, times in ticks, the offset in "
        "degrees. Nothing is held out.",
        stub="amplitudes and parameter",
    )
    truth = planner.JointModel.ers210a()
    units = {
        "v_max": truth.v_max / 100.0,
        "theta_0": truth.theta_0 / 100.0,
        "lag": truth.tick,
        "acceleration_time": truth.tick,
        "offset": math.radians(1.0),
    }
    for amplitudes in AMPLITUDES:
        began = time.process_time()
        results = [
            planner.identify(step_logs(truth, amplitudes, seed), hold_out=False)
            for seed in range(seeds)
        ]
        seconds = (time.process_time() - began) / seeds
        for name, unit in units.items():
            true = getattr(truth, name)
            errors = np.array([getattr(result.model, name) - true for result in results]) / unit
            bounds = [result.intervals[name] for result in results]
            table.add(
                f"{' and '.join(f'{a:g}' for a in amplitudes)} deg: {name}",
                100.0 * float(np.mean([low <= true <= high for low, high in bounds])),
                float(np.sqrt(np.mean(errors**2))),
                float(np.max(np.abs(errors))),
                float(np.median([high - low for low, high in bounds])) / 2.0 / unit,
                seconds,
            )
    return table


def friction(seeds: int) -> Table:
    """One row for each dead band."""
    table = Table(
        "Identification of dry friction, made",
        ("kept, %", "in the interval, %", "rms error, %", "largest error, %", "half interval, %"),
        note=f"The ERS-210A with a dead band, {STICKY_ROWS} rows of random steps within 0.4 rad, "
        f"{FINE_NOISE:g} deg noise, {FINE_QUANTUM:g} deg resolution, {seeds} seeds.",
        stub="dead band, deg",
    )
    for degrees in (1.0, 2.0, 4.0):
        truth = replace(planner.JointModel.ers210a(), dead_band=math.radians(degrees))
        results = [
            planner.identify(sticky_log(truth, seed), hold_out=False) for seed in range(seeds)
        ]
        kept = np.array([result.model.dead_band > 0.0 for result in results])
        errors = np.array([result.model.dead_band for result in results]) / truth.dead_band - 1.0
        ends = np.array([result.intervals.get("dead_band", (0.0, 0.0)) for result in results])
        inside = (ends[:, 0] <= truth.dead_band) & (truth.dead_band <= ends[:, 1])
        table.add(
            f"{degrees:g}",
            100.0 * float(np.mean(kept)),
            100.0 * float(np.mean(inside)),
            100.0 * float(np.sqrt(np.mean(errors**2))),
            100.0 * float(np.max(np.abs(errors))),
            50.0 * float(np.median(ends[:, 1] - ends[:, 0])) / truth.dead_band,
        )
    return table


def servos(seeds: int) -> Table:
    """One row for each property of a servo besides a time constant and friction."""
    table = Table(
        "Backlash and acceleration limits in logs of servos, made",
        ("backlash, %", "acceleration limit, %", "median error of its size, %", "time, s"),
        note="Servos with a time constant and random constants, half of them with dry friction of "
        "0.5 to 2 degrees, in 30 s of random steps, sines and triangles; limits act in steps. "
        "Shares of the logs in which backlash is named, and a limit is a term of the model. Play "
        f"is 1 to 4 degrees, limits are 15 to 60 rad/s^2; {seeds} seeds.",
        stub="the servo has",
    )
    kinds: dict[str, tuple[str, float, float, dict[str, Any]]] = {
        "neither": ("", 0.0, 0.0, {}),
        "backlash": ("play", math.radians(1.0), math.radians(4.0), {}),
        "backlash behind its sensor": (
            "play",
            math.radians(1.0),
            math.radians(4.0),
            {"behind": True},
        ),
        "an acceleration limit": ("most", 15.0, 60.0, {"kinds": ("steps", "mixed")}),
    }
    for name, (defect, least, most, settings) in kinds.items():
        sizes: dict[str, list[float]] = {"play": [], "most": []}
        errors = []
        seconds = 0.0
        for seed in range(seeds):
            size = float(np.random.default_rng([seed, 1]).uniform(least, most))
            log = random_servo(seed, **({defect: size} if defect else {}), **settings)
            began = time.process_time()
            fit, terms = with_terms(*fit_joint([log], timing_of([log], tick=None, hold=None)))
            fit, _ = with_motor(fit, terms)
            backlash = backlash_of(with_observed_speed(fit))
            seconds += (time.process_time() - began) / seeds
            limit = fit.parameters.max_acceleration(fit.grid.tick)
            estimates = {"play": [backlash.size] if backlash else []}
            estimates["most"] = [limit] if math.isfinite(limit) else []
            errors += [abs(each / size - 1.0) for each in estimates.get(defect, [])]
            for kind, values in estimates.items():
                sizes[kind] += values
        table.add(
            name,
            *(100.0 * len(values) / seeds for values in sizes.values()),
            100.0 * float(np.median(errors)) if errors else math.nan,
            seconds,
        )
    return table


def sticky_log(model: planner.JointModel, seed: int) -> planner.Log:
    """Random steps of a joint with friction, as a good encoder reports them."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(4, 30, size=STICKY_ROWS)
    requests = np.repeat(rng.uniform(-0.4, 0.4, size=STICKY_ROWS), lengths)[:STICKY_ROWS]
    angles = np.degrees(planner.simulate(model, requests, cyclic=False))
    noisy = angles + rng.normal(scale=FINE_NOISE, size=len(angles))
    return planner.Log(
        times=np.arange(STICKY_ROWS) * model.period,
        requests=requests,
        angles=np.radians(np.round(noisy / FINE_QUANTUM) * FINE_QUANTUM),
    )


def step_logs(
    model: planner.JointModel, amplitudes: tuple[float, ...], seed: int
) -> list[planner.Log]:
    """Step tests as a noisy sensor of finite resolution reports them."""
    rng = np.random.default_rng(seed)
    logs = []
    for amplitude in amplitudes:
        requests = np.tile(planner.step_test(math.radians(amplitude), samples=SAMPLES), CYCLES)
        angles = np.degrees(planner.simulate(model, requests, cyclic=False, start=0.0))
        noisy = angles + rng.normal(scale=NOISE, size=len(angles))
        logs.append(
            planner.Log(
                times=np.arange(len(requests)) * model.period,
                requests=requests,
                angles=np.radians(np.round(noisy / QUANTUM) * QUANTUM),
            )
        )
    return logs


def recordings(folder: Path) -> Table:
    """One row for each joint."""
    table = Table(
        "Identification of recordings",
        ("raw", "delay", "first order", "model", "of motion, %", "all rows", "accepted", "time, s"),
        note="Errors (rms, rad; Jaw: share of its range) on the second half by fits to the first, "
        "that of the model over the standard deviation of the motion too, and the error of the "
        "model fitted to all rows.",
        stub="recording",
    )
    for name, logs in recorded(folder).items():
        began = time.process_time()
        result = planner.identify(logs)
        seconds = time.process_time() - began
        errors = [alternative.held_out_rms or math.nan for alternative in result.alternatives]
        error = result.held_out_rms or math.nan
        share = 100.0 * error / result.signal
        table.add(name, *errors, error, share, result.rms, float(result.accepted), seconds)
    return table


def recorded(folder: Path) -> dict[str, list[planner.Log]]:
    """The recordings by name."""
    options = planner.LogOptions(joint="all", unit="rad")
    arm = planner.read_logs(folder / "so101" / "prbs_excitation.csv", options=options)
    logs = {f"so101, {log.joint}": [log] for log in arm}
    for name, (servo, motions, gain) in PENDULUMS.items():
        paths = [folder / servo / f"{servo}_kp{gain}_{motion}.csv" for motion in motions]
        logs[name] = list(planner.read_logs(paths))
    return logs
