"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from planner.exceptions import InvalidFile

MANIFEST = "results.json"
"""The file of a run that lists, under ``files``, every file of that run."""


@contextmanager
def output_folder(path: Path | str) -> Iterator[Path]:
    """Hand out an empty folder, and put it in the place of ``path`` once it is filled.

    The last run's folder stays as it is until then, and for good where the block raises. It is
    replaced only if it is empty or holds nothing but the files that its own manifest lists: what a
    user has put there is never removed.

    Raises:
        InvalidFile: ``path`` is a file, holds something else, or cannot be written.
    """
    target = Path(path).resolve()
    _check_replaceable(path, target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.new-"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(path, f"cannot be made ({reason}); choose another folder") from error
    try:
        aside.chmod(0o755)
        yield aside
        _check_replaceable(path, target)
        _swap(aside, target)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def list_files(folder: Path) -> list[str]:
    """Every file below ``folder``, as sorted paths relative to it."""
    return sorted(
        file.relative_to(folder).as_posix() for file in folder.rglob("*") if not file.is_dir()
    )


def _swap(aside: Path, target: Path) -> None:
    if not target.exists():
        aside.rename(target)
        return
    last = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.old-"))
    target.replace(last)  # onto an empty folder: one step
    try:
        aside.rename(target)
    except OSError:
        last.rename(target)
        raise
    shutil.rmtree(last, ignore_errors=True)


def _check_replaceable(path: Path | str, target: Path) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise InvalidFile(path, "is a file, expected a folder; choose another name")
    foreign = sorted(set(list_files(target)) - _made_by_a_run(target))
    if foreign:
        others = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
        raise InvalidFile(
            path,
            f"holds files that no earlier run made ({foreign[0]}{others}), expected a new or empty "
            "folder or an earlier run's; choose another folder or move them away",
        )


def _made_by_a_run(target: Path) -> set[str]:
    try:
        files = json.loads((target / MANIFEST).read_text(encoding="utf-8"))["files"]
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    return {MANIFEST, *(name for name in files if isinstance(name, str))}
