"""Many tasks in parallel: on the processors of this machine, or on a Dask cluster; resumable.

A task is an argument of a function, which returns bytes. :func:`carry_out` runs the tasks that
have no result yet and keeps each result in a file of its own, written whole, from which the caller
then builds its outputs in an order of its own. So the outputs do not depend on the number of
workers, a process that is killed loses no finished result, and memory does not grow with the number
of tasks: no more than two tasks per worker are in flight.

On this machine each worker is one spawned process of :mod:`concurrent.futures` with a pool of its
own: where a process dies, the task that it ran is known, and no other task is lost with it. In one
pool for all workers, as in joblib's too, every unfinished task fails together with that one.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, Protocol, Self

from kinematics.exceptions import KinematicsError
from planner._version import __version__
from planner.exceptions import ANGLE_UNIT, InvalidInput, MissingExtra, PlannerError
from planner.run.results import Results, Task

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Function = Callable[[Any], bytes]
"""What is done with the argument of a task: a function of a module, as others import it."""

ATTEMPTS = 2
"""How often a task is tried whose process dies: it may have been killed for another's memory."""

PATIENCE = 5.0
"""Time for a scheduler to answer [s]."""

ARRIVAL = 30.0
"""Time for workers to come to a scheduler that has none [s]: a cluster may be starting them."""

AHEAD = 2
"""Tasks that a cluster holds for each of its threads: while one runs, the next is there."""

SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 for workers: threads of the linear algebra would compete with the other workers."""


@dataclass(frozen=True)
class Failure:
    """A task without a result.

    Attributes:
        task: Its name.
        reason: Why, in a line.
    """

    task: str
    reason: str


class SchedulerLost(PlannerError):
    """A cluster that does not answer any more, or has no workers left."""


Numbered = tuple[int, Task]
Outcomes = Generator[tuple[Numbered, "bytes | Failure"], None, None]


class Engine(Protocol):
    """What tasks run on; a context, which ends all that it has started."""

    def run(self, function: Function, tasks: Iterable[Numbered]) -> Outcomes:
        """Run tasks; each outcome is handed over once it is there, in any order."""

    def __enter__(self) -> Self:
        """Begin; workers are started with the first tasks."""

    def __exit__(self, *_: object) -> None:
        """End all workers."""


def carry_out(
    function: Function,
    tasks: Iterable[Task],
    results: Results,
    engine: Engine,
    *,
    progress: Callable[[Task], None] = lambda _: None,
) -> list[Failure]:
    """Compute the results of all tasks that have none yet.

    Args:
        function: What is done with the argument of a task.
        tasks: The tasks; they are taken one by one, as workers become free.
        results: Where the results are kept.
        engine: What they run on.
        progress: Called with each task that is finished, has failed, or had a result.

    Returns:
        The tasks that failed, in the order of the tasks.

    Raises:
        InvalidInput: The address of the scheduler is none, or nothing answers there.
        MissingExtra: Dask is not installed.
        SchedulerLost: The cluster went away; the results so far are kept.
    """
    failures: dict[int, Failure] = {}

    def missing() -> Iterator[Numbered]:
        for number, task in enumerate(tasks):
            if task in results:
                progress(task)
            else:
                yield number, task

    try:
        with closing(engine.run(function, missing())) as outcomes:
            for (number, task), outcome in outcomes:
                if isinstance(outcome, Failure):
                    failures[number] = outcome
                else:
                    results.write(task, outcome)
                progress(task)
    except BaseException:  # such as a scheduler that does not answer
        results.remove_if_empty()
        raise
    return [failures[number] for number in sorted(failures)]


def engine_of(workers: int | None = None, scheduler: str | None = None) -> Engine:
    """What tasks run on.

    Args:
        workers: Processes on this machine; by default one for each usable processor.
        scheduler: Address of a Dask scheduler whose workers are used instead.
    """
    if scheduler is not None:
        return Cluster(scheduler)
    return Processes(workers or len(os.sched_getaffinity(0)))


class Processes:
    """Processes on this machine. A task whose process dies is tried again once, on a new one."""

    def __init__(self, workers: int) -> None:
        self._workers = [_Worker() for _ in range(workers)]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.end()

    def run(self, function: Function, tasks: Iterable[Numbered]) -> Outcomes:
        """Run tasks; see :class:`Engine`."""
        waiting, idle = iter(tasks), [*self._workers]
        running: dict[Future[_Attempt], tuple[_Worker, Numbered, int]] = {}
        finished: list[tuple[Numbered, bytes | Failure]] = []
        try:
            while True:
                while idle and (numbered := next(waiting, None)) is not None:
                    worker = idle.pop()
                    running[worker.begin(function, numbered[1])] = (worker, numbered, 1)
                yield from finished
                if not running:
                    return
                finished = []
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    worker, numbered, attempt = running.pop(future)
                    try:
                        outcome = _received(numbered[1], future.result())
                    except BrokenProcessPool:
                        worker.end()
                        if attempt < ATTEMPTS:
                            again = worker.begin(function, numbered[1])
                            running[again] = (worker, numbered, attempt + 1)
                            continue
                        reason = f"its process died, {ATTEMPTS} times (out of memory?)"
                        outcome = Failure(numbered[1].name, reason)
                    idle.append(worker)
                    finished.append((numbered, outcome))
        finally:
            for worker, _, _ in running.values():
                worker.end()


class _Worker:
    """A process that does one task at a time, started with its first task.

    It ends with this process, however that ends: it watches a pipe of which only this process
    holds the other end.
    """

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._lifeline: Connection | None = None

    def begin(self, function: Function, task: Task) -> Future[_Attempt]:
        """Hand a task over."""
        attempt = partial(_attempt, function, task.argument, ANGLE_UNIT.get())
        if self._pool is not None:
            try:
                return self._pool.submit(attempt)
            except BrokenProcessPool:  # the process died after its last task
                self.end()
        spawn = get_context("spawn")
        watched, self._lifeline = spawn.Pipe(duplex=False)
        self._pool = ProcessPoolExecutor(1, spawn, _watch, (watched,))
        with _single_threaded():  # the process is started by what is submitted first
            begun = self._pool.submit(attempt)
        watched.close()
        return begun

    def end(self) -> None:
        """End the process, whatever it is doing."""
        if self._lifeline is not None:
            self._lifeline.close()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self._lifeline = None


def _watch(lifeline: Connection) -> None:
    """In a worker: end when the process that started it ends or wants it to, and only then."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        try:
            lifeline.poll(None)
        finally:
            os._exit(0)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Let processes that are started in the block use one thread each."""
    before = {name: os.environ.get(name) for name in SINGLE_THREADED}
    os.environ.update(dict.fromkeys(SINGLE_THREADED, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class Cluster:
    """The workers of a Dask scheduler, to which tasks are handed some at a time.

    A task whose worker dies is tried again by Dask, as often as the scheduler is configured to.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._open = ExitStack()
        self._client: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def run(self, function: Function, tasks: Iterable[Numbered]) -> Outcomes:
        """Run tasks; see :class:`Engine`."""
        waiting = iter(tasks)
        first = list(islice(waiting, 1))
        if not first:
            return
        try:
            import distributed
            from distributed.comm.core import CommClosedError
        except ImportError as error:
            raise MissingExtra("a Dask scheduler", "cluster") from error
        lost = (CommClosedError, distributed.client.FuturesCancelledError, OSError)
        if self._client is None:
            self._open.enter_context(_quiet("distributed"))
            self._client = self._open.enter_context(_client(self._address))
        client, waiting, running = self._client, chain(first, waiting), dict[Any, Numbered]()
        try:
            window = AHEAD * _check_workers(client, self._address)
            while True:
                for number, task in islice(waiting, window - len(running)):
                    key = f"{task.name} {os.urandom(8).hex()}"
                    attempt = partial(_attempt, function, task.argument, ANGLE_UNIT.get())
                    running[client.submit(attempt, pure=False, key=key)] = number, task
                if not running:
                    return
                try:
                    done = distributed.wait(
                        list(running), timeout=PATIENCE, return_when="FIRST_COMPLETED"
                    ).done
                except TimeoutError:
                    window = AHEAD * _check_workers(client, self._address)
                    continue
                for future in done:
                    numbered = running.pop(future)
                    yield numbered, _from_cluster(future, numbered[1], lost)
                    future.release()
        except lost as error:
            raise SchedulerLost(
                f"{self._address}: the scheduler went away; what was finished is kept, and "
                "--resume goes on with the rest"
            ) from error


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """A connection to a scheduler, which is tried first without a client.

    A client that could not connect closes itself when it is collected, which may be while another
    one begins and holds the lock that this takes.
    """
    from distributed import Client

    try:
        asyncio.run(_connect(address))
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
        yield client
    finally:
        with suppress(OSError, TimeoutError):  # it may be gone
            client.close(timeout=PATIENCE)


