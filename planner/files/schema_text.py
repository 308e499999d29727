"""Declared settings as text: a template to begin with, and a page to look things up in."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from planner.files.schema import Key, Table, key_name

WIDTH = 100
"""Characters of a line."""

JOINT = "knee"
"""A joint, to show tables that are named after one."""


def template(tables: Sequence[Table], heading: Sequence[str]) -> str:
    """A file that sets every key to its default, or says so where it sets something else.

    What has no default, or would contradict the rest, stands there as a comment.

    Args:
        tables: The tables.
        heading: Lines of comment at the top.
    """
    return "\n".join([*(f"# {line}" for line in heading), *_lines(tables)]) + "\n"


def markdown(tables: Sequence[Table]) -> str:
    """A section and a table of keys for every table."""
    return "\n\n".join(_section(table) for table in tables) + "\n"


def toml_value(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{key_name((key,))} = {toml_value(each)}" for key, each in value.items())
        return f"{{{pairs}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_value(each) for each in value)}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def _lines(tables: Sequence[Table]) -> Iterator[str]:
    for table in tables:
        yield ""
        if table.about:
            yield from _comment(table.about)
        if table.name:
            yield _mark(table) + _header(table)
        for key in table.keys:
            yield from _key_lines(key, wanted=table.wanted)
        if table.free is not None:
            yield f"# {JOINT} = {toml_value(table.example)}"


def _key_lines(key: Key, *, wanted: bool) -> Iterator[str]:
    yield from _comment(key.about + _said(key))
    value = key.default if key.set_to is None else key.set_to
    if wanted and value is not None:
        yield f"{key.name} = {toml_value(value)}"
    else:
        yield f"# {key.name} = {toml_value(key.example if value is None else value)}"


def _said(key: Key) -> str:
    """What the template does not show of a key: other values, and its default."""
    said = f" {key.kind.expected.capitalize()}." if key.kind.expected.startswith("one of") else ""
    default = _default(key)
    shown = key.default is not None and key.set_to is None
    return said if shown or not default else f"{said} Default: {default}."


def _default(key: Key) -> str:
    return key.otherwise or ("" if key.default is None else toml_value(key.default))


def _comment(text: str) -> Iterator[str]:
    return (f"# {line}" for line in textwrap.wrap(text, WIDTH - 2, break_on_hyphens=False))


def _mark(table: Table) -> str:
    return "" if table.wanted else "# "


def _header(table: Table) -> str:
    name = ".".join(table.name)
    if table.repeated:
        return f"[[{name}]]"
    return f"[{name}.{JOINT}]" if table.named else f"[{name}]"


def _section(table: Table) -> str:
    name = ".".join(table.name)
    if table.named:
        name += ".NAME"
    brackets = ("[[", "]]") if table.repeated else ("[", "]")
    title = f"`{brackets[0]}{name}{brackets[1]}`" if name else "Above all tables"
    lines = [f"### {title}"]
    if table.about:
        lines += ["", table.about]
    if table.keys:
        lines += ["", "| key | expected | default | what it is for |", "|---|---|---|---|"]
        lines += [
            f"| `{key.name}` | {_cell(key.kind.expected)} | {_default_cell(key)} | "
            f"{_cell(key.about)} |"
            for key in table.keys
        ]
    if table.free is not None:
        lines += ["", f"Any joint of the path, set to {table.free.expected}."]
    return "\n".join(lines)


def _default_cell(key: Key) -> str:
    if key.required:
        return "must be there"
    default = _default(key)
    return _cell(default) if default else "–"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "\\<")
