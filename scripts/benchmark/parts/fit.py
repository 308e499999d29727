"""Piecewise-linear approximation: time against length, and beside its rivals."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import planner
from benchmark.instances import Instance, long_walk, reference
from benchmark.machine import median_time, timed
from benchmark.parts import Options
from benchmark.rivals import piecewise_linear
from benchmark.table import Table
from planner.arrays import rms

PATIENCE = 1.0  # seconds up to which a call is repeated, and its time the median
SEGMENTS = 6

TOLERANCE = math.radians(2.0)  # largest error allowed where the fewest segments are sought [rad]
WITHIN = 0.05  # largest error where the fewest segments are counted, of samples of a range of one
LOOSE_SEGMENTS = (2, 3, 4, 5, 6, 7, 8)  # numbers of segments at which pwlf is met
LOOSE = 1000.0  # a bound of so many v_max binds nowhere
CURVES = (1, 100, 10_000)  # curves that are turned into requests at once
SAMPLES = 88  # samples of the reference walk's cycle
RULES = ("paper", "exact")

Call = Callable[[], piecewise_linear.Knots]

FASTER = 5.0  # a joint so much faster than the ERS-210A's can keep the tolerance
SIDE_BY_SIDE = "rms, deg | steepest over v_max | ends apart, deg | time, ms | time over fit_pwl"


def measure(options: Options) -> list[Table]:
    """Times by length, and the rivals that can be imported."""
    tables = (times, fewest, beside, loose, known_curves)
    return [table(options) for table in tables]


def times(options: Options) -> Table:
    """One row for each length."""
    table = Table(
        "Approximation, time by length",
        "samples | chosen, s | 6 segments, s | within 2 deg, s | segments chosen | within 2 deg",
        note="The reference rotator's cycle over and over, its stroke changing slowly, for a joint "
        f"of {FASTER:g} times the ERS-210A's v_max.",
    )
    for samples in options.fit_lengths:
        instance = long_walk(samples)
        fits, seconds = [], []
        for choice in ({}, {"segments": SEGMENTS}, {"max_error": TOLERANCE}):
            fit, took = typical(partial(ours, instance, faster=FASTER, **choice), options.repeats)
            fits.append(fit)
            seconds.append(took)
        table.add(f"{samples}", *seconds, fits[0].segments, fits[2].segments)
    return table


def fewest(options: Options) -> Table:
    """One row for each kind of samples, each a path and a cycle, of every length."""
    table = Table(
        "Approximation, fewest segments for a largest error",
        "samples | segments | lower bound | rms error over the largest | time, s",
        note=f"Samples of a range of one, for a largest error of {WITHIN:g} and slopes of the "
        "samples' own at most, or a hundredth of the range where that is less.",
    )
    for samples in options.fit_lengths:
        for kind, desired in series(samples).items():
            step = max(float(np.max(np.abs(np.diff(desired)))), 0.01)
            asked = {"v_max": step, "tick": 1.0, "max_error": WITHIN}
            for cyclic in (False, True):
                call = partial(planner.fit_pwl, desired, cyclic=cyclic, **asked)
                fit, seconds = typical(call, options.repeats)
                name = f"{samples}, {kind}, {'cycle' if cyclic else 'path'}"
                table.add(name, fit.segments, fit.fewest_segments or 0, fit.rms / WITHIN, seconds)
    return table


def series(samples: int) -> dict[str, np.ndarray]:
    """Samples of every kind, of a range of one, that come back to where they began."""
    rng = np.random.default_rng(samples)
    turn = np.arange(samples) / samples
    sines = sum(
        np.sin(2.0 * np.pi * (waves * turn + rng.uniform())) / waves
        for waves in rng.integers(1, 2 + samples // 40, size=4)
    )
    walk = np.cumsum(rng.normal(size=samples))
    shapes = {
        "sines": np.asarray(sines),
        "noise": rng.normal(size=samples),
        "random walk": walk - walk[-1] * turn,
        "chirp": np.sin(0.25 * np.pi * samples * turn * (1.0 - turn)),
    }
    return {kind: desired / np.ptp(desired) for kind, desired in shapes.items()}


def ours(instance: Instance, *, faster: float = 1.0, **choice: Any) -> Any:
    """Our own approximation."""
    v_max = faster * instance.model.v_max
    return planner.fit_pwl(instance.desired, v_max=v_max, tick=instance.model.period, **choice)


def beside(options: Options) -> Table:
    """Every method on the reference joints, with the same number of segments."""
    table = Table(
        f"Approximation, {SEGMENTS} segments, side by side",
        f"joint and method | {SIDE_BY_SIDE}",
        note=f"The reference joints' cycle, its first sample once more at its end.{left_out()}",
    )
    for instance in reference():
        ours_first: dict[str, Call] = {"fit_pwl": partial(our_cycle, instance)}
        add_all(table, instance, ours_first | rivals(instance, SEGMENTS), options.repeats)
    return table


def loose(options: Options) -> Table:
    """The same samples as a path with free ends and no bound on slopes, as pwlf takes them."""
    table = Table(
        "Approximation, ends free and slopes unbounded",
        f"joint, segments and method | {SIDE_BY_SIDE}",
        note=f"The reference joints' cycle, its first sample once more at its end.{left_out()}",
    )
    for instance in reference():
        for segments in LOOSE_SEGMENTS:
            methods: dict[str, Call] = {"fit_pwl": partial(our_path, instance, segments)}
            both = methods | rivals(instance, segments, "pwlf fit")
            add_all(table, instance, both, options.repeats, f", {segments}")
    return table


def known_curves(options: Options) -> Table:
    """Requests from curves, many at once."""
    table = Table(
        "Closed form of known curves, microseconds per cycle",
        "curves at once | " + " | ".join(f"rule {rule!r}" for rule in RULES),
        note=f"The reference rotator's {SEGMENTS} segments, scaled at random, {SAMPLES} samples "
        "a cycle, by closed_form_requests.",
    )
    rotator = reference()[0]
    fit = ours(rotator, segments=SEGMENTS)
    rng = np.random.default_rng(0)
    for curves in CURVES:
        values = fit.values * rng.uniform(0.5, 1.0, size=(curves, 1))
        grid = {"samples": fit.samples, "tick": fit.tick, "cyclic": True}
        stack = planner.CurveStack(knots=fit.knots, values=values, **grid)
        for_each = [
            partial(planner.closed_form_requests, rotator.model, stack, rule=rule) for rule in RULES
        ]
        seconds = [typical(call, options.repeats)[1] for call in for_each]
        table.add(f"{curves}", *(1e6 * np.array(seconds) / curves))
    return table


def left_out() -> str:
    """Which rivals are not there, in words."""
    missing = piecewise_linear.missing()
    if not missing:
        return ""
    return f" Not installed, so left out: {', '.join(missing)} (the extra 'bench' has them)."


def rivals(instance: Instance, segments: int, *only: str) -> dict[str, Call]:
    """The other methods that can be imported."""
    step = instance.model.v_max * instance.model.period
    return {
        name: partial(method, instance.desired, segments, step)
        for name, method in piecewise_linear.available().items()
        if name in only or not only
    }


def our_cycle(instance: Instance, segments: int = SEGMENTS) -> piecewise_linear.Knots:
    """Knots and values of our own approximation, over one cycle and the way back to its start."""
    fit = ours(instance, segments=segments)
    samples = len(instance.desired)
    inner = fit.knots[(fit.knots > 0.0) & (fit.knots < samples)]
    knots = np.array([0.0, *inner, samples])
    return knots, fit(knots)


def our_path(instance: Instance, segments: int) -> piecewise_linear.Knots:
    """Knots and values of our own approximation where the ends are free and slopes unbounded."""
    closed = instance._replace(desired=np.append(instance.desired, instance.desired[0]))
    fit = ours(closed, faster=LOOSE, segments=segments, cyclic=False)
    return fit.knots, fit.values


def add_all(
    table: Table, instance: Instance, methods: dict[str, Call], repeats: int, more: str = ""
) -> None:
    """A row for each method, ours first: the error of the curve, and its violations."""
    ours_took = math.nan
    for name, call in methods.items():
        (knots, values), seconds = typical(call, repeats)
        ours_took = seconds if name == "fit_pwl" else ours_took
        closed = np.append(instance.desired, instance.desired[0])
        errors = np.interp(np.arange(len(closed)), knots, values) - closed
        steepest = np.max(np.abs(np.diff(values) / np.diff(knots))) / instance.model.period
        table.add(
            f"{instance.name}{more}: {name}",
            math.degrees(rms(errors)),
            steepest / instance.model.v_max,
            math.degrees(abs(values[-1] - values[0])),
            1e3 * seconds,
            seconds / ours_took,
        )


def typical(call: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    """What a call returns, and its typical time [s]."""
    answer, first = timed(call)
    return answer, median_time(call, repeats) if first < PATIENCE else first
