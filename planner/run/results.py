"""Results of tasks, kept one by one until the output is built of them, and outputs that are whole.

While tasks run, each result waits in a file of its own in a hidden folder beside the output. The
finished output says from what it was made: ``--resume`` uses the results that are kept, and leaves
an output that is whole as it is.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner._version import __version__
from planner.exceptions import InvalidInput
from planner.files.staging import all_there, cannot_write, staged

MANIFEST = "settings.json"
"""In a folder of results: what they were computed from."""


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
    """A folder with the results of tasks, one file each; what is in it is whole.

    A result is found by what it was computed from: the settings, the name and the inputs of its
    task, and the version of this package.
    """

    def __init__(
        self, folder: Path | str, settings: Mapping[str, Any], *, resume: bool = False
    ) -> None:
        """Open the folder, or begin it.

        Args:
            folder: The folder.
            settings: What all results depend on, as JSON takes it.
            resume: Keep the results that are there; they are removed otherwise.

        Raises:
            InvalidInput: The results that are there were computed with other settings.
            InvalidFile: The folder cannot be made or written.
        """
        self.folder = Path(folder)
        self._settings = json.loads(json.dumps({"version": __version__, **settings}))
        self._digest = _digest(self._settings)
        self.removed = 0
        manifest = self.folder / MANIFEST
        before = _read_json(manifest)
        if resume and before is not None:
            self._check_same(before)
            return
        try:
            if self.folder.exists():
                self.removed = sum(1 for _ in self.folder.glob("??/*"))
                shutil.rmtree(self.folder)
            self.folder.mkdir(parents=True)
        except OSError as error:
            raise cannot_write(self.folder, error) from error
        with staged(manifest, (json.dumps(self._settings, indent=2) + "\n").encode()):
            pass

    def __contains__(self, task: Task) -> bool:
        return self._file(task).exists()

    def write(self, task: Task, result: bytes) -> None:
        """Keep a result; it appears whole or not at all."""
        file = self._file(task)
        file.parent.mkdir(exist_ok=True)
        with staged(file, result):
            pass

    def read(self, task: Task) -> bytes:
        """The result of a task that has one."""
        return self._file(task).read_bytes()

    def remove_if_empty(self) -> None:
        """Remove the folder where it holds no result."""
        if next(self.folder.glob("??/*"), None) is None:
            self.remove()

    def remove(self) -> None:
        """Remove the folder, once the outputs are written."""
        shutil.rmtree(self.folder, ignore_errors=True)

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
    return Results(results_folder(output), settings, resume=resume)


MADE_FROM = "made_from"
"""In what an output says of itself: a digest of what it was made from."""


def made_from(settings: Mapping[str, Any]) -> dict[str, str]:
    """What an output says of what it was made from: of the settings, and of this version."""
    return {MADE_FROM: _digest({"version": __version__, **settings})}


def finished(output: Path | str, name: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """What an output says of itself, if it was made from the same settings and is whole.

    Args:
        output: The folder.
        name: The file in it that says so; it holds :func:`made_from` the settings.
        settings: All that the output depends on, as JSON takes it.
    """
    said = _read_json(Path(output) / name)
    same = isinstance(said, dict) and said.get(MADE_FROM) == made_from(settings)[MADE_FROM]
    return said if same and all_there(output) else None


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


def _read_json(file: Path) -> Any:
    """The content of a file; None where there is none that could be read."""
    try:
        return json.loads(file.read_bytes())
    except (OSError, ValueError):
        return None
