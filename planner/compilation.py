"""Functions compiled by Numba: one decorator, its cache, and what a person is told of it.

Import this module where compiled functions are defined, and those modules where they are called,
inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event

COMPILING = "request-planner: compiling the joint model, once after installation ..."

NO_CACHE = (
    "request-planner: compiling the joint model, at every start, because no folder can be written "
    "to: set NUMBA_CACHE_DIR to one that can"
)

CONFIG: Any = numba.config

P = ParamSpec("P")
T = TypeVar("T")


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """The function, compiled at its first call.

    It is cached beside its file, or in the user's cache folder, until its file or one of the
    package that this one imports changes: what they define is compiled into it.
    """
    options: Any = {"error_model": "numpy"}
    folder = _cache_folder(function.__module__)
    if folder is None:
        return numba.njit(function, **options)  # type: ignore[no-any-return]
    users, CONFIG.CACHE_DIR = CONFIG.CACHE_DIR, str(folder)
    try:
        return numba.njit(function, cache=True, **options)  # type: ignore[no-any-return]
    except RuntimeError:  # the folder cannot be written to after all
        return numba.njit(function, **options)  # type: ignore[no-any-return]
    finally:
        CONFIG.CACHE_DIR = users


@cache
def _cache_folder(module: str) -> Path | None:
    """Where the functions of a module are cached in this state of its sources, or None."""
    source, digest = Path(str(sys.modules[module].__file__)), sha256()
    for name in sorted(_imported(module)):
        digest.update(Path(str(sys.modules[name].__file__)).read_bytes())
    beside, user = source.parent / "__pycache__", os.environ.get("XDG_CACHE_HOME", "~/.cache")
    folders = [beside, Path(user).expanduser() / "request-planner"]
    if CONFIG.CACHE_DIR:
        folders = [Path(CONFIG.CACHE_DIR)]
    for folder in folders:
        kept = folder / f"{source.stem}-{digest.hexdigest()[:16]}"
        try:
            new = not kept.exists()
            kept.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(kept, os.W_OK):
            if new and folder == beside:  # nobody will look for those of other sources again
                for other in set(beside.glob(f"{source.stem}-{16 * '?'}")) - {kept}:
                    shutil.rmtree(other, ignore_errors=True)
            return kept
    return None


def _imported(module: str) -> set[str]:
    """The module and those of the package that it imports at its top, directly or not."""
    found, left = {module}, [module]
    while left:
        text = Path(str(sys.modules[left.pop()].__file__)).read_text(encoding="utf-8")
        names = set(re.findall(r"^from (planner\.[\w.]+) import", text, flags=re.MULTILINE))
        left += names - found
        found |= names
    return found


class _Announcement(event.Listener):
    """Tells a person at a terminal, once a process, that compilation takes a moment."""

    def __init__(self) -> None:
        self._announced = False

    def on_start(self, event: Any) -> None:
        module = str(event.data["dispatcher"].py_func.__module__)
        if not self._announced and module.startswith("planner."):
            self._announced = True
            if sys.stderr is not None and sys.stderr.isatty():
                print(COMPILING if _cache_folder(module) else NO_CACHE, file=sys.stderr, flush=True)

    def on_end(self, event: Any) -> None:
        pass


event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]
