"""Outputs that appear whole or not at all: one file, or a folder of results."""

from __future__ import annotations

import errno
import json
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from planner.exceptions import InvalidFile

MANIFEST = "results.json"
"""The file of a run that lists, under ``files``, every file of that run."""

MOST_MANIFEST = 64 * 2**20
"""Longest manifest that is read [bytes]."""

MOST_FOREIGN = 1000
"""Files of others that are counted before the search for more of them is given up."""


@contextmanager
def staged(path: Path | str, content: bytes) -> Iterator[None]:
    """Write ``content`` beside ``path``, and rename it to ``path`` if the block does not raise.

    So that of several files all appear or none: the last one is written in the block of the others.
    Whoever reads ``path`` meanwhile gets the old content or the new one. A process that is killed
    leaves a hidden file, ``.NAME.new-…``. A device or a pipe is written to directly.

    Raises:
        InvalidFile: The folder does not exist or cannot be written to.
    """
    target = Path(path)
    if _is_device(target):
        yield
        try:
            target.write_bytes(content)
        except OSError as error:
            raise cannot_write(path, error) from error
        return
    new = _beside(target, "new")
    try:
        try:
            with new.open("xb") as stream:
                stream.write(content)
        except OSError as error:
            raise cannot_write(path, error) from error
        yield
        try:
            if target.exists():
                new.chmod(target.stat().st_mode & 0o777)
            new.replace(target.resolve())
        except OSError as error:
            raise cannot_write(path, error) from error
    finally:
        new.unlink(missing_ok=True)


@contextmanager
def output_folder(path: Path | str, *, export: str = "") -> Iterator[Path]:
    """Hand out an empty folder, and put it in the place of ``path`` once it is filled.

    The last run's folder stays as it is until then, and for good where the block raises or the
    process is killed; killed between two renames, it leaves it beside, as ``.NAME.old-…``. It is
    replaced only if it is empty or holds nothing but the files that its own manifest lists: what a
    user has put there is never removed.

    Args:
        path: The folder.
        export: Name of a format, for which a manifest is written; the block writes its own
            otherwise.

    Raises:
        InvalidFile: ``path`` is a file, holds something else, or cannot be written.
    """
    path = str(path) or "."
    target = _target(path)
    _check_replaceable(path, target)
    new = _beside(target, "new")
    try:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            new.mkdir()
        except OSError as error:
            raise _cannot_make(path, error) from error
        yield new
        if export:
            manifest = {"export": export, "files": list_files(new)}
            (new / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n")
        _check_replaceable(path, target)
        try:
            _replace(target, new)
        except OSError as error:
            raise InvalidFile(
                path, f"cannot be replaced ({reason(error)}); choose a folder inside it"
            ) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)


def check_writable(path: Path | str) -> None:
    """Make sure that a file can be written, before anything is computed for it.

    Raises:
        InvalidFile: Its folder is not there or cannot be written to, or the name is a folder's.
    """
    target = Path(path)
    if _is_device(target):
        return
    try:
        (target.parent / ".").stat()
        if not target.parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        if not os.access(target.parent, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise cannot_write(path, error) from error


def check_folder(path: Path | str) -> None:
    """Make sure that a folder of results can be made or replaced; see :func:`output_folder`.

    Raises:
        InvalidFile: It is a file, holds something else, or cannot be made.
    """
    path = str(path) or "."
    target = _target(path)
    _check_replaceable(path, target)
    above = next(each for each in target.parents if each.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        number = errno.EACCES if above.is_dir() else errno.ENOTDIR
        raise _cannot_make(path, OSError(number, os.strerror(number)))


def list_files(folder: Path) -> list[str]:
    """Every file below ``folder``, as sorted paths relative to it."""
    return sorted(_files_below(folder))


def all_there(folder: Path | str) -> bool:
    """Whether every file that the manifest of a folder lists is there."""
    target = _target(folder)
    files = _made_by_a_run(target)
    return bool(files) and all((target / name).is_file() for name in files)


def cannot_write(path: Path | str, error: OSError | ValueError) -> InvalidFile:
    """The error that a file cannot be written."""
    return InvalidFile(
        path, f"cannot be written ({reason(error)}); choose another place for the output"
    )


def reason(error: OSError | ValueError) -> str:
    """What the system says, in lower case."""
    return (getattr(error, "strerror", None) or str(error)).lower()


def _target(path: Path | str) -> Path:
    """Where a folder of results really is."""
    try:
        return Path(path).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a link to itself, or a null byte
        raise InvalidFile(path, "is no name of a folder; choose another one") from error


def _beside(target: Path, age: str) -> Path:
    """An unused hidden name beside a file or folder.

    Chosen before anything is made, so that a signal at any moment finds the name to clear away.
    """
    return target.with_name(f".{target.name}.{age}-{secrets.token_hex(8)}")


def _cannot_make(path: Path | str, error: OSError) -> InvalidFile:
    return InvalidFile(path, f"cannot be made ({reason(error)}); choose another folder")


def _is_device(target: Path) -> bool:
    """Whether it is a device or a named pipe, rather than a file or nothing yet.

    Raises:
        InvalidFile: It is a folder, or no file can have this name.
    """
    try:
        mode = target.stat().st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:  # a link to itself, too, or a null byte
        raise cannot_write(target, error) from error
    return not stat.S_ISREG(mode)


def _files_below(folder: Path) -> Iterator[str]:
    return (file.relative_to(folder).as_posix() for file in folder.rglob("*") if not file.is_dir())


def _replace(target: Path, new: Path) -> None:
    """Put ``new`` in the place of ``target``; a folder with files in it takes two renames."""
    if not target.exists() or not any(target.iterdir()):
        new.replace(target)
        return
    last = _beside(target, "old")
    target.replace(last)
    try:
        new.replace(target)
    except OSError:
        last.replace(target)
        raise
    shutil.rmtree(last, ignore_errors=True)


def _check_replaceable(path: Path | str, target: Path) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise InvalidFile(path, "is a file, expected a folder; choose another name")
    ours = _made_by_a_run(target)
    foreign = sorted(
        islice((file for file in _files_below(target) if file not in ours), MOST_FOREIGN)
    )
    if foreign:
        least = "at least " if len(foreign) == MOST_FOREIGN else ""
        others = f" and {least}{len(foreign) - 1} more" if len(foreign) > 1 else ""
        raise InvalidFile(
            path,
            f"holds files that no earlier run made ({foreign[0]}{others}), expected a new or empty "
            "folder or an earlier run's; choose another folder or move them away",
        )


def _made_by_a_run(target: Path) -> set[str]:
    """What the manifest lists; nothing where there is none that a run could have written."""
    manifest = target / MANIFEST
    try:
        if not manifest.is_file() or manifest.stat().st_size > MOST_MANIFEST:
            return set()
        content = json.loads(manifest.read_bytes())
    except (OSError, ValueError, RecursionError):
        return set()
    files = content.get("files") if isinstance(content, dict) else None
    if not isinstance(files, list):
        return set()
    return {MANIFEST, *(name for name in files if isinstance(name, str))}
