"""Identification: how near to the truth, how honest, how good on recordings, how fast."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import planner
from benchmark.parts import Options
from benchmark.table import Table
from planner.arrays import rms
from planner.identification.grid import timing_of
from planner.identification.joint_fit import fit_joint, with_observed_speed
from planner.identification.terms import backlash_of, with_motor, with_terms
from tests.identification.made import (
    NOISE,
    QUANTUM,
    measured,
    random_motion,
    servo,
    step_logs,
)

SEEDS = 10  # repetitions for each requested instance
AMPLITUDES = (30.0, 90.0), (40.0, 110.0), (30.0,)
"""Step tests [deg]; the second pair is the paper's."""


def measure(options: Options) -> list[Table]:
    """Simulated logs; the part ``models`` is about the recordings."""
    return [coverage(SEEDS * options.instances), servos(2 * options.instances)]


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
            _, *row = recovered(results, [truth] * seeds, name, lambda _, unit=unit: unit)
            table.add(f"{' and '.join(f'{a:g}' for a in amplitudes)} deg: {name}", *row, seconds)
    return table


def recovered(
    results: Sequence[planner.Identification],
    truths: Sequence[planner.JointModel],
    name: str,
    unit: Callable[[planner.JointModel], float],
) -> tuple[float, ...]:
    """How a parameter is found of joints for which it is known, by a unit for each.

    The shares of the logs that determine it, and whose interval holds it [%]; of the first ones the
    rms error, the largest error, and the median half interval.
    """
    rows = []
    for joint, found in zip(truths, results, strict=True):
        true, value = (getattr(model, name) for model in (joint, found.model))
        ends = found.gain_interval if name == "gain" else found.intervals.get(name)
        low, high = ends or (math.nan, math.nan)
        size = unit(joint)
        rows.append(((value - true) / size, low <= true <= high, (high - low) / 2.0 / size))
    errors, inside, half = np.array(rows).T
    kept = np.isfinite(half)
    shares = 100.0 * np.mean(kept), 100.0 * np.mean(inside)
    return *shares, rms(errors[kept]), np.max(np.abs(errors[kept])), np.median(half[kept])


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
            (plain,) = fit_joint([log], timing_of([log], tick=None, hold=None))
            fit = with_motor(with_terms(plain))
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


def random_servo(
    seed: int, *, kinds: tuple[str, ...] = ("steps", "sines", "mixed"), **defects: Any
) -> planner.Log:
    """A log of a servo whose constants are random, with the defects that are asked for.

    Half of them have dry friction of 0.5 to 2 degrees; noise of 0.02 to 0.2 degrees, steps of the
    sensor of 0, 0.09 or 0.3.
    """
    random = np.random.default_rng(seed)
    period = float(random.choice((0.01, 0.02)))
    known = {
        "top": random.uniform(2.5, 6.0),
        "gain": random.uniform(8.0, 20.0),
        "delay": random.uniform(0.005, 0.03),
        "constant": random.uniform(0.01, 0.05),
        "friction": math.radians(random.choice([0.0, random.uniform(0.5, 2.0)])),
    }
    noise = math.radians(random.uniform(0.02, 0.2))
    quantum = math.radians(float(random.choice([0.0, 0.09, 0.3])))
    kind = str(random.choice(kinds))
    requests = random_motion(random, period, kind=kind, seconds=30.0, span=0.6)
    angles = servo(requests, period, **known, **defects)
    seen = measured(angles, random, noise=noise, quantum=quantum)
    return planner.Log(times=period * np.arange(len(requests)), requests=requests, angles=seen)