async def _connect(address: str) -> None:
    """Open a connection to a scheduler, and close it."""
    from distributed.comm import connect

    comm = await connect(address, timeout=PATIENCE)
    await comm.close()


def _check_workers(client: Any, address: str) -> int:
    """The number of threads of a cluster.

    Raises:
        InvalidInput: Its workers cannot do the tasks.
        SchedulerLost: It has no workers.
    """
    try:
        client.wait_for_workers(1, timeout=ARRIVAL)
    except TimeoutError as error:
        raise SchedulerLost(
            f"{address}: the scheduler has no workers; start some with `dask worker {address} "
            "--nthreads 1`"
        ) from error
    try:
        versions = client.run(_version)
    except ImportError as error:
        raise InvalidInput(
            f"--scheduler: a worker of {address} cannot import request-planner ({error}); install "
            "it there"
        ) from error
    for worker, version in versions.items():
        if version != __version__:
            raise InvalidInput(
                f"--scheduler: worker {worker} has request-planner {version}, expected "
                f"{__version__} as here"
            )
    return sum(client.nthreads().values())


def _from_cluster(future: Any, task: Task, lost: tuple[type[Exception], ...]) -> bytes | Failure:
    try:
        return _received(task, future.result())
    except lost:
        raise
    except Exception as error:
        return Failure(task.name, _reason(error))


@contextmanager
def _quiet(package: str) -> Iterator[None]:
    """Log nothing of a package: it is said here what is wrong with a cluster."""
    loggers = [
        logging.getLogger(name)
        for name in [package, *logging.root.manager.loggerDict]
        if name.split(".")[0] == package
    ]
    levels = [each.level for each in loggers]
    for each in loggers:
        each.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for each, level in zip(loggers, levels, strict=True):
            each.setLevel(level)


def _version() -> str:
    return __version__


_ONE_AT_A_TIME = threading.Lock()
"""Workers of a cluster may have threads; CasADi builds its functions in one at a time."""


@dataclass(frozen=True)
class _Attempt:
    """What a worker hands back: the result, or why there is none, and warnings."""

    result: bytes | None
    reason: str = ""
    warnings: tuple[tuple[str, type[Warning]], ...] = ()


def _attempt(function: Function, argument: Any, unit: Any) -> _Attempt:
    """In a worker: do a task. Whatever it raises is a reason, which can always be pickled."""
    with _ONE_AT_A_TIME, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        before = ANGLE_UNIT.set(unit)
        try:
            result, reason = function(argument), ""
        except (Exception, SystemExit) as error:
            result, reason = None, _reason(error)
        finally:
            ANGLE_UNIT.reset(before)
    return _Attempt(result, reason, tuple((str(each.message), each.category) for each in caught))


def _received(task: Task, attempt: _Attempt) -> bytes | Failure:
    for message, category in dict.fromkeys(attempt.warnings):
        warnings.warn(message, category, stacklevel=2)
    return Failure(task.name, attempt.reason) if attempt.result is None else attempt.result


def _reason(error: BaseException) -> str:
    """Why a task failed, in a line: our own errors by their message, others with their kind."""
    message = ": ".join([*getattr(error, "__notes__", ()), str(error)])
    if isinstance(error, PlannerError | KinematicsError):
        return message
    return " ".join(f"{type(error).__name__}: {message}".split())
