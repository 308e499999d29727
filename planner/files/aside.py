"""What is written beside its target until it is whole, and what killed processes leave of it."""

from __future__ import annotations

import os
import re
import shutil
import stat
import time
from contextlib import suppress
from pathlib import Path

LEFT_BEHIND = 3600.0
"""Age from which on it belongs to a process that was killed [s]; writing takes seconds."""


def prefix(target: Path) -> str:
    """What names beside ``target`` begin with, before the eight characters of :mod:`tempfile`."""
    return f".{target.name}.new-"


def sweep(target: Path) -> None:
    """Remove what was left beside ``target``, file or folder, :data:`LEFT_BEHIND` ago or before."""
    ours = re.compile(re.escape(prefix(target)) + r"[a-z0-9_]{8}")
    with suppress(OSError), os.scandir(target.parent) as entries:
        for entry in entries:
            if ours.fullmatch(entry.name):
                _remove_if_old(Path(entry.path))


def _remove_if_old(left: Path) -> None:
    with suppress(OSError):  # another process may be sweeping too
        about = left.lstat()
        if time.time() - about.st_mtime <= LEFT_BEHIND:
            return
        if stat.S_ISDIR(about.st_mode):
            shutil.rmtree(left, ignore_errors=True)
        elif stat.S_ISREG(about.st_mode):
            left.unlink()
