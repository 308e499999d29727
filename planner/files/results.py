"""Results of single tasks, kept beside the output that is built from them, and resumed.

The manifest of an output shows whether it is complete and was made from the same settings.
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
from planner.files.staging import all_there, cannot_write, read_manifest, staged, writing
from planner.files.text import to_json


@dataclass(frozen=True)
class Task:
    """A piece of work."""

    name: str  # unique among the tasks
    argument: Any  # which is pickled
    inputs: str = ""  # identifies the content of its inputs: another one has another result


class Results:
    """The results of tasks in a hidden folder beside the output that is built from them.

    Each is a file that begins with a digest of its content, identified by the settings, the name
    and the inputs of its task, and the version of this package.
    """

    def __init__(
        self, output: Path | str, settings: Mapping[str, Any], *, resume: bool = False
    ) -> None:
        """Begin the folder ``.NAME.results`` beside an output; ``resume`` one of these settings."""
        target = Path(output).resolve()
        self.folder = target.with_name(f".{target.name}.results")
        self._output = output
        self._settings = json.loads(json.dumps({"version": __version__, **settings}))
        self.removed = 0
        manifest = self.folder / "settings.json"
        before = read_manifest(manifest)
        if resume and before is not None:
            old = before if isinstance(before, dict) else {}
            names = {**old, **self._settings}
            if keys := [name for name in names if old.get(name) != self._settings.get(name)]:
                words = f"{self.folder} holds results for other settings ({', '.join(keys)})"
                advice = "set what was set then, or leave --resume out to compute all again"
                raise InvalidInput(f"--resume: {words}; {advice}")
            return
        with writing(output):
            if self.folder.exists() and not resume:
                self.removed = sum(1 for _ in self.folder.glob("??/*"))
                shutil.rmtree(self.folder)
            self.folder.mkdir(parents=True, exist_ok=True)
        self._keep(manifest, json.dumps(self._settings, indent=2).encode())

    def __contains__(self, task: Task) -> bool:
        return self.read(task) is not None

    def write(self, task: Task, result: bytes) -> None:
        """Keep a result; it appears whole or not at all."""
        self._keep(self._file(task), sha256(result).digest() + result)

    def read(self, task: Task) -> bytes | None:
        """The result of a task; None where there is none, or a damaged one."""
        try:
            content = self._file(task).read_bytes()
        except OSError:
            return None
        return content[32:] if sha256(content[32:]).digest() == content[:32] else None

    def remove(self, *, if_empty: bool = False) -> None:
        """Remove the folder, once the output is written, or only where it holds no result."""
        if not if_empty or next(self.folder.glob("??/*"), None) is None:
            shutil.rmtree(self.folder, ignore_errors=True)

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


def made_from(settings: Mapping[str, Any], manifest: Mapping[str, Any]) -> dict[str, str]:
    """The key of a manifest by which :func:`finished` recognises an output that is whole."""
    rest = {name: each for name, each in manifest.items() if name != "made_from"}
    return {"made_from": _digest([__version__, settings, json.loads(to_json(rest))])}


def finished(output: Path | str, name: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """The manifest of a whole output from these settings, whose results go; None if it is not."""
    manifest: dict[str, Any] | None = read_manifest(Path(output) / name)
    same = isinstance(manifest, dict) and made_from(settings, manifest).items() <= manifest.items()
    if not same or not all_there(output):
        return None
    target = Path(output).resolve()
    shutil.rmtree(target.with_name(f".{target.name}.results"), ignore_errors=True)
    return manifest


def digest_of(file: Path | str) -> str:
    """The digest of a file's content; its name where there is no such file."""
    path = Path(file)
    return sha256(path.read_bytes()).hexdigest() if path.is_file() else str(file)


def _digest(content: Any) -> str:
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]
