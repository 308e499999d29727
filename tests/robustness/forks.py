"""The program in forks of a process that has imported it, so that its imports are paid for once.

A script and its client. Each line that the script reads is a run as JSON: the arguments, the folder
and the environment to run in, a limit on the length of files, and whether an audit hook tells what
it does to files. It answers with the exit status.
"""

import contextlib
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

CHANGES = {
    *("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate"),
    *("os.chmod", "os.chown", "os.utime", "shutil.rmtree", "shutil.move", "shutil.copyfile"),
    *("tempfile.mkstemp", "tempfile.mkdtemp"),
}
"""Events that change files or folders."""


class Run(NamedTuple):
    """What a run left behind; ``changes`` is what was watched, None where the run died."""

    returncode: int
    stdout: str
    stderr: str
    changes: list[list[str]] | None


class Forks:
    """The process that forks, with threads for its linear algebra and a seed for its hashes."""

    def __init__(self, *, threads: int = 1, seed: int = 0) -> None:
        path = os.pathsep.join(filter(None, sys.path))
        environment = {"PYTHONPATH": path, "PYTHONHASHSEED": str(seed), "MPLBACKEND": "agg"}
        environment |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), str(threads))
        self._process = subprocess.Popen(
            [sys.executable, __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | environment,
        )

    def run(self, folder: Path, *arguments: str, **asked: Any) -> Run:
        """Run the program in a folder.

        It may be asked for an ``environment``, to ``watch`` what is done, and for files of at most
        so much ``room`` [bytes].
        """
        with tempfile.TemporaryDirectory() as kept:
            status = self._order(folder=str(folder), arguments=arguments, kept=kept, **asked)
            said = [(Path(kept) / name).read_text() for name in ("stdout", "stderr")]
            watched = Path(kept) / "changes"
            return Run(status, *said, json.loads(watched.read_text()) if watched.exists() else None)

    def _order(self, **order: Any) -> int:
        print(json.dumps(order), file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())

    def close(self) -> None:
        """Let the process end."""
        self._process.communicate()


class Watch:
    """What happened, from the moment on that it is told to watch."""

    def __init__(self) -> None:
        self.changes: list[list[str]] = []
        self.on = False

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if not self.on:
            return
        if event == "open":
            path, _, flags = arguments
            writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            if isinstance(flags, int) and flags & writes and not isinstance(path, int):
                self.changes.append(["open", str(path)])
        elif event in CHANGES:
            self.changes.append([event, *map(str, arguments[:2])])


def main() -> None:
    import kinematics
    import planner

    for package in (kinematics, planner):
        for name in package.__all__:
            getattr(package, name)  # what the commands import when they need it
    for line in sys.stdin:
        order = json.loads(line)
        child = os.fork()
        if child == 0:
            _run(order)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _run(order: dict[str, Any]) -> NoReturn:
    """One run, in a fork that ends with it."""
    from planner.cli import main

    os.chdir(order["folder"])
    os.environ.update(order.get("environment", {}))
    kept = Path(order["kept"])
    for descriptor, place in ((0, Path(os.devnull)), (1, kept / "stdout"), (2, kept / "stderr")):
        opened = os.open(place, os.O_RDONLY if descriptor == 0 else os.O_WRONLY | os.O_CREAT)
        os.dup2(opened, descriptor)
        os.close(opened)
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    if room := order.get("room"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
    sys.argv = ["request-planner", *order["arguments"]]
    watch, watched = Watch(), "watch" in order
    if watched:
        sys.addaudithook(watch)
    status = 1
    try:
        watch.on = watched
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
    if watched:
        (kept / "changes").write_text(json.dumps(watch.changes))
    os._exit(status)


if __name__ == "__main__":
    main()
