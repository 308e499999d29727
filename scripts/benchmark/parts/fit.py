"""Piecewise-linear approximation: time against length, and beside what else there is."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import planner
from benchmark.instances import Instance, long_walk, reference
from benchmark.parts import Options
from benchmark.rivals import piecewise_linear
from benchmark.table import Table
from benchmark.timing import median_time, timed

SHORT = 1000
"""Samples up to which a time is the median of several."""

PATIENCE = 1.0
"""Seconds from which on one more call must do."""

SEGMENTS = 6

TOLERANCE = math.radians(2.0)
"""Largest error allowed where the fewest segments are sought [rad]."""


FASTER = 5.0
"""A joint so much faster than the ERS-210A's can keep the tolerance."""


def measure(options: Options) -> list[Table]:
    """Times by length, and the rivals that can be imported."""
    return [times(options), beside(options)]


def times(options: Options) -> Table:
    """One row for each length."""
    table = Table(
        "Approximation, time by length",
        ("chosen, s", "6 segments, s", "within 2 deg, s", "segments chosen", "within 2 deg"),
        note="The reference rotator's cycle over and over, its stroke changing slowly, for a joint "
        f"of {FASTER:g} times the ERS-210A's v_max.",
        stub="samples",
    )
    for samples in options.fit_lengths:
        instance = long_walk(samples)
        calls = [
            partial(ours, instance, faster=FASTER, **choice)
            for choice in ({}, {"segments": SEGMENTS}, {"max_error": TOLERANCE})
        ]
        answers, first = zip(*map(timed, calls), strict=True)
        again = [
            median_time(call, options.repeats) if samples <= SHORT else seconds
            for call, seconds in zip(calls, first, strict=True)
        ]
        table.add(f"{samples}", *again, answers[0].segments, answers[2].segments)
    return table


def ours(instance: Instance, *, faster: float = 1.0, **choice: Any) -> Any:
    """Our own approximation."""
    v_max = faster * instance.model.v_max
    return planner.fit_pwl(instance.desired, v_max=v_max, tick=instance.model.period, **choice)


def beside(options: Options) -> Table:
    """Every method on the reference joints, with the same number of segments."""
    missing = piecewise_linear.missing()
    left_out = f" Not installed, so left out: {', '.join(missing)}." if missing else ""
    table = Table(
        f"Approximation, {SEGMENTS} segments, side by side",
        ("rms, deg", "steepest over v_max", "ends apart, deg", "time, ms"),
        note=f"The reference joints' cycle, its first sample once more at its end.{left_out}",
        stub="joint and method",
    )
    for instance in reference():
        methods = {"fit_pwl": partial(our_knots, instance)}
        for name, method in piecewise_linear.available().items():
            methods[name] = partial(
                method, instance.desired, SEGMENTS, instance.model.v_max * instance.model.period
            )
        for name, call in methods.items():
            add(table, instance, name, call, options.repeats)
    return table


def our_knots(instance: Instance) -> piecewise_linear.Knots:
    """Knots and values of our own approximation, over one cycle and the way back to its start."""
    fit = ours(instance, segments=SEGMENTS)
    samples = len(instance.desired)
    inner = fit.knots[(fit.knots > 0.0) & (fit.knots < samples)]
    knots = np.array([0.0, *inner, samples])
    return knots, fit(knots)


def add(
    table: Table,
    instance: Instance,
    name: str,
    call: Callable[[], piecewise_linear.Knots],
    repeats: int,
) -> None:
    """A row: how near the curve comes, and what it breaks."""
    (knots, values), first = timed(call)
    seconds = median_time(call, repeats if first < PATIENCE else 1)
    errors = np.interp(np.arange(len(instance.desired)), knots, values) - instance.desired
    steepest = np.max(np.abs(np.diff(values) / np.diff(knots))) / instance.model.period
    table.add(
        f"{instance.name}: {name}",
        math.degrees(float(np.sqrt(np.mean(errors**2)))),
        float(steepest / instance.model.v_max),
        math.degrees(abs(float(values[-1] - values[0]))),
        1e3 * seconds,
    )
