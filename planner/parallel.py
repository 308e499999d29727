"""Many tasks in parallel, on the processors of this machine or on a Dask cluster; resumable.

A task is an argument of a function that returns bytes. :func:`carry_out` runs the tasks that have
no result yet and keeps each result in a file of its own, from which the caller then builds its
output in its own order. So the output does not depend on the number of workers, a process that is
killed loses no finished result, and memory does not grow with the number of tasks.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import shutil
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.exceptions import KinematicsError
from planner._version import __version__
from planner.exceptions import ANGLE_UNIT, InvalidFile, InvalidInput, MissingExtra, PlannerError
from planner.files.staging import all_there, cannot_write, staged
from planner.files.text import to_json

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Function = Callable[[Any], bytes]
"""Computes the result of a task from its argument; importable by name, as workers import it."""

ATTEMPTS = 2
"""How often a task is tried whose process dies: it may have been killed for another's memory."""

AHEAD = 2
"""Tasks that each worker holds: while one runs, the next is there."""

PATIENCE = 5.0
"""Time for a scheduler to answer [s]."""

ARRIVAL = 30.0
"""Time for workers to join a scheduler that has none [s]: a cluster may be starting them."""

SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 for workers: threads of the linear algebra would compete with the other workers."""

DIGEST = sha256().digest_size
"""Bytes before a result, by which a damaged one is recognised."""


@dataclass(frozen=True)
class Task:
    """A piece of work.

    Attributes:
        name: What messages call it, such as "episode 12"; unique among the tasks.
        argument: What the function takes; it is pickled.
        inputs: Identifies the content of its inputs, such as a digest of a file: where that
            changes, an earlier result is not used.
    """

    name: str
    argument: Any
    inputs: str = ""


@dataclass(frozen=True)
class Outcome:
    """What a worker returns: the result, or None and the reason; and warnings."""

    result: bytes | None
    reason: str = ""
    warnings: tuple[tuple[str, type[Warning]], ...] = ()


@dataclass(frozen=True)
class Engine:
    """An executor, and the number of tasks that it should hold."""

    executor: Executor
    window: Callable[[], int]


class SchedulerLost(PlannerError):
    """A cluster that no longer answers, or has no workers left."""


def carry_out(
    function: Function,
    tasks: Sequence[Task],
    results: Results,
    engine: Engine,
    *,
    progress: Callable[[Task], None] = lambda _: None,
) -> dict[str, str]:
    """Compute the results of all tasks that have none yet.

    Args:
        function: Computes a result from the argument of a task.
        tasks: The tasks.
        results: Where the results are kept.
        engine: Runs the tasks.
        progress: Called with each task that is finished, has failed, or had a result.

    Returns:
        Why tasks have failed, by their names, in the order of the tasks.

    Raises:
        SchedulerLost: The cluster went away; the results so far are kept.
    """
    failures = {}

    def missing() -> Iterator[Task]:
        for task in tasks:
            if task in results:
                progress(task)
            else:
                yield task

    try:
        for task, outcome in outcomes(function, missing(), engine):
            if outcome.result is None:
                failures[task.name] = outcome.reason
            else:
                results.write(task, outcome.result)
            progress(task)
    except BaseException:  # such as a scheduler that went away before the first result
        results.remove_if_empty()
        raise
    return {task.name: failures[task.name] for task in tasks if task.name in failures}


def outcomes(
    function: Function, tasks: Iterable[Task], engine: Engine
) -> Iterator[tuple[Task, Outcome]]:
    """Run tasks, taken one by one as workers become free; outcomes come in any order."""
    waiting, running = iter(tasks), dict[Future[Outcome], Task]()
    attempt, window = partial(_attempt, function, ANGLE_UNIT.get()), engine.window()
    while True:
        for task in islice(waiting, max(window - len(running), 0)):
            running[engine.executor.submit(attempt, task.argument)] = task
        if not running:
            return
        done = wait(running, PATIENCE, FIRST_COMPLETED).done
        if not done:  # whether a cluster still has workers, or more of them
            window = engine.window()
        for future in done:
            try:
                outcome = future.result()
            except CancelledError as error:  # by a client of Dask that lost its scheduler
                raise SchedulerLost(
                    "the scheduler went away; what was finished is kept, and --resume goes on "
                    "with the rest"
                ) from error
            except Exception as error:
                outcome = Outcome(None, _reason(error))
            for message, category in dict.fromkeys(outcome.warnings):
                warnings.warn(message, category, stacklevel=2)
            yield running.pop(future), outcome


@contextmanager
def engine_of(workers: int | None = None, scheduler: str | None = None) -> Iterator[Engine]:
    """Hand out what runs tasks; its workers end with the block.

    Args:
        workers: Processes on this machine; by default one for each usable processor.
        scheduler: Address of a Dask scheduler whose workers are used instead.

    Raises:
        InvalidInput: No scheduler answers at this address, or its workers cannot do the tasks.
        MissingExtra: Dask is not installed.
    """
    if scheduler is not None:
        with _client(scheduler) as client:
            window = partial(_window, client, scheduler)
            yield Engine(client.get_executor(pure=False), window)
        return
    many = workers or len(os.sched_getaffinity(0))
    before = {name: os.environ.get(name) for name in SINGLE_THREADED}
    os.environ.update(dict.fromkeys(SINGLE_THREADED, "1"))
    try:
        with Processes(many) as executor:
            yield Engine(executor, lambda: AHEAD * many)
    finally:
        for name, value in before.items():
            del os.environ[name]
            if value is not None:
                os.environ[name] = value


class Processes(ThreadPoolExecutor):
    """Processes on this machine; a task whose process dies is tried once more, on a new one.

    Each thread hands its tasks to a spawned process of its own, so that no other task is lost with
    the process: in one pool for all, every unfinished task would fail together. The processes end
    with this one, however that ends: they watch a pipe of which it alone holds the other end.
    """

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._own = threading.local()
        self._spawn = get_context("spawn")
        self._watched, self._lifeline = self._spawn.Pipe(duplex=False)

    def submit(self, function: Callable[..., Any], /, *given: Any) -> Future[Any]:  # type: ignore[override]
        """Run a call in the process of whichever thread is idle first."""
        return super().submit(self._call, partial(function, *given))

    def __exit__(self, *_: object) -> None:
        """End all processes, whatever they are doing."""
        self._lifeline.close()
        self.shutdown(cancel_futures=True)
        self._watched.close()

    def _call(self, call: Callable[[], Any]) -> Any:
        for _ in range(ATTEMPTS):
            if not hasattr(self._own, "pool"):
                self._own.pool = ProcessPoolExecutor(1, self._spawn, _watch, (self._watched,))
            try:
                return self._own.pool.submit(call).result()
            except BrokenProcessPool:
                del self._own.pool
                if self._lifeline.closed:
                    break
        return Outcome(None, f"its process died, {ATTEMPTS} times (out of memory?)")


def _watch(lifeline: Connection) -> None:
    """In a worker: end when the process that started it ends or closes the pipe, and only then."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        try:
            lifeline.poll(None)
        finally:
            os._exit(0)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """A connection to a scheduler, tried first without a client.

    A client that could not connect closes itself when it is collected, which may be while another
    one begins and holds the lock that this takes.
    """
    try:
        from distributed import Client
        from distributed.comm import connect
    except ImportError as error:
        raise MissingExtra("a Dask scheduler", "cluster") from error

    async def check() -> None:
        await (await connect(address, timeout=PATIENCE)).close()

    logging.disable()  # messages here say what is wrong with a cluster
    try:
        try:
            asyncio.run(check())
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
    finally:
        logging.disable(logging.NOTSET)


