"""Two paths exchanged in one step, so that neither is ever missing."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

_AT_FDCWD = -100  # <fcntl.h>: relative paths are relative to the working folder
_RENAME_EXCHANGE = 2  # <linux/fs.h>


def exchange(one: Path, other: Path) -> bool:
    """Let two existing paths change places, whatever they are, by Linux's ``renameat2``.

    Returns:
        Whether it was done; not where the system or the file system cannot do it.
    """
    try:
        rename = ctypes.CDLL(None).renameat2
    except (OSError, AttributeError):  # not a C library of Linux
        return False
    done: int = rename(
        _AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), ctypes.c_uint(_RENAME_EXCHANGE)
    )
    return done == 0
