"""Declared settings as text: a template to begin with, and a page to look things up in."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from planner.run.schema import ANY, Declared, Settings, Table, key_name, tables

WIDTH = 100
"""Characters of a line."""

JOINT = "knee"
"""A joint, to show tables that are named after one."""


def template(cls: type[Settings], heading: Sequence[str]) -> str:
    """A file that sets every key to its default, or says so where it sets something else.

    What has no default, or would contradict the rest, stands there as a comment.

    Args:
        cls: What the file may set.
        heading: Lines of comment at the top.
    """
    return "\n".join([*(f"# {line}" for line in heading), *_lines(cls)]) + "\n"


def markdown(cls: type[Settings]) -> str:
    """A section and a table of keys for every table."""
    return "\n\n".join(_section(table) for table in tables(cls)) + "\n"


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


def _lines(cls: type[Settings]) -> Iterator[str]:
    for table in tables(cls):
        yield ""
        yield from _comment(table.about)
        if table.place:
            yield f"{'' if table.active else '# '}{_header(table).replace(ANY, JOINT)}"
        for name, key in table.keys.items():
            yield from _key_lines(name, key, active=table.active)
        if table.free:
            yield f"# {JOINT} = {toml_value(table.example)}"


def _key_lines(name: str, key: Declared, *, active: bool) -> Iterator[str]:
    about = key.about
    yield from _comment(about.help + _not_shown(key))
    value = _default(key) if about.set_to is None else about.set_to
    if active and value is not None:
        yield f"{name} = {toml_value(value)}"
    else:
        yield f"# {name} = {toml_value(about.example if value is None else value)}"


def _not_shown(key: Declared) -> str:
    """What the template does not show of a key: other values, and its default."""
    words, default = key.expected, _default_in_words(key)
    choices = f" {words.capitalize()}." if words.startswith("one of") else ""
    shown = _default(key) is not None and key.about.set_to is None
    return choices if shown or not default else f"{choices} Default: {default}."


def _default(key: Declared) -> Any:
    """The default of a key; None where it has none."""
    return None if key.required else key.default


def _default_in_words(key: Declared) -> str:
    default = _default(key)
    return key.about.otherwise or ("" if default is None else toml_value(default))


def _comment(text: str) -> Iterator[str]:
    return (f"# {line}" for line in textwrap.wrap(text, WIDTH - 2, break_on_hyphens=False))


def _header(table: Table) -> str:
    names = table.place[:-1] if table.repeated else table.place
    return f"[[{'.'.join(names)}]]" if table.repeated else f"[{'.'.join(names)}]"


def _section(table: Table) -> str:
    title = f"`{_header(table)}`" if table.place else "Above all tables"
    lines = [f"### {title}", "", _cell(table.about)]
    if table.keys:
        lines += ["", "| key | expected | default | what it is for |", "|---|---|---|---|"]
        lines += [
            f"| `{name}` | {_cell(key.expected)} | {_default_cell(key)} | {_cell(key.about.help)} |"
            for name, key in table.keys.items()
        ]
    if table.free:
        lines += ["", f"Any joint of the path, set to {table.free}."]
    return "\n".join(lines)


def _default_cell(key: Declared) -> str:
    if key.required:
        return "must be there"
    return _cell(_default_in_words(key)) or "–"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "\\<")