def _window(client: Any, address: str) -> int:
    """The number of tasks that a cluster should hold.

    Raises:
        InvalidInput: Its workers cannot do the tasks.
        SchedulerLost: It has no workers.
    """
    try:
        client.wait_for_workers(1, timeout=ARRIVAL)
        versions = client.run(_version)
    except OSError as error:  # a timeout, too
        raise SchedulerLost(
            f"{address}: the scheduler has no workers; start some with `dask worker {address} "
            "--nthreads 1`"
        ) from error
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
    threads: dict[str, int] = client.nthreads()
    return AHEAD * sum(threads.values())


def _version() -> str:
    return __version__


_ONE_AT_A_TIME = threading.Lock()
"""Workers of a cluster may have threads; CasADi builds its functions in one at a time."""


def _attempt(function: Function, unit: Any, argument: Any) -> Outcome:
    """In a worker: do a task. Whatever it raises becomes a reason, which can always be pickled."""
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
    return Outcome(result, reason, tuple((str(each.message), each.category) for each in caught))


def _reason(error: BaseException) -> str:
    """Why a task failed, in a line: our own errors by their message, others with their kind."""
    message = ": ".join([*getattr(error, "__notes__", ()), str(error)])
    if isinstance(error, PlannerError | KinematicsError):
        return message
    return " ".join(f"{type(error).__name__}: {message}".split())


