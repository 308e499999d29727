"""Outputs that appear whole or not at all: one file, or a folder of results.

Content goes to the disk before a rename makes it the output, so that after a power cut, as after a
killed process, the output is the last good one or the new one. A hidden file beside a folder,
``.NAME.lock``, is locked while a command works on it. The system releases the lock however the
process ends; under it the next run replaces the remnants of a killed one, ``.NAME.new-run`` and
``.NAME.old-run``. Those of a file are locked themselves, and swept when it is written again. Where
the file system has no locks, no command is refused, and each has hidden names of its own.
"""

from __future__ import annotations

import errno
import fcntl
import glob
import json
import os
import shutil
import stat
import time
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any

from planner.exceptions import InvalidFile

MANIFEST = "results.json"  # the file of a run that lists, under `files`, every file of that run

# Folders of results that this process works on, with the end of their hidden names; and hidden
# folders that it fills, which appear whole, so that no file in them is staged.
_CLAIMED: dict[Path, str] = {}
_FILLED: set[Path] = set()


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
    new = target.with_name(f".{target.name}.new-{os.urandom(8).hex()}")
    _sweep(target)
    try:
        with ExitStack() as opened:
            with writing(path):
                with new.open("xb") as stream:
                    stream.write(content)
                with suppress(OSError):  # a file system without locks
                    fcntl.flock(opened.enter_context(new.open("rb")), fcntl.LOCK_EX)
                _to_disk(new)
            yield
            with writing(path):
                if target.exists():
                    new.chmod(target.stat().st_mode & 0o777)
                new.replace(target)
            _to_disk(target.parent)
    finally:
        with suppress(OSError):
            new.unlink()


def _sweep(target: Path) -> None:
    """Remove what killed processes have left beside a file: no longer locked, and a minute old."""
    for left in target.parent.glob(f".{glob.escape(target.name)}.new-{16 * '?'}"):
        with suppress(OSError), left.open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if time.time() - left.stat().st_mtime > 60.0:
                left.unlink()


@contextmanager
def output_folder(path: Path | str, *, export: str = "") -> Iterator[Path]:
    """Hand out an empty folder, and put it in the place of ``path`` once it is filled.

    The last run's folder stays until then, and for good where the block raises; killed between two
    renames, the process leaves it beside, as ``.NAME.old-run``. It is replaced only if it is empty
    or holds nothing but the files that its own manifest lists: a user's files are never removed.
    Of an ``export``, the name of a format, a manifest is written here.
    """
    target = _target(str(path) or ".")
    with claimed(path) as run:
        new, last = (target.with_name(f".{target.name}.{age}-{run}") for age in ("new", "old"))
        shutil.rmtree(new, ignore_errors=True)
        try:
            with writing(path):
                new.mkdir()
            _FILLED.add(new)
            try:
                yield new
                if export:
                    manifest = {"export": export, "files": list_files(new)}
                    (new / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n")
                for each in (*new.rglob("*"), new):
                    _to_disk(each)
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
                    shutil.rmtree(last, ignore_errors=True)
                    target.replace(last)
                try:
                    new.replace(target)
                except OSError:
                    with suppress(FileNotFoundError):
                        last.replace(target)
                    raise
                shutil.rmtree(last, ignore_errors=True)
            except OSError as error:
                raise InvalidFile(
                    path, f"cannot be replaced ({reason(error)}); choose a folder inside it"
                ) from error
            _to_disk(target.parent)
        finally:
            _FILLED.discard(new)
            shutil.rmtree(new, ignore_errors=True)


@contextmanager
def claimed(path: Path | str) -> Iterator[str]:
    """Keep other commands from a folder of results, once checked; the end of its hidden names."""
    path = str(path) or "."
    target = _target(path)
    if target in _CLAIMED:
        yield _CLAIMED[target]
        return
    check_folder(path)
    with writing(path):
        target.parent.mkdir(parents=True, exist_ok=True)
    place, descriptor = target.with_name(f".{target.name}.lock"), -1
    try:
        descriptor = _locked(place)
    except BlockingIOError as error:
        advice = "wait until that has ended, or choose another folder"
        raise InvalidFile(path, f"another command is at work on it; {advice}") from error
    except OSError:  # no locks, or a folder that refuses the output as well
        pass
    _CLAIMED[target] = os.urandom(8).hex() if descriptor < 0 else "run"
    try:
        yield _CLAIMED[target]
    finally:
        del _CLAIMED[target]
        if descriptor >= 0:
            place.unlink(missing_ok=True)
            os.close(descriptor)


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


def list_files(folder: Path, but: Collection[str] = (), most: int | None = None) -> list[str]:
    """Every file below ``folder``, ``but`` these, as sorted paths relative to it."""
    files = (file for file in folder.rglob("*") if not file.is_dir())
    names = (file.relative_to(folder).as_posix() for file in files)
    return sorted(islice((name for name in names if name not in but), most))


def all_there(folder: Path | str) -> bool:
    """Whether every file that the manifest of a folder lists is there."""
    files = _files_of_run(Path(folder))
    return bool(files) and all(Path(folder, name).is_file() for name in files)


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


def _target(path: Path | str) -> Path:
    try:
        return Path(path).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a link to itself, or a null byte
        raise InvalidFile(path, "is no name of a folder; choose another one") from error


def _locked(place: Path) -> int:
    """Descriptor of a lock file that is locked, and still there; BlockingIOError of a busy one."""
    while True:
        descriptor = os.open(place, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with suppress(FileNotFoundError):  # its last owner has removed it
                if os.path.samestat(os.fstat(descriptor), place.stat()):
                    return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _to_disk(path: Path) -> None:
    """Flush a file, or the names in a folder that may be read, where the file system can."""
    is_folder = path.is_dir()
    try:
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        if not is_folder and error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise


def _is_device(target: Path) -> bool:
    """Whether it is a device or a named pipe, rather than a file or nothing yet."""
    try:
        mode = target.stat().st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:  # a link to itself, too, or a null byte
        raise cannot_write(target, error) from error
    return not stat.S_ISREG(mode)


def _replaceable(path: Path | str) -> Path:
    """The folder of a run, resolved; it is new, empty or holds nothing but an earlier run's."""
    path = str(path) or "."
    target = _target(path)
    if not target.exists():
        return target
    if not target.is_dir():
        raise InvalidFile(path, "is a file, expected a folder; choose another name")
    if foreign := list_files(target, _files_of_run(target), most=1000):
        least, more = "at least " if len(foreign) == 1000 else "", len(foreign) - 1
        others = f" and {least}{more} more" if more else ""
        words = f"holds files that no earlier run made ({foreign[0]}{others}), expected a new or"
        advice = "choose another folder or move them away"
        raise InvalidFile(path, f"{words} empty folder or an earlier run's; {advice}")
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
