"""Settings declared once: a class is a table of a file, a field a key, and often an option.

From a declaration, and its purpose in the docstring of the class, follow the check of a file with
its messages, the template, the reference and the options of commands (:mod:`planner.cli.options`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from inspect import get_annotations
from itertools import pairwise
from pathlib import Path, PurePosixPath
from textwrap import TextWrapper
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    Self,
    TypeVar,
)

from planner.cli.console import BadSetting, marked, speaking_of
from planner.exceptions import nearest
from planner.files.text import Expected, Kind, key_name, toml_value, within

if TYPE_CHECKING:
    from planner.files.text import Place, Toml

NUMBER = "NUMBER"  # part of the place of a table that may stand there several times


@dataclass(eq=False)
class Declared:
    """A key as declared; without a default it has to be set, unless it may be None or empty."""

    purpose: str = ""  # in a sentence
    _: KW_ONLY
    default: Any = ...
    otherwise: str = ""  # the effect of leaving it unset, in words, if the default does not show it
    example: Any = None  # a value, if there is no default
    set_to: Any = None  # its value in a template, if that is not the default
    option: str = ""  # its option, such as "--cyclic/--no-cyclic"; "--" for one named like it
    form: str = ""  # the text of the option in its help, where it does not follow from the type
    by_joint: str = ""  # the key of its table that takes the option's values for single joints
    only: tuple[str, ...] = ()  # the methods, or formats, on which it has an effect; () for all

    kind: Kind = field(init=False)
    help: str = field(init=False)  # the same after the methods, or formats, of ``only``
    default_in_words: str = field(init=False)  # as TOML, or the effect of leaving it unset

    def bind(self, name: str, annotation: Any, purpose: str = "") -> Declared:
        """Take the name, the type and the purpose of the field or parameter."""
        self.kind, self.purpose = Kind(annotation), self.purpose or purpose
        self.help = self.purpose
        if self.only:
            choices = " or ".join(", ".join(self.only).rsplit(", ", 1))
            self.help = f"With {choices}: {self.purpose[:1].lower()}{self.purpose[1:]}"
        if self.option == "--":
            self.option += name.replace("_", "-")
        if self.default is ...:
            empty: dict[Any, Any] = {dict: {}, bool: False}
            if self.kind.count is None:
                empty[tuple] = ()
            key = self.kind.origin or self.kind.type
            self.default = None if self.kind.optional else empty.get(key, ...)
        unset = self.default is None or self.default is ...
        self.default_in_words = self.otherwise or ("" if unset else toml_value(self.default))
        return self


setting: Any = Declared
"""Declare a key of a table."""

argument: Any = Declared
"""Declare a positional argument of a command."""

option: Any = partial(setting, option="--")
"""Declare a key that is also an option of the same name, or an option of a command."""


class Settings:
    """A table of a file: its docstring and fields are the table's description and keys."""

    keys: ClassVar[dict[str, Declared]] = {}
    """The keys of the table, tables among them, as they are declared."""

    keys_set: frozenset[str]
    """The keys that a file or the command line has set."""

    source: Toml
    """The file that has them, of settings that :func:`understand` has read."""

    folder = ""
    """The folder from which files are named; "" for that of the process."""

    about = ""
    """The purpose of the table."""

    def __init_subclass__(cls) -> None:
        about, _, attributes = (cls.__doc__ or "").partition("Attributes:\n")
        cls.about, own = " ".join(about.split()), dict[str, Declared]()
        found = re.findall(r"^ {8}(\w+): (.*(?:\n {12}.*)*)", attributes, re.MULTILINE)
        purposes = {name: " ".join(words.split()) for name, words in found}
        for name, annotation in get_annotations(cls).items():
            value = vars(cls)[name]
            declared = value if isinstance(value, Declared) else Declared(default=value)
            own[name] = declared.bind(name, annotation, purposes.get(name, ""))
        cls.keys = {**cls.keys, **own}

    def __init__(self, **values: Any) -> None:
        """Settings of these values, which are not checked, and defaults."""
        vars(self).update({name: copy(key.default) for name, key in self.keys.items()} | values)
        self.keys_set = frozenset(values)

    def place(self, name: str) -> str:
        """The path of a file that the settings name."""
        return str(Path(self.folder) / name) if self.folder else name

    def check_effect(self, table: str, chooser: str) -> None:
        """Refuse keys of this ``table`` without effect on what its key ``chooser`` is set to."""
        choice = getattr(self, chooser)
        for name, key in self.keys.items():
            is_set = name in self.keys_set and getattr(self, name) is not False
            if is_set and key.only and choice not in key.only:
                words = f"{marked(f'{table}.{chooser}', choice)}, only with {', '.join(key.only)}"
                raise BadSetting(f"‹{table}.{name}› has no effect with {words}")

    def values(self) -> dict[str, Any]:
        """The value of every key, with mappings in place of tables."""
        return {name: _plain(getattr(self, name)) for name in self.keys}

    @classmethod
    def of(cls, content: Any, place: Place = (), *, standard_input: bool = False) -> Self:
        """Settings from values by key and table, or BadSetting.

        ``-`` may name a file to read where there is ``standard_input``.
        """
        of = f" of [{key_name(place)}]" if place else ""
        if not isinstance(content, Mapping):
            raise _unfit(place, content, f"a table [{key_name(place)}]")
        for name in content:
            if name not in cls.keys:
                words = f"'{nearest(str(name), list(cls.keys))}; keys{of}: {', '.join(cls.keys)}"
                raise BadSetting(f"unknown key '{marked((*place, name))}{words}")
        for name, key in cls.keys.items():
            if key.default is ... and name not in content:
                words = f"no key '{name}', expected {key.kind.expected}; add it"
                raise BadSetting(f"{marked(place)}: {words}")

        def checked(kind: Kind, value: Any, place: Place) -> Any:
            if kind.is_table:
                table: type[Settings] = kind.type
                return table.of(value, place, standard_input=standard_input)
            if kind.is_repeated:
                if not isinstance(value, list):
                    raise _unfit(place, value, f"tables [[{key_name(place)}]]")
                inner = kind.inner[0]
                return tuple(checked(inner, each, (*place, k)) for k, each in enumerate(value))
            if kind.is_free:
                if not isinstance(value, Mapping):
                    raise _unfit(place, value, f"a table [{key_name(place)}]")
                return {k: checked(kind.inner[1], v, (*place, k)) for k, v in value.items()}
            try:
                result = kind.fitted(value)
            except (ValueError, OverflowError) as error:
                own = isinstance(error, ValueError) and str(error)
                hint = own or nearest(str(value), kind.choices)
                raise _unfit(place, value, kind.expected, hint) from error
            if result == "-" and SOURCE in kind.notes and not standard_input:
                hint = "; a run reads no standard input, so write it to a file first"
                raise _unfit(place, value, kind.expected, hint)
            return result

        names = [name for name in cls.keys if name in content]
        return cls(**{n: checked(cls.keys[n].kind, content[n], (*place, n)) for n in names})


