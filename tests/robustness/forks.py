"""The program in forks of a process that has imported it, so that its imports are paid for once.

A script and its client. Each line that the script reads is a run as JSON: the arguments, the folder
and the environment to run in, limits on memory and processor time, whether to watch what it does,
and before which change of a file to die as if it were killed. It answers with the exit status.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple, NoReturn


class Run(NamedTuple):
    """What a run left behind; ``report`` is what was watched, None where the run died."""

    returncode: int
    stdout: str
    stderr: str
    report: dict[str, Any] | None


class Forks:
    """The process that forks, with threads for its linear algebra and a seed for its hashes."""

    def __init__(self, *, threads: int = 1, seed: int = 0) -> None:
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(each for each in sys.path if each),
            "OMP_NUM_THREADS": str(threads),
            "OPENBLAS_NUM_THREADS": str(threads),
            "PYTHONHASHSEED": str(seed),
            "MPLBACKEND": "agg",
        }
        self._process = subprocess.Popen(
            [sys.executable, __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def run(
        self,
        folder: Path,
        *arguments: str,
        environment: dict[str, str] | None = None,
        watch: bool = False,
        die_at: int | None = None,
        memory: int | None = None,
        seconds: int | None = None,
        room: int | None = None,
    ) -> Run:
        """Run the program in a folder; ``room`` is how long a file can become [bytes]."""
        with tempfile.TemporaryDirectory() as kept:
            order = {
                "folder": str(folder),
                "arguments": arguments,
                "environment": environment or {},
                "watch": watch or die_at is not None,
                "die_at": die_at,
                "memory": memory,
                "seconds": seconds,
                "room": room,
                "kept": kept,
            }
            print(json.dumps(order), file=self._process.stdin, flush=True)
            status = int(self._process.stdout.readline())
            said = [(Path(kept) / name).read_text() for name in ("stdout", "stderr")]
            report = Path(kept) / "report"
            return Run(status, *said, json.loads(report.read_text()) if report.exists() else None)

    def warm(self, folder: Path, *arguments: str) -> int:
        """Run the program in the process that forks, which later runs find as it was left."""
        print(json.dumps({"warm": arguments, "folder": str(folder)}), file=self._process.stdin)
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    def close(self) -> None:
        """Let the process end."""
        self._process.communicate()


def main() -> None:
    import kinematics
    import planner

    for package in (kinematics, planner):
        for name in package.__all__:
            getattr(package, name)  # what the commands import when they need it
    for line in sys.stdin:
        order = json.loads(line)
        if "warm" in order:
            print(_warm(order), flush=True)
            continue
        child = os.fork()
        if child == 0:
            _run(order)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _warm(order: dict[str, Any]) -> int:
    """Exit status of a run in this process, which says nothing."""
    from planner.cli import cli

    os.chdir(order["folder"])
    silent = io.StringIO()
    with contextlib.redirect_stdout(silent), contextlib.redirect_stderr(silent):
        try:
            cli.main(order["warm"], prog_name="request-planner")
        except SystemExit as end:
            return end.code or 0
    raise AssertionError("the command line returned")


def _run(order: dict[str, Any]) -> NoReturn:
    """One run, in a fork that ends with it."""
    from watched import Watch

    from planner.cli import main

    os.chdir(order["folder"])
    os.environ.update(order["environment"])
    kept = Path(order["kept"])
    for descriptor, place in ((0, Path(os.devnull)), (1, kept / "stdout"), (2, kept / "stderr")):
        opened = os.open(place, os.O_RDONLY if descriptor == 0 else os.O_WRONLY | os.O_CREAT)
        os.dup2(opened, descriptor)
        os.close(opened)
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    for kind, most in (
        (resource.RLIMIT_AS, order["memory"]),
        (resource.RLIMIT_CPU, order["seconds"]),
        (resource.RLIMIT_FSIZE, order["room"]),
    ):
        if most is not None:
            resource.setrlimit(kind, (most, most))
    sys.argv = ["request-planner", *order["arguments"]]
    watch = Watch(order["die_at"])
    if order["watch"]:
        sys.addaudithook(watch)
    status = 1
    try:
        watch.on = order["watch"]
        main()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1 if end.code else 0
    except BaseException:
        import traceback

        traceback.print_exc()
    watch.on = False
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    if order["watch"]:
        (kept / "report").write_text(watch.report())
    os._exit(status)


if __name__ == "__main__":
    main()
