"""Functions compiled by Numba: one decorator, its cache, and the line that announces compilation.

Import this module where compiled functions are defined, and those modules where they are called,
inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

import fcntl
import gc
import logging
import os
import re
import shutil
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

if "planner.cli" in sys.modules and "scipy.linalg" not in sys.modules:
    # Numba would import it, a tenth of the time of a short command, only to see whether it is there
    # for np.convolve and the like, which are loops without it. Nothing here calls them. A program
    # that uses the package may import it at the same time in another thread.
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    try:
        import_module("numba.np.arraymath")
    finally:
        del sys.modules["scipy.linalg"]

COMPILING = (
    "request-planner: compiling what this command needs, for up to half a minute; it is kept, and "
    "other commands compile the rest when they first need it ..."
)

NO_CACHE = (
    "request-planner: compiling the joint model, at every start, because no folder can be written "
    "to: set NUMBA_CACHE_DIR to one that can"
)

CONFIG: Any = numba.config

LOG = logging.getLogger(__name__)
"""Nothing is announced where it does not take warnings, as with ``--quiet``."""

PACKAGE = Path(__file__).parent

P = ParamSpec("P")
T = TypeVar("T")

OPTIONS: Any = {"error_model": "numpy"}


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """The function, compiled at its first call.

    It is cached beside its file, or in the user's cache folder, until its file or one of the
    package that this one imports changes: their functions are compiled into it.
    """
    folder = _cache_folder(function.__module__)
    if folder is None:
        return numba.njit(function, **OPTIONS)  # type: ignore[no-any-return]
    users, CONFIG.CACHE_DIR = CONFIG.CACHE_DIR, str(folder)
    try:
        return numba.njit(function, cache=True, **OPTIONS)  # type: ignore[no-any-return]
    except RuntimeError:  # the folder cannot be written to after all
        return numba.njit(function, **OPTIONS)  # type: ignore[no-any-return]
    finally:
        CONFIG.CACHE_DIR = users


def inner(function: Callable[P, T]) -> Callable[P, T]:
    """The function, compiled only in the compiled functions that call it, not once more by itself.

    That leaves out a third of the compilation. A test that calls the function compiles its
    ``py_func``.
    """
    options = OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return numba.njit(function, pipeline_class=_InnerCompiler, **options)  # type: ignore[no-any-return]


class _InnerLibrary(JITCodeLibrary):
    """The code of a function, neither optimised nor translated here."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _InnerCompiler(Compiler):
    """Numba's compiler, without the steps that callers repeat."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, and register it for its callers."""
        state: Any = self.state
        compile_extra: Any = super().compile_extra
        library: Any = _InnerLibrary
        state.library = library(state.targetctx.codegen(), func.__qualname__)
        state.flags.no_compile = True
        # Numba needs a builtin of its own for Python to call: an empty list has nothing to remove
        result = compile_extra(func)._replace(entry_point=[].remove)
        state.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
        return result


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
    modules, queue = {module}, [module]
    while queue:
        text = Path(str(sys.modules[queue.pop()].__file__)).read_text(encoding="utf-8")
        names = set(re.findall(r"^from (planner\.[\w.]+) import", text, flags=re.MULTILINE))
        queue += names - modules
        modules |= names
    return modules


class _Compilation(event.Listener):
    """Announces compilation once on standard error, and suspends garbage collection in it.

    Of processes that compile at the same time, such as workers and the commands of a pipe, one
    announces it: the first that locks the folder, until it ends. Garbage collection, which finds
    next to nothing, would take an eighth of the time.
    """

    def __init__(self) -> None:
        self._announced, self._depth, self._paused = False, 0, False

    def on_start(self, event: Any) -> None:
        module = str(event.data["dispatcher"].py_func.__module__)
        own = module.startswith("planner.")
        if own and self._depth == 0 and gc.isenabled():
            self._paused = True
            gc.disable()
        self._depth += 1
        if self._announced or not own:
            return
        self._announced = True
        if sys.stderr is None or not LOG.isEnabledFor(logging.WARNING):
            return
        kept = _cache_folder(module)
        folder = PACKAGE if kept is None or PACKAGE in kept.parents else kept.parent
        if _locked(folder):
            print(COMPILING if kept else NO_CACHE, file=sys.stderr, flush=True)

    def on_end(self, event: Any) -> None:  # noqa: ARG002
        self._depth -= 1
        if self._depth == 0 and self._paused:
            self._paused = False
            gc.enable()


def _locked(folder: Path) -> bool:
    """Lock a folder until this process ends; False where another one has locked it."""
    try:
        fcntl.flock(os.open(folder, os.O_RDONLY), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        pass
    return True


event.register("numba:compile", _Compilation())  # type: ignore[no-untyped-call]
