"""Run the command line; tell which files it opens for writing, and what code it makes of data.

A script, not a test: ``python watched.py [--die-at K] -- ARGUMENTS``. The last line on standard
error is JSON. With ``--die-at`` the process ends without any clearing up, as if
it were killed, right before the K-th event that changes a file or a folder.
"""

from __future__ import annotations

import json
import os
import sys

DEATH = 77
"""Exit status of a process that ended before an event."""

CHANGES = {
    *("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate"),
    *("os.chmod", "os.chown", "os.utime", "shutil.rmtree", "shutil.move", "shutil.copyfile"),
    *("tempfile.mkstemp", "tempfile.mkdtemp", "ctypes.dlsym"),
}
"""Events that change files or folders; the C library exchanges two folders (``renameat2``)."""

FORBIDDEN = {"os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "socket.connect"}
"""Events that no input may lead to."""

MARK = "hacked"
"""What the code in hostile files holds, and no other code."""


class Watch:
    """What happened, from the moment on that it is told to watch."""

    def __init__(self, die_at: int | None) -> None:
        self.die_at = die_at
        self.changes: list[list[str]] = []
        self.others: list[str] = []
        self.on = False

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if not self.on:
            return
        if event == "open":
            path, _, flags = arguments
            writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            if isinstance(flags, int) and flags & writes and not isinstance(path, int):
                self._change("open", path)
        elif event in CHANGES:
            if event == "ctypes.dlsym" and arguments[1] != "renameat2":
                return
            self._change(event, *arguments[:2])
        elif event == "compile" and MARK in str(arguments[0]):
            self.others.append("compile")
        elif event in FORBIDDEN or event.startswith("pickle.") or event == "marshal.loads":
            self.others.append(event)

    def _change(self, event: str, *paths: object) -> None:
        if self.die_at is not None and len(self.changes) >= self.die_at:
            if event == "open":
                self._leave_half(str(paths[0]))
            os._exit(DEATH)
        self.changes.append([event, *(str(path) for path in paths)])

    def _leave_half(self, path: str) -> None:
        """Be killed in the middle of writing a file, not before it."""
        self.on = False
        if not os.path.isdir(path):  # where a temporary file without a name is made  # noqa: PTH112
            with open(path, "w") as stream:  # noqa: PTH123  (what opens files is being watched)
                stream.write("half")

    def report(self) -> str:
        return json.dumps({"changes": self.changes, "others": self.others})


def main() -> None:
    split = sys.argv.index("--")
    before, arguments = sys.argv[1:split], sys.argv[split + 1 :]
    watch = Watch(int(before[1]) if before else None)
    sys.addaudithook(watch)
    from planner.cli import cli

    watch.on = True
    status: object = 0
    try:
        cli.main(arguments, "request-planner")
    except SystemExit as end:
        status = end.code
    watch.on = False
    print(watch.report(), file=sys.stderr)
    sys.exit(status)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
