"""Many episodes: plans per second, scaling over workers, overhead per task, and memory.

Times are wall-clock and valid on a quiet machine only; processor times beside them are valid on a
busy one, too.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np

import planner
from benchmark.parts import Options
from benchmark.parts.length import peak_memory
from benchmark.table import Table
from planner.files.results import Results, Task
from planner.parallel import carry_out, executor_of

JOINT = planner.JointModel(v_max=5.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=1 / 30)
"""A hobby servo, requested 30 times a second."""

SAMPLES = 90
"""Of an episode: three seconds."""

JOINTS = 6
"""Of an arm."""

EPISODES = 300
"""Episodes for the times; 40 with ``--quick``."""

MANY = 10_000
"""Episodes for the memory; 200 with ``--quick``."""


def desired_angles(seed: int) -> np.ndarray:
    """The desired angles of an episode [rad], shape (n, k)."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-0.8, 0.8, size=(5, JOINTS))
    rows = np.linspace(0.0, 4.0, SAMPLES)
    return np.column_stack([np.interp(rows, range(5), column) for column in ends.T])


def episode(seed: int) -> bytes:
    """Its requests, after the processor time [s] and the peak memory of this process [MB]."""
    began = process_time()
    requests = planner.plan(JOINT, desired_angles(seed), cyclic=False).requests
    spent = np.array([process_time() - began, peak_memory()])
    return spent.tobytes() + requests.tobytes()


def simulated(seed: int) -> bytes:
    """Angles when an episode is requested as it is, after the same two numbers."""
    began = process_time()
    angles = [planner.simulate(JOINT, column, cyclic=False) for column in desired_angles(seed).T]
    spent = np.array([process_time() - began, peak_memory()])
    return spent.tobytes() + np.column_stack(angles).tobytes()


def nothing(_: int) -> bytes:
    """A task that takes no time."""
    return np.zeros(2).tobytes()


def tasks(count: int) -> list[Task]:
    """Episodes, one after the other."""
    return [Task(f"episode {number}", number) for number in range(count)]


def carried_out(
    function: Callable[[int], bytes], count: int, executor: Executor
) -> dict[str, float]:
    """Times of some tasks [s], and the peak memory of a worker [MB]."""
    with TemporaryDirectory() as folder:
        warm = Results(Path(folder) / "warm", {})
        carry_out(simulated, tasks(8), warm, executor)  # starts the workers
        results = Results(Path(folder) / "measured", {})
        began, spent = perf_counter(), process_time()
        failures = carry_out(function, tasks(count), results, executor)
        seconds, beside = perf_counter() - began, process_time() - spent
        if failures:
            raise RuntimeError(f"{failures}")
        inside, memory = 0.0, 0.0
        for task in tasks(count):
            time, peak = np.frombuffer((results.read(task) or b"")[:16])
            inside, memory = inside + float(time), max(memory, float(peak))
    return {
        "per second": count / seconds,
        "in a worker, ms": 1e3 * inside / count,
        "beside, ms": 1e3 * beside / count,
        "per task, ms": 1e3 * seconds / count,
        "memory": memory,
    }


def measure(options: Options) -> list[Table]:
    """One row for each place where tasks run, and two for the memory."""
    quick = options.repeats == 1
    count = 40 if quick else EPISODES
    speed = Table(
        "Scale",
        (
            "episodes per second", "over one worker", "processor time of an episode, ms",
            "of the command per episode, ms", "overhead per task, ms", "worker's memory, MB",
        ),
        note=f"Made episodes of {JOINTS} joints and {SAMPLES} samples from rest, by planner.plan. "
        "The overhead is the wall-clock time of a task that does nothing, on one worker or two.",
        stub="where",
    )  # fmt: skip
    places = {"1 worker": partial(local, 1), "2 workers": partial(local, 2)}
    places["Dask, 2 workers"] = dask
    first = 0.0
    for name, place in places.items():
        with place() as executor:
            run = carried_out(episode, count, executor)
            idle = carried_out(nothing, 10 * count, executor)
        first = first or run["per second"]
        speed.add(
            name, run["per second"], run["per second"] / first, run["in a worker, ms"],
            run["beside, ms"], idle["per task, ms"], run["memory"],
        )  # fmt: skip
    memory = Table(
        "Memory of many episodes",
        ("of the command, MB", "of a worker, MB"),
        note="Peaks, on two workers; the same episodes, simulated and not planned.",
        stub="episodes",
    )
    for many in (10, 200 if quick else MANY):
        memory.add(f"{many}", *in_child(many))
    return [speed, memory]


@contextmanager
def local(workers: int) -> Iterator[Executor]:
    """Processes on this machine."""
    with executor_of(workers=workers) as executor:
        yield executor


@contextmanager
def dask() -> Iterator[Executor]:
    """A Dask scheduler and two workers on the loopback interface."""
    python = [sys.executable, "-P", "-m"]
    scheduler = subprocess.Popen(
        [*python, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
         "--no-dashboard"],
        stderr=subprocess.PIPE, text=True, env=environment(),
    )  # fmt: skip
    assert scheduler.stderr is not None, "it is a pipe"
    matches = (re.search(r"Scheduler at:\s+(tcp://\S+)", line) for line in scheduler.stderr)
    match = next(filter(None, matches), None)
    if match is None:
        raise RuntimeError("no Dask scheduler could be started")
    with TemporaryDirectory() as folder:
        workers = subprocess.Popen(
            [*python, "distributed.cli.dask_worker", match[1], "--nworkers", "2", "--nthreads", "1",
             "--no-dashboard", "--local-directory", folder],
            stderr=subprocess.DEVNULL, env=environment(),
        )  # fmt: skip
        try:
            with executor_of(scheduler=match[1]) as executor:
                yield executor
        finally:
            for process in (workers, scheduler):
                process.terminate()
                process.wait()
            scheduler.stderr.close()


def environment() -> dict[str, str]:
    """Of other processes, which import this module."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


def in_child(count: int) -> tuple[float, float]:
    """Peak memory [MB] of a command that plans so many episodes, and of its workers."""
    command = [sys.executable, "-P", "-m", "benchmark.parts.scale", str(count)]
    child = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    if child.returncode:
        raise RuntimeError(f"{count} episodes: {child.stderr.strip()}")
    of_command, of_worker = json.loads(child.stdout)
    return of_command, of_worker


if __name__ == "__main__":
    from benchmark.parts import scale  # whose functions workers import by this name

    with executor_of(workers=2) as place:
        run = scale.carried_out(scale.simulated, int(sys.argv[1]), place)
    sys.stdout.write(json.dumps([peak_memory(), run["memory"]]))
