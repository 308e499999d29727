"""Tasks for tests of the engine, and commands that are killed; other processes import them."""

import os
import pickle
import re
import signal
import subprocess
import sys
import warnings
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from planner.exceptions import InvalidInput
from planner.files.results import Results, Task
from planner.parallel import carry_out, executor_of


def square(number):
    return str(number**2).encode()


def refuse_three(number):
    if number == 3:
        raise InvalidInput("episode: got nothing, expected samples")
    if number == 4:
        warnings.warn("four is even", UserWarning, stacklevel=1)
    return square(number)


def kill_always(argument, *, once=False):
    """A task whose process is killed every time, which it notes, or the first time only."""
    number, mark = argument
    if number == 3 and not (once and mark.exists()):
        with mark.open("a") as file:
            file.write("killed\n")
        os.kill(os.getpid(), signal.SIGKILL)
    return square(number)


kill_once = partial(kill_always, once=True)


def threads(name):
    """What a worker's linear algebra is told about threads."""
    return os.environ[name].encode()


def tasks(count=8):
    return [Task(f"task {number}", number) for number in range(count)]


class InThisProcess(Executor):
    """An executor whose worker is this process, and how many calls it was asked to run."""

    def __init__(self):
        self.ran = 0

    def submit(self, function, /, *given):
        self.ran += 1
        future = Future()
        future.set_result(pickle.loads(pickle.dumps(partial(function, *given)))())
        return future


@contextmanager
def in_this_process(*_):
    yield InThisProcess()


@contextmanager
def dask_cluster(folder, **settings):
    """A Dask scheduler and two workers on the loopback interface: its address and its process."""
    python = [sys.executable, "-P", "-m"]
    local = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    scheduler = subprocess.Popen(
        [*python, "distributed.cli.dask_scheduler", *local],
        stderr=subprocess.PIPE,
        text=True,
        **settings,
    )
    lines = (re.search(r"Scheduler at:\s+(tcp://\S+)", line) for line in scheduler.stderr)
    address = next(filter(None, lines))[1]
    worker = [*python, "distributed.cli.dask_worker", address, "--nworkers", "2", "--nthreads", "1"]
    worker += ["--no-dashboard", "--local-directory", folder]
    workers = subprocess.Popen(worker, stderr=subprocess.DEVNULL, **settings)
    try:
        yield address, scheduler
    finally:
        for process in (workers, scheduler):
            process.kill()
            process.wait()
        scheduler.stderr.close()


@contextmanager
def at_work_on(output):
    """Another process that works on an output until the block ends, and is killed then."""
    code = (
        "import sys; from planner.files.staging import output_folder\n"
        f"with output_folder({str(output)!r}) as new:\n"
        "    (new / 'half').touch()\n"
        "    print('half', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-P", "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        process.stdout.readline()
        try:
            yield
        finally:
            process.kill()


def held(folder):
    """The results in a folder, by file."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in Path(folder).glob("??/*")
        if not file.name.startswith(".")
    }


def run_and_die_after(output, finished):
    """Carry out tasks, resuming, and kill the whole command once some have a result."""
    results = Results(output, {"power": 2}, resume=True)

    def progress(_):
        if len(held(results.folder)) >= finished:
            os.kill(os.getpid(), signal.SIGKILL)

    with executor_of(workers=2) as executor:
        carry_out(square, tasks(), results, executor, progress=progress)


if __name__ == "__main__":
    run_and_die_after(sys.argv[1], int(sys.argv[2]))
