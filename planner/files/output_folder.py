"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from planner.exceptions import InvalidFile
from planner.files.aside import prefix, sweep
from planner.files.exchange import exchange
from planner.files.text import read_text

MANIFEST = "results.json"
"""The file of a run that lists, under ``files``, every file of that run."""

MOST_FOREIGN = 1000
"""Files of others that are counted before the search for more of them is given up."""


@contextmanager
def output_folder(path: Path | str) -> Iterator[Path]:
    """Hand out an empty folder, and put it in the place of ``path`` once it is filled.

    The last run's folder stays as it is until then, and for good where the block raises or the
    process is killed. It is replaced only if it is empty or holds nothing but the files that its
    own manifest lists: what a user has put there is never removed.

    Raises:
        InvalidFile: ``path`` is a file, holds something else, or cannot be written.
    """
    path = str(path) or "."
    try:
        target = Path(path).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a link to itself, or a null byte
        raise InvalidFile(path, "is no name of a folder; choose another one") from error
    _check_replaceable(path, target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target)
        aside = Path(tempfile.mkdtemp(dir=target.parent, prefix=prefix(target)))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(path, f"cannot be made ({reason}); choose another folder") from error
    try:
        aside.chmod(0o755)
        yield aside
        _check_replaceable(path, target)
        try:
            _swap(aside, target)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InvalidFile(
                path, f"cannot be replaced ({reason}); choose a folder inside it"
            ) from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def list_files(folder: Path) -> list[str]:
    """Every file below ``folder``, as sorted paths relative to it."""
    return sorted(_files_below(folder))


def _files_below(folder: Path) -> Iterator[str]:
    return (file.relative_to(folder).as_posix() for file in folder.rglob("*") if not file.is_dir())


def _swap(aside: Path, target: Path) -> None:
    """Put ``aside`` in the place of ``target``, and what was there, if anything, in its own."""
    if not target.exists():
        aside.rename(target)
    elif not exchange(aside, target):
        # Two steps, for systems that know no better: whoever is killed between them finds the last
        # run's folder beside the place where it was.
        last = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.old-"))
        target.replace(last)
        try:
            aside.rename(target)
        except OSError:
            last.rename(target)
            raise
        last.rename(aside)


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
        content = json.loads(read_text(manifest)) if manifest.is_file() else None
    except (OSError, ValueError, RecursionError):  # InvalidFile is a ValueError
        return set()
    files = content.get("files") if isinstance(content, dict) else None
    if not isinstance(files, list):
        return set()
    return {MANIFEST, *(name for name in files if isinstance(name, str))}
