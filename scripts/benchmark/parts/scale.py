"""Many episodes: plans per second, scaling over workers, overhead per task, and memory.

Times are wall-clock and valid on a quiet machine only; processor times beside them are valid on a
busy one, too.
"""

from __future__ import annotations

import json
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
from benchmark.machine import environment, in_child, peak_memory
from benchmark.parts import Options
from benchmark.table import Table
from planner.files.results import Results, Task
from planner.parallel import carry_out, executor_of
from tests.parallel.work import dask_cluster

JOINT = planner.JointModel(v_max=5.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=1 / 30)
"""A hobby servo, requested 30 times a second."""

SAMPLES, JOINTS = 90, 6  # of an episode of three seconds, and of an arm
EPISODES, MANY = 300, 10_000
"""Episodes for the times, and for the memory; with ``--quick`` 40 and 200."""


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
    return np.array([process_time() - began, peak_memory()]).tobytes() + requests.tobytes()


def simulated(seed: int) -> bytes:
    """Angles when an episode is requested as it is, after the same two numbers."""
    began = process_time()
    angles = [planner.simulate(JOINT, column, cyclic=False) for column in desired_angles(seed).T]
    spent = np.array([process_time() - began, peak_memory()])
    return spent.tobytes() + np.column_stack(angles).tobytes()


def nothing(_: int) -> bytes:
    """A task that takes no time."""
    return np.zeros(2).tobytes()


def carried_out(
    function: Callable[[int], bytes], count: int, executor: Executor
) -> tuple[float, float, float, float]:
    """Time of a task, in its worker and beside [ms], and the peak memory of a worker [MB]."""
    tasks = [Task(f"episode {number}", number) for number in range(count)]
    with TemporaryDirectory() as folder:
        warm = Results(Path(folder) / "warm", {})
        carry_out(simulated, tasks[:8], warm, executor)  # starts the workers
        results = Results(Path(folder) / "measured", {})
        began, spent = perf_counter(), process_time()
        failures = carry_out(function, tasks, results, executor)
        seconds, beside = perf_counter() - began, process_time() - spent
        if failures:
            raise RuntimeError(f"{failures}")
        rows = np.array([np.frombuffer((results.read(task) or b"")[:16]) for task in tasks])
    each = 1e3 * np.array([seconds, rows[:, 0].sum(), beside]) / count
    return *each, rows[:, 1].max()


def measure(options: Options) -> list[Table]:
    """One row for each place where tasks run, and two for the memory."""
    quick = options.repeats == 1
    count = 40 if quick else EPISODES
    speed = Table(
        "Scale",
        "where | episodes per second | over one worker | processor time of an episode, ms"
        " | of the command per episode, ms | overhead per task, ms | worker's memory, MB",
        note=f"Made episodes of {JOINTS} joints and {SAMPLES} samples from rest, by planner.plan. "
        "The overhead is the wall-clock time of a task that does nothing, on one worker or two.",
    )
    places = {"1 worker": partial(executor_of, workers=1)}
    places |= {"2 workers": partial(executor_of, workers=2), "Dask, 2 workers": dask}
    first = 0.0
    for name, place in places.items():
        with place() as executor:
            each, inside, beside, memory = carried_out(episode, count, executor)
            idle = carried_out(nothing, 10 * count, executor)[0]
        first = first or each
        speed.add(name, 1e3 / each, first / each, inside, beside, idle, memory)
    memories = Table(
        "Memory of many episodes",
        "episodes | of the command, MB | of a worker, MB",
        note="Peaks, on two workers; the same episodes, simulated and not planned.",
    )
    for many in (10, 200 if quick else MANY):
        memories.add(f"{many}", *in_child("benchmark.parts.scale", many))
    return [speed, memories]


@contextmanager
def dask() -> Iterator[Executor]:
    """A Dask scheduler and two workers on the loopback interface."""
    with (
        TemporaryDirectory() as folder,
        dask_cluster(folder, env=environment()) as (address, _),
        executor_of(scheduler=address) as executor,
    ):
        yield executor


if __name__ == "__main__":
    from benchmark.parts import scale  # whose functions workers import by this name

    with executor_of(workers=2) as place:
        of_worker = scale.carried_out(scale.simulated, int(sys.argv[1]), place)[-1]
    sys.stdout.write(json.dumps([peak_memory(), of_worker]))
