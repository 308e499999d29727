"""Time and memory against the length of the trajectory, each length in a process of its own."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from math import degrees
from pathlib import Path

import planner
from benchmark.instances import long_walk
from benchmark.parts import Options
from benchmark.table import Table
from benchmark.timing import timed

SHORT = 1000
"""Samples up to which the time is the best of three."""

BOUNDARIES = {"cyclic": True, "from rest": False}


def measure(options: Options) -> list[Table]:
    """One row for each length and boundary."""
    table = Table(
        "Length",
        (
            "first solve, s",
            "second, s",
            "over the shortest",
            "length over the shortest",
            "rms, deg",
            "over envelope, %",
            "peak memory, MB",
        ),
        note="The reference rotator's cycle over and over, its stroke changing slowly. Smoothed "
        "as by default.",
        stub="trajectory",
    )
    for name, cyclic in BOUNDARIES.items():
        runs = [in_child(samples, cyclic=cyclic) for samples in options.lengths]
        for samples, run in zip(options.lengths, runs, strict=True):
            table.add(
                f"{samples} samples, {name}",
                run["first"],
                run["again"],
                run["again"] / runs[0]["again"],
                samples / options.lengths[0],
                run["rms"],
                run["gap"],
                run["memory"],
            )
    return [table]


def in_child(samples: int, *, cyclic: bool) -> dict[str, float]:
    """Measure one length in a process of its own, so that its memory is its own too."""
    command = [sys.executable, "-P", "-m", __name__, str(samples), *(["cyclic"] if cyclic else [])]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    child = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if child.returncode:
        raise RuntimeError(f"{samples} samples: {child.stderr.strip()}")
    run: dict[str, float] = json.loads(child.stdout)
    return run


def solve(samples: int, *, cyclic: bool) -> dict[str, float]:
    """Time [s], rms [deg], gap [%] and, of this process until then, peak memory [MB]."""
    instance, warm_up = long_walk(samples), long_walk(90)

    def plan() -> planner.Inversion:
        return planner.invert_optimal(
            instance.model, instance.desired, limits=instance.limits, cyclic=cyclic
        )

    planner.invert_optimal(warm_up.model, warm_up.desired, cyclic=cyclic)
    result, first = timed(plan)
    again = min(timed(plan)[1] for _ in range(3 if samples <= SHORT else 1))
    memory = peak_memory()
    return {
        "first": first,
        "again": again,
        "rms": degrees(result.rms),
        "gap": 100.0 * result.gap,
        "memory": memory,
    }


def peak_memory() -> float:
    """Most memory that this process has held [MB]."""
    status = Path("/proc/self/status")
    if status.is_file():  # Linux counts what the parent held before exec into ru_maxrss
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
        if "VmHWM" in fields:
            return int(fields["VmHWM"].split()[0]) / 1024.0
    unit = 1024.0**2 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


if __name__ == "__main__":
    answer = solve(int(sys.argv[1]), cyclic="cyclic" in sys.argv[2:])
    sys.stdout.write(json.dumps(answer))
