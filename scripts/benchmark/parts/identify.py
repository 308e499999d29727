"""Identification: how near to the truth, how honest, how good on recordings, how fast."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import planner
from benchmark.parts import Options, recordings
from benchmark.servo_logs import random_servo
from benchmark.table import Table
from planner.identification.grid import timing_of
from planner.identification.joint_fit import fit_joint, with_observed_speed
from planner.identification.terms import backlash_of, with_motor, with_terms
from planner.trajectory import rms
from tests.identification.made import (
    FINE_NOISE,
    FINE_QUANTUM,
    NOISE,
    QUANTUM,
    rich_log,
    step_logs,
)

SEEDS = 10  # repetitions for each requested instance
AMPLITUDES = (30.0, 90.0), (40.0, 110.0), (30.0,)
"""Step tests [deg]; the second pair is the paper's."""

FINE = {"noise": FINE_NOISE, "quantum": FINE_QUANTUM}  # a good encoder
STICKY_ROWS = 800  # rows of the logs with dry friction
PENDULUMS = {
    "sts3250, three runs": ("sts3250", ("sin_sin", "sin_time_square", "up_and_down"), 32),
    "xl330, gain 100": ("xl330", ("sin_sin",), 100),
    "xl330, gain 800": ("xl330", ("sin_time_square",), 800),
}


def measure(options: Options) -> list[Table]:
    """Simulated logs, and the recordings where they are available."""
    seeds = SEEDS * options.instances
    tables = [coverage(seeds), friction(seeds), servos(2 * options.instances)]
    folder = recordings()
    return [*tables, *([of_recordings(folder)] if folder else [])]


def coverage(seeds: int) -> Table:
    """One row for each parameter and set of step tests."""
    table = Table(
        "Identification of step tests, made",
        "amplitudes and parameter | in the interval, % | rms error | largest error"
        " | half interval | time, s",
        note=f"The ERS-210A, 3 cycles of each amplitude, {math.degrees(NOISE):g} deg noise, "
        f"{math.degrees(QUANTUM):g} deg resolution, {seeds} seeds. v_max and theta_0 in %, times "
        "in ticks, the offset in degrees. Nothing is held out.",
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
        began, angles = time.process_time(), np.radians(amplitudes)
        results = [
            planner.identify(step_logs(truth, seed=seed, amplitudes=angles), hold_out=False)
            for seed in range(seeds)
        ]
        seconds = (time.process_time() - began) / seeds
        for name, unit in units.items():
            true = getattr(truth, name)
            errors = np.array([getattr(result.model, name) - true for result in results]) / unit
            low, high = np.transpose([result.intervals[name] for result in results])
            table.add(
                f"{' and '.join(f'{a:g}' for a in amplitudes)} deg: {name}",
                100.0 * np.mean((low <= true) & (true <= high)),
                rms(errors),
                np.max(np.abs(errors)),
                np.median(high - low) / 2.0 / unit,
                seconds,
            )
    return table


def friction(seeds: int) -> Table:
    """One row for each dead band."""
    table = Table(
        "Identification of dry friction, made",
        "dead band, deg | kept, % | in the interval, % | rms error, % | largest error, %"
        " | half interval, %",
        note=f"The ERS-210A with a dead band, {STICKY_ROWS} rows of random steps within 0.4 rad, "
        f"{math.degrees(FINE_NOISE):g} deg noise, {math.degrees(FINE_QUANTUM):g} deg resolution, "
        f"{seeds} seeds.",
    )
    for degrees in (1.0, 2.0, 4.0):
        truth = replace(planner.JointModel.ers210a(), dead_band=math.radians(degrees))
        asked = {"rows": STICKY_ROWS, "amplitude": 0.4, **FINE}
        logs = [rich_log(truth, seed=seed, **asked) for seed in range(seeds)]
        results = [planner.identify(log, hold_out=False) for log in logs]
        kept = np.array([result.model.dead_band > 0.0 for result in results])
        errors = np.array([result.model.dead_band for result in results]) / truth.dead_band - 1.0
        ends = [result.intervals.get("dead_band", (0.0, 0.0)) for result in results]
        low, high = np.transpose(ends)
        inside = (low <= truth.dead_band) & (truth.dead_band <= high)
        half = np.median(high - low) / 2.0 / truth.dead_band
        row = np.mean(kept), np.mean(inside), rms(errors), np.max(np.abs(errors)), half
        table.add(f"{degrees:g}", *(100.0 * np.array(row)))
    return table


def servos(seeds: int) -> Table:
    """One row for each property of a servo besides a time constant and friction."""
    table = Table(
        "Backlash and acceleration limits in logs of servos, made",
        "the servo has | backlash, % | acceleration limit, % | median error of its size, %"
        " | time, s",
        note="Servos with a time constant and random constants, half of them with dry friction of "
        "0.5 to 2 degrees, in 30 s of random steps, sines and triangles; limits act in steps. "
        "Shares of the logs in which backlash is named, and a limit is a term of the model. Play "
        f"is 1 to 4 degrees, limits are 15 to 60 rad/s^2; {seeds} seeds.",
    )
    play = math.radians(1.0), math.radians(4.0)
    kinds: dict[str, tuple[str, tuple[float, float], dict[str, Any]]] = {
        "neither": ("", (0.0, 0.0), {}),
        "backlash": ("play", play, {}),
        "backlash behind its sensor": ("play", play, {"behind": True}),
        "an acceleration limit": ("most", (15.0, 60.0), {"kinds": ("steps", "mixed")}),
    }
    for name, (defect, sizes_of, settings) in kinds.items():
        sizes: dict[str, list[float]] = {"play": [], "most": []}
        errors, seconds = [], 0.0
        for seed in range(seeds):
            size = float(np.random.default_rng([seed, 1]).uniform(*sizes_of))
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
        shares = (100.0 * len(values) / seeds for values in sizes.values())
        table.add(name, *shares, 100.0 * np.median(errors) if errors else math.nan, seconds)
    return table


def of_recordings(folder: Path) -> Table:
    """One row for each joint."""
    table = Table(
        "Identification of recordings",
        "recording | raw | delay | first order | model | of motion, % | all rows | accepted"
        " | time, s",
        note="Errors (rms, rad; Jaw: share of its range) on the second half by fits to the first, "
        "that of the model over the standard deviation of the motion too, and the error of the "
        "model fitted to all rows.",
    )
    for name, logs in recorded(folder).items():
        began = time.process_time()
        result = planner.identify(logs)
        seconds = time.process_time() - began
        tested = (*result.alternatives, result)
        errors = [each.held_out_rms or math.nan for each in tested]
        share = 100.0 * errors[-1] / result.signal
        table.add(name, *errors, share, result.rms, result.accepted, seconds)
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
