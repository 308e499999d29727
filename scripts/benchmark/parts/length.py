"""Time and memory against the length of the trajectory, each length in a process of its own."""

from __future__ import annotations

import json
import sys
from functools import partial
from math import degrees

import planner
from benchmark.instances import long_walk
from benchmark.machine import in_child, peak_memory, timed
from benchmark.parts import Options
from benchmark.table import Table

SHORT = 1000  # samples up to which the time is the best of three


def measure(options: Options) -> list[Table]:
    """One row for each length and boundary."""
    table = Table(
        "Length",
        "trajectory | first solve, s | second, s | over the shortest | length over the shortest"
        " | rms, deg | over envelope, % | peak memory, MB",
        note="The reference rotator's cycle over and over, its stroke changing slowly. Smoothed "
        "as by default.",
    )
    for boundary in ("cyclic", "from rest"):
        shortest = None
        for samples in options.lengths:
            first, again, *rest = in_child(__name__, samples, boundary)
            shortest = shortest or again
            longer = samples / options.lengths[0]
            table.add(
                f"{samples} samples, {boundary}", first, again, again / shortest, longer, *rest
            )
    return [table]


def solve(samples: int, *, cyclic: bool) -> list[float]:
    """Times [s], rms [deg], gap [%] and, of this process until then, peak memory [MB]."""
    instance, warm_up = long_walk(samples), long_walk(90)
    planner.invert_optimal(warm_up.model, warm_up.desired, cyclic=cyclic)
    options = {"limits": instance.limits, "cyclic": cyclic}
    plan = partial(planner.invert_optimal, instance.model, instance.desired, **options)
    result, first = timed(plan)
    again = min(timed(plan)[1] for _ in range(3 if samples <= SHORT else 1))
    memory = peak_memory()
    return [first, again, degrees(result.rms), 100.0 * result.gap, memory]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(solve(int(sys.argv[1]), cyclic=sys.argv[2] == "cyclic")))
