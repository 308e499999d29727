"""Requests that make a lagging, saturating joint follow the path you want."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

_HOME = {
    name.name: statement.module
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for name in statement.names
}
"""Public names, and the module of each: as type checkers read them."""

__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562), so that ``import planner`` is light."""
    if name not in _HOME:
        raise AttributeError(f"module 'planner' has no attribute '{name}'")
    value: object = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
