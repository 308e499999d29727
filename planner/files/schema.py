"""Files of settings: tables of keys that are declared once, with kind, default and meaning."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from planner.exceptions import InvalidFile
from planner.files.kinds import Kind, Unfit, described
from planner.files.table import nearest
from planner.files.toml import Place, Toml


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key of a table.

    Attributes:
        name: What it is called.
        kind: What it may be set to.
        about: What it is for, in a sentence.
        default: Its value where the file does not set it; None is nothing.
        otherwise: In words, what holds without it, where ``default`` does not say.
        example: A value to show, where there is no default.
        set_to: The value that a template sets it to, where that is not the default.
        required: Whether a table must have it.
    """

    name: str
    kind: Kind
    about: str
    default: Any = None
    otherwise: str = ""
    example: Any = None
    set_to: Any = None
    required: bool = False


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of a file.

    Attributes:
        name: The keys that lead to it; none for what stands above all tables.
        about: What it is for.
        keys: Its keys.
        free: Kind of the values of keys with any name; None where there are none.
        example: A value to show for a key with any name.
        named: Whether it holds tables with any name, which in turn have ``keys``.
        repeated: Whether it may stand there several times.
        wanted: Whether a template has it, or only shows it in comments.
    """

    name: tuple[str, ...]
    about: str
    keys: tuple[Key, ...] = ()
    free: Kind | None = None
    example: Any = None
    named: bool = False
    repeated: bool = False
    wanted: bool = True


@dataclass(frozen=True)
class Settings:
    """What a file sets, and the defaults of what it does not.

    Attributes:
        file: The file.
        values: By name, such as ``plan.method``; of a table that repeats, a list of mappings; of
            one with free or named keys, a mapping.
        given: The names of keys and tables that the file has.
    """

    file: Toml
    values: Mapping[str, Any]
    given: frozenset[str]

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    def fault(self, name: str, problem: str) -> InvalidFile:
        """The error that something about a key is wrong."""
        place: list[str | int] = []
        for part, number in re.findall(r"([^.\[]+)|\[(\d+)\]", name):
            place.append(part or int(number))
        line = self.file.line_of(place)
        return InvalidFile(self.file.path, f"{name}: {problem}", line=line)


def understand(file: Toml, tables: Sequence[Table]) -> Settings:
    """Hold a file against the declared tables.

    Raises:
        InvalidFile: An unknown or missing key, or a value that is not of its kind.
    """
    reader = _Reader(file, tables)
    reader.read(tables[0], file.content)
    return Settings(file, reader.values, frozenset(reader.given))


def key_name(place: Place) -> str:
    """A place in words: ``plan.method``, ``export[0].file``."""
    name = ""
    for part in place:
        if isinstance(part, int):
            name += f"[{part}]"
        else:
            plain = re.fullmatch(r"[A-Za-z0-9_-]+", part)
            name += ("." if name else "") + (part if plain else json.dumps(part))
    return name


class _Reader:
    """Goes through the tables of a file, and keeps what it finds."""

    def __init__(self, file: Toml, tables: Sequence[Table]) -> None:
        self.file = file
        self.tables = tables
        self.values: dict[str, Any] = {}
        self.given: set[str] = set()
        for table in tables:
            if table.repeated or table.named or table.free is not None:
                self.values[key_name(table.name)] = () if table.repeated else {}
            else:
                self.values |= {
                    key_name((*table.name, key.name)): key.default for key in table.keys
                }

    def read(self, table: Table, content: Any) -> None:
        """A table and those inside it."""
        name = key_name(table.name)
        if name:
            self.given.add(name)
        if table.repeated:
            self._expect(table.name, content, list, f"tables [[{name}]]")
            places: list[Place] = [(*table.name, number) for number in range(len(content))]
            self.values[name] = tuple(
                self._keys(table, each, place) for each, place in zip(content, places, strict=True)
            )
            return
        self._expect(table.name, content, dict, f"a table [{name}]")
        if table.named:
            self.values[name] = {
                joint: self._keys(table, each, (*table.name, joint))
                for joint, each in content.items()
            }
            return
        inside = [t for t in self.tables if t.name and t.name[:-1] == table.name]
        children = {child.name[-1]: child for child in inside}
        own = {key: value for key, value in content.items() if key not in children}
        if table.free is not None:
            self.values[name] = {
                joint: self._value(table.free, value, (*table.name, joint))
                for joint, value in own.items()
            }
        else:
            found = self._keys(table, own, table.name, (*children,))
            self.values |= {key_name((*table.name, key)): value for key, value in found.items()}
            self.given |= {key_name((*table.name, key)) for key in own}
        for key, child in children.items():
            if key in content:
                self.read(child, content[key])

    def _keys(
        self, table: Table, content: Any, place: Place, others: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        self._expect(place, content, dict, "a table")
        known = {key.name: key for key in table.keys}
        values = {key.name: key.default for key in table.keys}
        for name, value in content.items():
            if name not in known:
                self._unknown(name, place, (*known, *others))
            values[name] = self._value(known[name].kind, value, (*place, name))
        for key in table.keys:
            if key.required and key.name not in content:
                self._fail((*place,), f"no key '{key.name}', expected {key.kind.expected}; add it")
        return values

    def _value(self, kind: Kind, value: Any, place: Place) -> Any:
        try:
            return kind.take(value)
        except Unfit as error:
            self._fail(place, f"got {described(value)}, expected {kind.expected}{error}")

    def _expect(self, place: Place, content: Any, of: type, words: str) -> None:
        if not isinstance(content, of):
            self._fail(place, f"got {described(content)}, expected {words}")

    def _unknown(self, name: str, place: Place, names: tuple[str, ...]) -> NoReturn:
        hint = nearest(name, names)
        elsewhere = [
            key_name((*table.name, key.name))
            for table in self.tables
            for key in table.keys
            if key.name == name
        ]
        if not hint and elsewhere:
            hint = f" (did you mean '{elsewhere[0]}'?)"
        of = f" of [{key_name(place)}]" if place else ""
        raise InvalidFile(
            self.file.path,
            f"unknown key '{key_name((*place, name))}'{hint}; keys{of}: {', '.join(names)}",
            line=self.file.line_of((*place, name)),
        )

    def _fail(self, place: Place, problem: str) -> NoReturn:
        line = self.file.line_of(place)
        raise InvalidFile(self.file.path, f"{key_name(place)}: {problem}", line=line)