class Results:
    """The results of tasks in a hidden folder beside the output that is built from them.

    Each is a file that begins with a digest of its content; a damaged one counts as missing. A
    result is found by what it was computed from: the settings, the name and the inputs of its task,
    and the version of this package.
    """

    def __init__(
        self, output: Path | str, settings: Mapping[str, Any], *, resume: bool = False
    ) -> None:
        """Open the folder ``.NAME.results``, or begin it.

        Args:
            output: The file or folder that is built from the results.
            settings: What all results depend on, as JSON takes it.
            resume: Keep the results that are there; they are removed otherwise.

        Raises:
            InvalidInput: The results that are there were computed with other settings.
            InvalidFile: The folder cannot be made or written.
        """
        target = Path(output).resolve()
        self.folder = target.with_name(f".{target.name}.results")
        self._output = output
        self._settings = json.loads(json.dumps({"version": __version__, **settings}))
        self.removed = 0
        manifest = self.folder / "settings.json"
        before = _read_json(manifest)
        if resume and before is not None:
            self._check_same(before)
            return
        try:
            if self.folder.exists() and not resume:
                self.removed = sum(1 for _ in self.folder.glob("??/*"))
                shutil.rmtree(self.folder)
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(output, error) from error
        self._keep(manifest, json.dumps(self._settings, indent=2).encode())

    def __contains__(self, task: Task) -> bool:
        return self.read(task) is not None

    def write(self, task: Task, result: bytes) -> None:
        """Keep a result; it appears whole or not at all.

        Raises:
            InvalidFile: The output cannot be written; what is kept stays.
        """
        self._keep(self._file(task), sha256(result).digest() + result)

    def read(self, task: Task) -> bytes | None:
        """The result of a task; None where there is none, or a damaged one."""
        try:
            content = self._file(task).read_bytes()
        except OSError:
            return None
        digest, result = content[:DIGEST], content[DIGEST:]
        return result if sha256(result).digest() == digest else None

    def remove(self) -> None:
        """Remove the folder, once the output is written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def remove_if_empty(self) -> None:
        """Remove the folder where it holds no result."""
        if next(self.folder.glob("??/*"), None) is None:
            self.remove()

    def _keep(self, file: Path, content: bytes) -> None:
        try:
            file.parent.mkdir(exist_ok=True)
            with staged(file, content):
                pass
        except (InvalidFile, OSError) as error:  # with its hidden name, which says nothing
            cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
            raise cannot_write(self._output, cause) from error

    def _file(self, task: Task) -> Path:
        name = _digest([self._settings, task.name, task.inputs])
        return self.folder / name[:2] / name[2:]

    def _check_same(self, before: Any) -> None:
        if before == self._settings:
            return
        known = before if isinstance(before, dict) else {}
        names = {**known, **self._settings}
        others = [name for name in names if known.get(name) != self._settings.get(name)]
        raise InvalidInput(
            f"--resume: {self.folder} holds results for other settings ({', '.join(others)}); set "
            "what was set then, or leave --resume out to compute all again"
        )


def made_from(settings: Mapping[str, Any], manifest: Mapping[str, Any]) -> dict[str, str]:
    """The key of a manifest by which :func:`finished` recognises an output that is whole.

    Args:
        settings: All that the output depends on, as JSON takes it.
        manifest: What the output says of itself, with or without this key.
    """
    others = {name: each for name, each in manifest.items() if name != "made_from"}
    content = [__version__, settings, json.loads(to_json(others))]
    return {"made_from": _digest(content)}


def finished(output: Path | str, name: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """The manifest of an output that was made from the same settings and is whole; None if not.

    The results that another command has left beside it are removed then.

    Args:
        output: The folder.
        name: The manifest in it, which holds what :func:`made_from` gives.
        settings: All that the output depends on, as JSON takes it.
    """
    manifest: dict[str, Any] | None = _read_json(Path(output) / name)
    same = isinstance(manifest, dict) and made_from(settings, manifest).items() <= manifest.items()
    if not same or not all_there(output):
        return None
    target = Path(output).resolve()
    shutil.rmtree(target.with_name(f".{target.name}.results"), ignore_errors=True)
    return manifest


def _digest(content: Any) -> str:
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


def _read_json(file: Path) -> Any:
    """The content of a file; None where there is none that could be read."""
    try:
        return json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
