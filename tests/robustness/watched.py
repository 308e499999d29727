"""What a program does to files, and what code it makes of data: an audit hook that tells."""

import json
import os

DEATH = 77  # exit status of a run that died before a change of a file
CHANGES = {
    *("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate"),
    *("os.chmod", "os.chown", "os.utime", "shutil.rmtree", "shutil.move", "shutil.copyfile"),
    *("tempfile.mkstemp", "tempfile.mkdtemp"),
}
"""Events that change files or folders."""

FORBIDDEN = {"os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "socket.connect"}
"""Events that no input may lead to."""

MARK = "hacked"  # what the code in hostile files holds, and no other code


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
