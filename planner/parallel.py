"""Many tasks on an executor: processes of this machine, or a Dask cluster; resumable.

Results are kept in files, from which the caller builds its output in its own order.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from itertools import islice
from multiprocessing import get_context
from typing import Any, NamedTuple

from planner._version import __version__
from planner.exceptions import InvalidInput, PlannerError, importing, in_degrees
from planner.files.results import Results, Task

AHEAD = 100
"""Tasks handed over at once: more than one command keeps busy, and memory grows no further."""

PATIENCE, ARRIVAL = 5.0, 30.0
"""Time for a scheduler to answer, and for workers to join one that has none [s]."""

_ONE_AT_A_TIME = threading.Lock()
"""Workers of a cluster may have threads; CasADi builds its functions in one at a time."""


class Outcome(NamedTuple):
    """Return value of a worker."""

    result: bytes | None  # None where the task has failed
    reason: str = ""  # why
    warnings: tuple[tuple[str, type[Warning]], ...] = ()


class SchedulerLost(PlannerError):
    """A cluster that no longer answers, or has no workers left."""


def carry_out(
    function: Callable[[Any], bytes],
    tasks: Sequence[Task],
    results: Results,
    executor: Executor,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, str]:
    """Compute the results of all tasks that have none yet, by a function that workers import.

    ``progress`` takes the name of each that is done. Returns why tasks have failed, in their order.
    Where a cluster goes away, which raises SchedulerLost, the results are kept.
    """
    failures, missing = {}, []
    for task in tasks:
        if task in results:
            progress(task.name)
        else:
            missing.append(task)
    try:
        for task, outcome in outcomes(function, missing, executor):
            if outcome.result is None:
                failures[task.name] = outcome.reason
            else:
                results.write(task, outcome.result)
            progress(task.name)
    except BaseException:  # such as a scheduler that went away before the first result
        results.remove(if_empty=True)
        raise
    return {task.name: failures[task.name] for task in tasks if task.name in failures}


def outcomes(
    function: Callable[[Any], bytes], tasks: Sequence[Task], executor: Executor
) -> Iterator[tuple[Task, Outcome]]:
    """Run tasks; outcomes come in any order, and their warnings with them."""
    attempt = partial(_attempt, function)
    running, waiting = dict[Future[Outcome], Task](), iter(tasks)
    while True:
        for task in islice(waiting, AHEAD - len(running)):
            running[executor.submit(attempt, task.argument)] = task
        if not running:
            return
        finished, _ = futures.wait(running, PATIENCE, futures.FIRST_COMPLETED)
        if not finished:
            getattr(executor, "check_workers", lambda: None)()
        for future in [each for each in running if each in finished]:
            try:
                outcome = future.result()
            except futures.CancelledError as error:  # by a client of Dask that lost its scheduler
                raise SchedulerLost(
                    "the scheduler went away; what was finished is kept, and --resume goes on with "
                    "the rest"
                ) from error
            except Exception as error:
                outcome = Outcome(None, reason_of(error))
            for message, category in dict.fromkeys(outcome.warnings):
                warnings.warn(message, category, stacklevel=2)
            yield running.pop(future), outcome


def executor_of(
    workers: int | None = None, scheduler: str | None = None
) -> AbstractContextManager[Executor]:
    """The processes of this machine, or the workers of a Dask scheduler at an address.

    Running tasks end with the block. By default there is a process for each usable processor, of
    one thread each, as threads of the linear algebra would compete with the other workers.
    """
    if scheduler is not None:
        return _cluster(scheduler)
    return Processes(workers or len(os.sched_getaffinity(0)))


class Processes(futures.ThreadPoolExecutor):
    """Processes on this machine; a task whose process dies is tried once more, on a new one.

    Each thread hands its tasks to a spawned process of its own: in one pool for all, every
    unfinished task would fail with a process. The processes end with this one, however that ends:
    they watch a pipe of which it alone holds the other end.
    """

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._own = threading.local()
        self._spawn = get_context("spawn")
        self._watched, self._lifeline = self._spawn.Pipe(duplex=False)

    def submit(self, function: Callable[..., Any], /, *args: Any) -> Future[Any]:  # type: ignore[override]
        """Run a call in the process of whichever thread is idle first."""
        return super().submit(self._call, partial(function, *args))

    def __exit__(self, *_: object) -> None:
        """End all processes, whatever they are doing."""
        self._lifeline.close()
        self.shutdown(cancel_futures=True)
        self._watched.close()

    def _call(self, call: Callable[[], Any]) -> Any:
        for _ in range(2):
            if not hasattr(self._own, "pool"):
                self._own.pool = ProcessPoolExecutor(1, self._spawn, _watch, (self._watched,))
            try:
                return self._own.pool.submit(call).result()
            except BrokenProcessPool:  # it may have been killed for another's memory
                del self._own.pool
                if self._lifeline.closed:
                    break
        return Outcome(None, "its process died, 2 times (out of memory?)")


def _watch(lifeline: Any) -> None:
    """In a worker: end when the process that started it ends or closes the pipe, and only then."""

    def watch() -> None:
        with suppress(OSError, EOFError):
            lifeline.poll(None)
        os._exit(0)

    os.environ |= {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    """A cluster's own executor, with a method that raises where its workers cannot do the tasks."""
    with importing("a Dask scheduler", "cluster"):
        from distributed import Client
        from distributed.comm import connect

    async def check_scheduler() -> None:
        await (await connect(address, timeout=PATIENCE)).close()

    def check_workers() -> None:
        try:
            client.wait_for_workers(1, timeout=ARRIVAL)
            versions = client.run(_version, on_error="return")  # one may not import it
            for lost in versions.values():
                if isinstance(lost, OSError):
                    raise lost
        except OSError as error:  # a timeout, too
            raise SchedulerLost(
                f"{address}: the scheduler has no workers; start some with `dask worker {address} "
                "--nthreads 1`"
            ) from error
        for worker, version in versions.items():
            if version != __version__:
                raise InvalidInput(
                    f"--scheduler: worker {worker} has request-planner '{version}', expected "
                    f"{__version__} as here; install it there"
                )

    logging.disable()  # the errors here describe faults of a cluster
    try:
        try:
            # first without a client: one that could not connect closes itself when it is collected,
            # which may be while another one begins and holds the lock that this takes
            asyncio.run(check_scheduler())
            client = Client(address, timeout=PATIENCE)
        except ValueError as error:
            raise InvalidInput(
                f"--scheduler: got '{address}', expected an address such as tcp://127.0.0.1:8786 "
                f"({error})"
            ) from error
        except OSError as error:
            raise InvalidInput(
                f"--scheduler: nothing answers at {address} within {PATIENCE:g} s; start one with "
                "`dask scheduler`, or leave --scheduler out to use the processors of this machine"
            ) from error
        try:
            check_workers()
            executor = client.get_executor(pure=False)
            executor.check_workers = check_workers
            yield executor
        finally:
            with suppress(OSError):  # it may be gone, or not answer in time
                client.close(timeout=PATIENCE)
    finally:
        logging.disable(logging.NOTSET)


def _version() -> str:
    return __version__


def _attempt(function: Callable[[Any], bytes], argument: Any) -> Outcome:
    """In a worker: do a task. Whatever it raises becomes a reason, which can always be pickled."""
    with _ONE_AT_A_TIME, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        try:
            result, reason = function(argument), ""
        except (Exception, SystemExit) as error:
            result, reason = None, reason_of(error)
    return Outcome(result, reason, tuple((str(each.message), each.category) for each in caught))


def reason_of(error: BaseException) -> str:
    """Why a task failed, in a line: our own errors by their message, others with their kind."""
    message = ": ".join([*getattr(error, "__notes__", ()), in_degrees(error)])
    if isinstance(error, PlannerError):
        return message
    return " ".join(f"{type(error).__name__}: {message}".split())
