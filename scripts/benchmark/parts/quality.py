"""Gaps between the errors of plans and lower bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

import planner
from benchmark.instances import Instance, random_attainable, random_saturating, reference
from benchmark.parts import Options
from benchmark.table import Table

REQUESTS = "largest request step, deg | beyond the desired range, deg"


def measure(options: Options) -> list[Table]:
    """Gaps in both norms, and errors where the joint can follow."""
    # Random instances cost less here than side by side: three times as many.
    seeds = range(3 * options.instances)
    saturating = [random_saturating(seed, samples=options.samples) for seed in seeds]
    attainable = [random_attainable(seed, samples=options.samples) for seed in seeds]
    return [
        *(gaps(saturating, norm, options.exact) for norm in ("rms", "max")),
        attained(attainable),
    ]


def gaps(population: Sequence[Instance], norm: str, exact: float) -> Table:
    """The error of each plan over its bounds, less one."""
    levels = ("slope", "envelope", *(["exact"] if exact else []))
    limited = f" Exact bounds were given {exact:g} s each." if exact else ""
    error = "rms error" if norm == "rms" else "largest error"
    table = Table(
        f"Gaps, {error}",
        " | ".join(
            ["instance", f"{error}, deg", *(f"over {level}, %" for level in levels), REQUESTS]
        ),
        note=f"{len(population)} random instances that cannot follow, without smoothing.{limited}",
    )

    def row(instance: Instance) -> tuple[float, ...]:
        model, desired = instance.model, instance.desired
        plan = planner.invert_optimal(
            model, desired, limits=instance.asked_limits, norm=norm, smoothness=0.0
        )
        over = []
        for level in levels:
            effort = {"time_limit": exact} if level == "exact" else {}
            bound = planner.lower_bound(model, desired, norm=norm, level=level, **effort)
            over.append(100.0 * (plan.error / bound - 1.0) if bound > 0.0 else math.inf)
        return (math.degrees(plan.error), *over, *np.degrees([plan.largest_step, plan.excess]))

    for instance in reference():
        table.add(instance.name, *row(instance))
    random = np.array([row(instance) for instance in population])
    table.add("random, median", *np.median(random, axis=0))
    table.add("random, 95th percentile", *np.percentile(random, 95.0, axis=0))
    table.add("random, worst", *np.max(random, axis=0))
    return table


def attained(population: Sequence[Instance]) -> Table:
    """Errors on trajectories that leave the joint room: next to none are expected."""
    table = Table(
        "Trajectories that the joint can follow",
        f"instance | rms error, deg | {REQUESTS}",
        note=f"{len(population)} random instances, smoothed as by default.",
    )
    plans = [planner.invert_optimal(instance.model, instance.desired) for instance in population]
    rows = np.degrees([(plan.rms, plan.largest_step, plan.excess) for plan in plans])
    table.add("median", *np.median(rows, axis=0))
    table.add("worst", *np.max(rows, axis=0))
    return table
