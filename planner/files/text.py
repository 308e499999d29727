"""Text in and out: files or, as ``-``, the standard streams; written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from planner.exceptions import InvalidFile
from planner.files.aside import prefix, sweep

STANDARD_STREAM = "-"
"""The name that stands for standard input or standard output."""

MOST_BYTES = 64 * 2**20
"""Longest text that is read [bytes]: a million requests for three joints come to half of it."""

CHUNK = 2**15
"""Characters that go to standard output at once: where Python does not buffer it, the rest of a
longer text is lost without a word when its reader goes away."""


def read_text(path: Path | str) -> str:
    """Whole text of a file, or of standard input for ``-``; UTF-8, with or without a mark.

    Raises:
        InvalidFile: There is no such file, it cannot be read, is too long, or is not UTF-8.
    """
    if not str(path):
        raise InvalidFile("''", "is no name of a file; name one, or - for standard input")
    if str(path) == STANDARD_STREAM and sys.stdin is None:
        raise InvalidFile(path, "standard input is closed; give it a file or a pipe")
    try:
        if str(path) == STANDARD_STREAM:
            content = sys.stdin.buffer.read(MOST_BYTES + 1)
        else:
            with Path(path).open("rb") as stream:
                content = stream.read(MOST_BYTES + 1)
    except FileNotFoundError as error:
        raise InvalidFile(path, "no such file; check the name and the folder") from error
    except (OSError, ValueError) as error:  # a name with a null byte is no name
        reason = _reason(error)
        raise InvalidFile(path, f"cannot be read ({reason}); expected a text file") from error
    if len(content) > MOST_BYTES:
        raise InvalidFile(path, f"longer than {MOST_BYTES >> 20} MiB; is it the right file?")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InvalidFile(
            path,
            f"byte 0x{content[error.start]:02x} is not UTF-8; save the file as UTF-8 text",
            line=line,
        ) from error


def write_text(path: Path | str, text: str) -> None:
    """Write ``text`` to a file, or to standard output for ``-``.

    A file is written aside and put in place in one step: whoever reads it meanwhile, and whatever
    goes wrong, it holds the old text or the new one, never a part. A process that is killed may
    leave what it wrote aside, a hidden file; the first write from an hour later on removes it.

    Raises:
        InvalidFile: The folder does not exist or cannot be written to.
        BrokenPipeError: The reader of standard output has gone away.
    """
    if str(path) == STANDARD_STREAM:
        _write_standard_output(text)
        return
    write_bytes(path, text.encode())


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write ``content`` to a file, whole or not at all; see :func:`write_text`."""
    with staged(path, content):
        pass


@contextmanager
def staged(path: Path | str, content: bytes) -> Iterator[None]:
    """Write ``content`` aside, and put it in place only if the block does not raise.

    So that of several files all appear or none: the last one is written in the block of the others.

    Raises:
        InvalidFile: As :func:`write_text` does.
    """
    target = Path(path)
    if _takes_what_it_is_given(path):
        yield
        _write_through(target, content)
        return
    try:
        sweep(target)
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=prefix(target))
    except OSError as error:
        raise _cannot_write(path, error) from error
    aside = Path(name)
    try:
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
        except OSError as error:
            raise _cannot_write(path, error) from error
        yield
        try:
            aside.chmod(_permissions(target))
            aside.replace(target.resolve())
        except OSError as error:
            raise _cannot_write(path, error) from error
    finally:
        aside.unlink(missing_ok=True)


def _write_standard_output(text: str) -> None:
    if sys.stdout is None:
        raise InvalidFile(STANDARD_STREAM, "standard output is closed; name a file for the output")
    try:
        for start in range(0, len(text), CHUNK):
            sys.stdout.write(text[start : start + CHUNK])
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _cannot_write(STANDARD_STREAM, error) from error


def _write_through(target: Path, content: bytes) -> None:
    try:
        target.write_bytes(content)
    except OSError as error:
        raise _cannot_write(target, error) from error


def _takes_what_it_is_given(path: Path | str) -> bool:
    """Whether it is a device or a named pipe, rather than a file or nothing yet.

    Raises:
        InvalidFile: It is a folder, or no file can have this name.
    """
    target = Path(path)
    try:
        mode = target.stat().st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:  # a link to itself, too, or a null byte
        raise _cannot_write(target, error) from error
    return not stat.S_ISREG(mode)


def _permissions(target: Path) -> int:
    """Those of the file that is replaced, or those that any new file would get."""
    if target.exists():
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _cannot_write(path: Path | str, error: OSError | ValueError) -> InvalidFile:
    return InvalidFile(
        path, f"cannot be written ({_reason(error)}); choose another place for the output"
    )


def _reason(error: OSError | ValueError) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()
