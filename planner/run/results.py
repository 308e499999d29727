"""Results of tasks, kept one by one until the output is built of them, and outputs that are whole.

While tasks run, each result waits in a file of its own in a hidden folder beside the output. The
finished output says from what it was made: ``--resume`` uses the results that are kept, and leaves
an output that is whole as it is.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from planner._version import __version__
from planner.exceptions import InvalidFile, InvalidInput
from planner.files.staging import all_there, cannot_write, staged
from planner.files.text import to_json

MANIFEST = "settings.json"
"""In a folder of results: what they were computed from."""


DIGEST = sha256().digest_size
"""Bytes before a result, by which a damaged one is known."""


@dataclass(frozen=True)
class Task:
    """A piece of work.

    Attributes:
        name: What messages call it, such as "episode 12"; no two tasks have the same.
        argument: What the function takes; it is pickled.
        inputs: What identifies the content of its inputs, such as a digest of a file: where that
            changes, an earlier result is not used.
    """

    name: str
    argument: Any
    inputs: str = ""


class Results:
    """A folder with the results of tasks, one file each, which begins with a digest of the result.

    A result is found by what it was computed from: the settings, the name and the inputs of its
    task, and the version of this package. A damaged one is as good as none.
    """

    def __init__(
        self,
        folder: Path | str,
        settings: Mapping[str, Any],
        *,
        resume: bool = False,
        output: Path | str | None = None,
    ) -> None:
        """Open the folder, or begin it.

        Args:
            folder: The folder.
            settings: What all results depend on, as JSON takes it.
            resume: Keep the results that are there; they are removed otherwise.
            output: What is built of the results, as messages name it; by default the folder.

        Raises:
            InvalidInput: The results that are there were computed with other settings.
            InvalidFile: The folder cannot be made or written.
        """
        self.folder = Path(folder)
        self._output = folder if output is None else output
        self._settings = json.loads(json.dumps({"version": __version__, **settings}))
        self._digest = _digest(self._settings)
        self.removed = 0
        manifest = self.folder / MANIFEST
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
            raise cannot_write(self._output, error) from error
        self._keep(manifest, (json.dumps(self._settings, indent=2) + "\n").encode())

    def __contains__(self, task: Task) -> bool:
        return self._read(task) is not None

    def write(self, task: Task, result: bytes) -> None:
        """Keep a result; it appears whole or not at all.

        Raises:
            InvalidFile: The output cannot be written; what is kept stays.
        """
        self._keep(self._file(task), sha256(result).digest() + result)

    def read(self, task: Task) -> bytes:
        """The result of a task that has one."""
        result = self._read(task)
        assert result is not None, "a task without a result"
        return result

    def remove_if_empty(self) -> None:
        """Remove the folder where it holds no result."""
        if next(self.folder.glob("??/*"), None) is None:
            self.remove()

    def remove(self) -> None:
        """Remove the folder, once the outputs are written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _read(self, task: Task) -> bytes | None:
        """The result of a task; None where there is none, or one that is damaged."""
        try:
            content = self._file(task).read_bytes()
        except OSError:
            return None
        digest, result = content[:DIGEST], content[DIGEST:]
        return result if sha256(result).digest() == digest else None

    def _keep(self, file: Path, content: bytes) -> None:
        try:
            file.parent.mkdir(exist_ok=True)
            with staged(file, content):
                pass
        except (InvalidFile, OSError) as error:  # with its hidden name, which says nothing
            cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
            raise cannot_write(self._output, cause) from error

    def _file(self, task: Task) -> Path:
        name = _digest([self._digest, task.name, task.inputs])
        return self.folder / name[:2] / name[2:]

    def _check_same(self, before: Any) -> None:
        if before == self._settings:
            return
        known = before if isinstance(before, dict) else {}
        names = [
            name
            for name in {**known, **self._settings}
            if known.get(name) != self._settings.get(name)
        ]
        raise InvalidInput(
            f"--resume: {self.folder} holds results for other settings ({', '.join(names)}); set "
            "what was set then, or leave --resume out to compute all again"
        )


def results_folder(output: Path | str) -> Path:
    """Where the results wait from which an output is built: a hidden folder, ``.NAME.results``."""
    target = Path(output).resolve()
    return target.with_name(f".{target.name}.results")


def results_beside(
    output: Path | str, settings: Mapping[str, Any], *, resume: bool = False
) -> Results:
    """The results from which an output is built."""
    return Results(results_folder(output), settings, resume=resume, output=output)


MADE_FROM = "made_from"
"""In what an output says of itself: a digest of what it was made from, and of all else it says."""


def made_from(settings: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, str]:
    """The key by which :func:`finished` knows an output.

    Args:
        settings: All that the output depends on, as JSON takes it.
        document: What the output says of itself, with or without this key.
    """
    said = json.loads(to_json({key: document[key] for key in document if key != MADE_FROM}))
    return {MADE_FROM: _digest({"version": __version__, **settings, "document": said})}


def finished(output: Path | str, name: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """What an output says of itself, if it was made from the same settings and is whole.

    The results that another command has left beside it are removed then.

    Args:
        output: The folder.
        name: The file in it that says so; it holds what :func:`made_from` gives.
        settings: All that the output depends on, as JSON takes it.
    """
    said: dict[str, Any] | None = _read_json(Path(output) / name)
    same = isinstance(said, dict) and said.get(MADE_FROM) == made_from(settings, said)[MADE_FROM]
    if not same or not all_there(output):
        return None
    shutil.rmtree(results_folder(output), ignore_errors=True)
    return said


def _digest(content: Any) -> str:
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


def _read_json(file: Path) -> Any:
    """The content of a file; None where there is none that could be read."""
    try:
        return json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