AnySettings = TypeVar("AnySettings", bound=Settings)


def understand(file: Toml, cls: type[AnySettings]) -> AnySettings:
    """Check a file against the declared tables."""
    with speaking_of(file):
        settings = cls.of(file.content)
    settings.source, settings.folder = file, str(Path(file.path).parent)
    return settings


def flat(settings: Settings, place: Place = ()) -> dict[str, tuple[Any, bool]]:
    """Every key that has a name of its own, such as ``plan.method``: value, and whether it is set.

    The keys of a table that is missing are None, and those that are not set of a few methods only.
    """
    names = dict[str, tuple[Any, bool]]()
    for name, key in settings.keys.items():
        value, at = getattr(settings, name), (*place, name)
        if isinstance(value, Settings):
            names |= flat(value, at)
        elif key.kind.is_table:
            names |= dict.fromkeys(flat(key.kind.type(), at), (None, False))
        else:
            is_set = name in settings.keys_set
            names[key_name(at)] = _plain(value) if is_set or not key.only else None, is_set
    return names


def _plain(value: Any) -> Any:
    """A value with mappings in place of tables."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    return value.values() if isinstance(value, Settings) else value


def _unfit(place: Place, value: Any, expected: str, hint: str = "") -> BadSetting:
    """The error that a value is not the expected one."""
    from planner.arrays import shown  # imports NumPy

    got = toml_value(value) if isinstance(value, bool) else shown(value)
    got = "a table" if isinstance(value, Mapping) else got
    return BadSetting(f"{marked(place)}: got {got}, expected {expected}{hint}")


class Table(NamedTuple):
    """A table of a file."""

    place: tuple[str, ...]  # the keys that lead to it, NUMBER for any number; () for the file's top
    about: str  # its purpose
    keys: Mapping[str, Declared]  # its keys
    free: Declared | None = None  # declares keys of any name, if there are such keys

    @property
    def header(self) -> str:
        """Its header in a file."""
        *above, last = self.place
        return f"[[{'.'.join(above)}]]" if last == NUMBER else f"[{'.'.join(self.place)}]"


def tables(cls: type[Settings], place: tuple[str, ...] = ()) -> Iterator[Table]:
    """The table that a class describes and its inner tables, in the order of the fields."""
    keys, inner = {}, list[Table]()
    for name, key in cls.keys.items():
        kind, at = key.kind, (*place, name)
        if kind.is_table:
            inner += tables(kind.type, at)
        elif kind.is_repeated:
            inner += tables(kind.inner[0].type, (*at, NUMBER))
        elif kind.is_free:
            inner.append(Table(at, key.help, {}, free=key))
        else:
            keys[name] = key
    yield Table(place, cls.about, keys)
    yield from inner


def template(cls: type[Settings], heading: Sequence[str]) -> str:
    """A file that sets every key to its default, or to another value with the default in a comment.

    Keys without a default, or that would contradict the rest, are comments.
    """
    comment = TextWrapper(100, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)
    lines = [f"# {line}" for line in heading]
    for table in tables(cls):
        lines += ["", *comment.wrap(table.about)]
        if table.place:
            lines.append(f"{'# ' if table.free else ''}{table.header}")
        for name, key in table.keys.items():
            value = key.default if key.set_to is None else key.set_to
            is_set = value not in (None, ...) and not key.only
            words, expected = key.help, key.kind.expected
            words += f" {expected.capitalize()}." if expected.startswith("one of") else ""
            if key.default_in_words and not (is_set and key.set_to is None):
                words += f" Default: {key.default_in_words}."
            example = toml_value(value if is_set or key.example is None else key.example)
            lines += [*comment.wrap(words), f"{'' if is_set else '# '}{name} = {example}"]
        if table.free:
            lines.append(f"# knee = {toml_value(table.free.example)}")
    return "\n".join(lines) + "\n"


def _is_text(value: str) -> str:
    if not value.strip() or not value.isprintable():
        raise ValueError
    return value


def _stays_inside(value: str) -> str:
    path = PurePosixPath(value)
    if path.is_absolute() or ".." in path.parts or "\\" in value or str(path) in (".", "-"):
        raise ValueError("; all that a run writes stays inside that folder")
    return str(path)


def _rises(value: tuple[float, ...]) -> tuple[float, ...]:
    if not value or any(high <= low for low, high in pairwise(value)):
        raise ValueError
    return value


SOURCE = Expected("the name of a file")
INSIDE = "the name of a file inside the folder of the results"

Text = Annotated[str, Expected("a text", _is_text)]  # not empty, and on one line
Source = Annotated[Text, SOURCE]  # to read; its place is relative to the file that names it
Written = Annotated[Text, Expected(INSIDE, _stays_inside)]
WrittenOrNone = Annotated[
    str, Expected(f'{INSIDE}, or "" for none', lambda each: each and _stays_inside(_is_text(each)))
]
Span = Annotated[
    tuple[float, float], Expected("two numbers [LOW, HIGH] with LOW below HIGH", _rises)
]
Values = Annotated[tuple[float, ...], Expected("a list of rising numbers", _rises)]
Positive = Annotated[float, within(gt=0.0)]
NotNegative = Annotated[float, within(ge=0.0)]
Count = Annotated[int, within(ge=1, le=10**6)]
