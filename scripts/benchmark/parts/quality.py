"""Gaps between the errors of plans and lower bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

import planner
from benchmark.instances import FREE, Instance, random_attainable, random_saturating, reference
from benchmark.parts import Options
from benchmark.table import Table


def measure(options: Options) -> list[Table]:
    """Gaps in both norms, and errors where the joint can follow."""
    instances = reference()
    # Random instances cost less here than side by side: three times as many.
    seeds = range(3 * options.instances)
    saturating = [random_saturating(seed, samples=options.samples) for seed in seeds]
    attainable = [random_attainable(seed, samples=options.samples) for seed in seeds]
    return [
        gaps(instances, saturating, "rms", options.exact),
        gaps(instances, saturating, "max", options.exact),
        attained(attainable),
    ]


def gaps(
    instances: Sequence[Instance], population: Sequence[Instance], norm: str, exact: float
) -> Table:
    """The error of each plan over its bounds, less one."""
    levels = ("slope", "envelope", *(["exact"] if exact else []))
    limited = f" Exact bounds were given {exact:g} s each." if exact else ""
    error = "rms error" if norm == "rms" else "largest error"
    table = Table(
        f"Gaps, {error}",
        (
            f"{error}, deg",
            *(f"over {level}, %" for level in levels),
            "largest request step, deg",
            "beyond the desired range, deg",
        ),
        note=f"{len(population)} random instances that cannot follow, without smoothing.{limited}",
        stub="instance",
    )
    rows = [gap_row(instance, norm, levels, exact) for instance in (*instances, *population)]
    for instance, row in zip(instances, rows, strict=False):
        table.add(instance.name, *row)
    random = np.array(rows[len(instances) :])
    table.add("random, median", *np.median(random, axis=0))
    table.add("random, 95th percentile", *np.percentile(random, 95.0, axis=0))
    table.add("random, worst", *np.max(random, axis=0))
    return table


def gap_row(
    instance: Instance, norm: str, levels: Sequence[str], exact: float
) -> tuple[float, ...]:
    """Error [deg], gaps [%], largest step [deg] and excess [deg] of one plan."""
    model, desired = instance.model, instance.desired
    limits = None if instance.limits == FREE else instance.limits
    plan = planner.invert_optimal(model, desired, limits=limits, norm=norm, smoothness=0.0)
    error = plan.rms if norm == "rms" else plan.max_error
    over = []
    for level in levels:
        effort = {"time_limit": exact} if level == "exact" else {}
        bound = planner.lower_bound(model, desired, norm=norm, level=level, **effort)
        over.append(100.0 * (error / bound - 1.0) if bound > 0.0 else math.inf)
    return (math.degrees(error), *over, *map(math.degrees, (plan.largest_step, plan.excess)))


def attained(population: Sequence[Instance]) -> Table:
    """Errors on trajectories that leave the joint room: next to none are expected."""
    table = Table(
        "Trajectories that the joint can follow",
        ("rms error, deg", "largest request step, deg", "beyond the desired range, deg"),
        note=f"{len(population)} random instances, smoothed as by default.",
        stub="instance",
    )
    plans = [planner.invert_optimal(instance.model, instance.desired) for instance in population]
    rows = np.degrees([(plan.rms, plan.largest_step, plan.excess) for plan in plans])
    table.add("median", *np.median(rows, axis=0))
    table.add("worst", *np.max(rows, axis=0))
    return table
