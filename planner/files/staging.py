"""Outputs that appear whole or not at all: one file, or a folder of results.

They are written under a hidden name of their own beside their place, and renamed to it: the output
is the last good one or the new one, however a command ends.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any

from planner.exceptions import InvalidFile

MANIFEST = "results.json"  # the file of a run that lists, under `files`, every file of that run

_FILLED: set[Path] = set()  # hidden folders that appear whole, so that no file in them is staged


@contextmanager
def staged(path: Path | str, content: bytes) -> Iterator[None]:
    """Write ``content`` beside ``path``, and rename it to ``path`` if the block does not raise.

    To have all of several files appear, or none, write each in the block of the one before. A
    device or a pipe is written to directly, as is a file in the folder of :func:`output_folder`.
    """
    target = Path(path)
    if _is_device(target):
        yield
        with writing(path):
            target.write_bytes(content)
        return
    target = target.resolve()
    if not _FILLED.isdisjoint(target.parents):
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)  # output_folder names the folder where there is no room
        yield
        return
    new = _hidden(target, "new")
    try:
        with writing(path), new.open("xb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())  # so that a power cut leaves no empty file
        yield
        with writing(path):
            if target.exists():
                new.chmod(target.stat().st_mode & 0o777)
            new.replace(target)
    finally:
        with suppress(OSError):
            new.unlink()


@contextmanager
def output_folder(path: Path | str, *, export: str = "") -> Iterator[Path]:
    """Hand out an empty folder, and put it in the place of ``path`` once it is filled.

    The last run's folder stays until then, and for good where the block raises; killed between two
    renames, the process leaves it beside, as ``.NAME.old-…``. It is replaced only if it is empty or
    holds nothing but the files that its own manifest lists: a user's files are never removed. Of an
    ``export``, the name of a format, a manifest is written here.
    """
    check_folder(path)
    target = Path(path).resolve()
    new, last = _hidden(target, "new"), _hidden(target, "old")
    with writing(path):
        new.mkdir(parents=True)
    _FILLED.add(new)
    try:
        try:
            yield new
            if export:
                manifest = {"export": export, "files": list_files(new)}
                (new / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n")
        except OSError as error:
            name = error.filename  # none where a disk is full
            own = name is None or Path(str(name)).is_relative_to(new)
            if isinstance(error, BrokenPipeError) or not own:
                raise
            inner = "" if name is None else Path(str(name)).relative_to(new)
            raise cannot_write(Path(path) / inner, error) from error
        _replaceable(path)
        try:
            if target.exists() and any(target.iterdir()):  # takes two renames
                target.replace(last)
            try:
                new.replace(target)
            except OSError:
                with suppress(FileNotFoundError):
                    last.replace(target)
                raise
        except OSError as error:
            raise InvalidFile(
                path, f"cannot be replaced ({reason(error)}); choose a folder inside it"
            ) from error
        shutil.rmtree(last, ignore_errors=True)
    finally:
        _FILLED.discard(new)
        shutil.rmtree(new, ignore_errors=True)


def _hidden(target: Path, age: str) -> Path:
    """A hidden place beside an output, which no other process has."""
    return target.with_name(f".{target.name}.{age}-{os.urandom(8).hex()}")


def check_writable(path: Path | str) -> None:
    """Make sure that a file can be written, before anything is computed for it."""
    target = Path(path)
    if str(path) == "-" or _is_device(target):
        return
    _check_access(target.resolve().parent, path)


def check_folder(path: Path | str) -> None:
    """Make sure that a folder of results can be made or replaced; see :func:`output_folder`."""
    _check_access(next(each for each in _replaceable(path).parents if each.exists()), path)


def _check_access(folder: Path, path: Path | str) -> None:
    """Raise InvalidFile about ``path`` if the folder takes no files."""
    with writing(path):
        is_folder = stat.S_ISDIR(folder.stat().st_mode)
        if not is_folder or not os.access(folder, os.W_OK | os.X_OK):
            number = errno.EACCES if is_folder else errno.ENOTDIR
            raise OSError(number, os.strerror(number))


def list_files(folder: Path) -> list[str]:
    """Every file below ``folder``, as sorted paths relative to it."""
    return sorted(_files_in(folder))


def _files_in(folder: Path) -> Iterator[str]:
    files = (file for file in folder.rglob("*") if not file.is_dir())
    return (file.relative_to(folder).as_posix() for file in files)


@contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """Turn an error of the system in the block into one about this output."""
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from error


def cannot_write(path: Path | str, error: Exception) -> InvalidFile:
    """The error that a file or a folder cannot be written."""
    return InvalidFile(
        path, f"cannot be written ({reason(error)}); choose another place for the output"
    )


def reason(error: Exception) -> str:
    """The system's message in lower case; of an error without a number its own text."""
    number = getattr(error, "errno", None)
    return (os.strerror(number) if number else str(error)).lower()


def _is_device(target: Path) -> bool:
    """Whether it is a device or a named pipe, rather than a file or nothing yet."""
    try:
        mode = target.stat().st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:  # such as a null byte
        raise cannot_write(target, error) from error
    return not stat.S_ISREG(mode)


def _replaceable(path: Path | str) -> Path:
    """The folder of a run, resolved; it is new, empty or holds nothing but an earlier run's."""
    with writing(path):
        target = Path(path).resolve()
        if not target.exists():
            return target
    if not target.is_dir():
        raise InvalidFile(path, "is a file, expected a folder; choose another name")
    own = _files_of_run(target)
    others = (name for name in _files_in(target) if name not in own)
    if foreign := min(islice(others, 1000), default=""):
        words = f"holds files that no earlier run made ({foreign}), expected a new or empty folder"
        advice = "choose another folder or move them away"
        raise InvalidFile(path, f"{words} or an earlier run's; {advice}")
    return target


def _files_of_run(target: Path) -> set[str]:
    """Files that the manifest lists; empty without a manifest of a run."""
    manifest = read_manifest(target / MANIFEST)
    files = manifest.get("files") if isinstance(manifest, dict) else None
    return {MANIFEST, *map(str, files)} if isinstance(files, list) else set()


def read_manifest(file: Path) -> Any:
    """The JSON in a file; None where it cannot be read."""
    try:
        return json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
