"""Files of settings: classes whose fields hold kind, range, default and meaning of each key."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from functools import cache
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from planner.exceptions import InvalidFile, nearest
from planner.run.kinds import Expected, Range

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, TypeAdapter
    from pydantic_core import CoreSchema, ErrorDetails

    from planner.files.toml import Place, Toml

LONGEST = 60
"""Characters of a value that a message repeats."""


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(field,))
class Settings:
    """A table of a file: its docstring and fields are the table's description and keys.

    Subclasses are frozen dataclasses. Pydantic holds values against their annotations when a file
    is read, and only then: its import alone takes longer than all else that ``--help`` does.
    """

    keys: ClassVar[dict[str, Declared]] = {}
    """The keys of the table, tables among them, as they are declared."""

    keys_set: frozenset[str] = frozenset()
    """The keys that a file or the command line has set."""

    def __init_subclass__(cls) -> None:
        """Make a dataclass of the annotations, and keep what they declare."""
        dataclass(frozen=True, kw_only=True)(cls)
        cls.keys = _declared(cls)

    def values(self) -> dict[str, Any]:
        """The value of every key, with mappings in place of tables."""
        return asdict(self)  # type: ignore[call-overload, no-any-return]  # every subclass is a dataclass

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """A mapping of the keys and no others, then settings made of it."""
        from pydantic_core import core_schema

        keys = {
            name: core_schema.typed_dict_field(
                handler.generate_schema(key.annotation), required=key.required
            )
            for name, key in cls.keys.items()
        }
        config = core_schema.CoreConfig(strict=True, allow_inf_nan=False)
        table = core_schema.typed_dict_schema(keys, extra_behavior="forbid", config=config)
        return core_schema.no_info_after_validator_function(cls._set_to, table)

    @classmethod
    def _set_to(cls, values: Mapping[str, Any]) -> Settings:
        settings = cls(**values)
        object.__setattr__(settings, "keys_set", frozenset(values))
        return settings


Understood = TypeVar("Understood", bound=Settings)


@dataclass(frozen=True, kw_only=True)
class About:
    """What is said of a key, beside its type and its default.

    Attributes:
        help: What it is for, in a sentence.
        otherwise: What holds where it is not set, in words, where the default does not say.
        example: A value to show, where there is no default.
        set_to: The value that a template sets it to, where that is not the default.
    """

    help: str = ""
    otherwise: str = ""
    example: Any = None
    set_to: Any = None


@dataclass(frozen=True)
class Declared:
    """A key as it is declared.

    Attributes:
        annotation: Its annotation, whole.
        default: Its default; MISSING where it has to be set.
        type: Its type without None and annotations, such as float, or a Literal of its choices.
        about: What is said of it.
        expected: What a value should be, in words.
        free: Whether it is a table of values by any name, such as ``limits.joints``.
    """

    annotation: Any
    default: Any
    type: Any
    about: About
    expected: str
    free: bool

    @property
    def required(self) -> bool:
        """Whether a file has to set it."""
        return self.default is MISSING


ANY = "NAME"
"""Stands for any name, or any number, in the place of a table."""


@dataclass(frozen=True)
class Table:
    """A table of a file.

    Attributes:
        place: The keys that lead to it, NAME where it may be any; none for the top of the file.
        about: What it is for.
        keys: Its keys.
        repeated: Whether it may stand there several times.
        free: What values of keys with any name should be, in words; "" where there are none.
        example: A value to show for a key with any name.
        active: Whether a template has it, or only shows it in comments.
    """

    place: tuple[str, ...]
    about: str
    keys: Mapping[str, Declared]
    repeated: bool = False
    free: str = ""
    example: Any = None
    active: bool = True


class Unfit(ValueError):
    """Content that no settings can be made of.

    Attributes:
        place: Where something is wrong.
        named: Whether the message has to name that place.
        problem: What is wrong.
    """

    def __init__(self, place: Place, problem: str, *, named: bool = True) -> None:
        """Keep what is wrong for those who know how the user writes a place."""
        self.place = place
        self.named = named
        self.problem = problem
        super().__init__(problem)


def understand(file: Toml, cls: type[Understood]) -> Understood:
    """Hold a file against the declared tables.

    Raises:
        InvalidFile: An unknown or missing key, or a value that is not of its kind.
    """
    try:
        return settings_of(file.content, cls)
    except Unfit as error:
        place = f"{key_name(error.place)}: " if error.named else ""
        line = file.line_of(error.place)
        raise InvalidFile(file.path, f"{place}{error.problem}", line=line) from error


def settings_of(
    content: Mapping[str, Any], cls: type[Understood], *, standard_input: bool = False
) -> Understood:
    """Settings from what a file or a command line sets.

    Args:
        content: Values by key and table.
        cls: What may be set.
        standard_input: Whether ``-`` may stand for a file to read.

    Raises:
        Unfit: An unknown or missing key, or a value that is not of its kind.
    """
    from pydantic import ValidationError  # too slow for --help

    try:
        declared: Any = cls
        settings: Understood = _validator(declared).validate_python(content, context=standard_input)
        return settings
    except ValidationError as error:
        raise _worst(cls, error.errors(include_url=False), content) from error


def tables(cls: type[Settings], place: tuple[str, ...] = ()) -> Iterator[Table]:
    """The table that a class describes and those inside it, in the order of the fields."""
    yield _table(cls, place)
    for name, key in cls.keys.items():
        inner = get_args(key.type)
        if _is_table(key.type):
            first, *others = tables(key.type, (*place, name))
            yield replace(first, active=key.default is not None or key.about.set_to is not None)
            yield from others
        elif get_origin(key.type) is tuple and _is_table(inner[0]):
            yield _table(inner[0], (*place, name, ANY), repeated=True)
        elif get_origin(key.type) is dict and _is_table(inner[1]):
            yield _table(inner[1], (*place, name, ANY), active=False)
        elif key.free:
            free = _expected(*_unwrapped(inner[1]))
            yield Table(
                (*place, name),
                key.about.help,
                {},
                free=free,
                example=key.about.example,
                active=False,
            )


def flat(settings: Settings) -> dict[str, Any]:
    """Every key that has a name of its own, such as ``plan.method``, with its value."""
    return dict(_flat(type(settings), settings, ()))


def key_name(place: Sequence[str | int]) -> str:
    """A place in words: ``plan.method``, ``export[0].file``."""
    name = ""
    for part in place:
        if isinstance(part, int):
            name += f"[{part}]"
        else:
            plain = re.fullmatch(r"[A-Za-z0-9_-]+", part)
            name += ("." if name else "") + (part if plain else json.dumps(part))
    return name


def _flat(
    cls: type[Settings], settings: Settings | None, place: tuple[str, ...]
) -> Iterator[tuple[str, Any]]:
    """The keys of a table, with their defaults where it is not there."""
    keys = cls.keys
    complete = not any(key.required for key in keys.values())
    for name, key in keys.items():
        value = key.default if complete else None
        value = value if settings is None else getattr(settings, name)
        if _is_table(key.type):
            yield from _flat(key.type, value, (*place, name))
        else:
            yield key_name((*place, name)), _plain(value)


def _plain(value: Any) -> Any:
    """A value with mappings in place of tables."""
    if isinstance(value, Settings):
        return value.values()
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return tuple(_plain(each) for each in value) if isinstance(value, tuple) else value


def _declared(cls: type[Settings]) -> dict[str, Declared]:
    annotations = get_type_hints(cls, include_extras=True)
    keys = {}
    for each in fields(cls):  # type: ignore[arg-type]  # every subclass is a dataclass
        annotation = annotations[each.name]
        default = each.default if each.default_factory is MISSING else each.default_factory()
        base, notes = _unwrapped(annotation)
        about = next((note for note in notes if isinstance(note, About)), About())
        in_words = any(isinstance(note, Expected) for note in notes)
        free = get_origin(base) is dict and not in_words
        expected = _expected(base, notes)
        keys[each.name] = Declared(annotation, default, base, about, expected, free)
    return keys


def _unwrapped(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    """The type that is annotated, without None, and all that it is annotated with."""
    notes: tuple[Any, ...] = ()
    while True:
        if get_origin(annotation) is Annotated:
            annotation, *more = get_args(annotation)
            notes = (*more, *notes)
        elif get_origin(annotation) in (Union, UnionType):
            (annotation,) = (each for each in get_args(annotation) if each is not NoneType)
        else:
            return annotation, notes


def _expected(base: Any, notes: Sequence[Any]) -> str:
    """What a value should be, in words, from its type and what that is annotated with."""
    words = [note.words for note in notes if isinstance(note, Expected)]
    if words:
        return words[-1]
    if get_origin(base) is Literal:
        return f"one of {', '.join(get_args(base))}"
    if base is bool:
        return "true or false"
    ends = next((note for note in notes if isinstance(note, Range)), Range())
    if base is int:
        return f"a whole number from {ends.ge} to {ends.le}"
    texts = {"above": ends.gt, "of at least": ends.ge, "below": ends.lt}
    found = [f"{text} {end:g}" for text, end in texts.items() if end is not None]
    return " ".join(["a number", " and ".join(found)]).strip()


def _is_table(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Settings)


def _is_key(key: Declared) -> bool:
    return not (key.free or any(_is_table(each) for each in (key.type, *get_args(key.type))))


def _table(cls: type[Settings], place: tuple[str, ...], **more: Any) -> Table:
    keys = {name: key for name, key in cls.keys.items() if _is_key(key)}
    return Table(place, " ".join((cls.__doc__ or "").split()), keys, **more)


@cache
def _validator(cls: Any) -> TypeAdapter[Any]:
    from pydantic import TypeAdapter

    return TypeAdapter(cls)


def _expectations(cls: type[Settings]) -> dict[tuple[str, ...], str]:
    """What is expected at every place of a file."""
    found = {}
    for table in tables(cls):
        place = table.place
        if place and place[-1] == ANY:
            name = key_name(place[:-1])
            found[place[:-1]] = f"tables [[{name}]]" if table.repeated else f"a table [{name}]"
        name = "" if ANY in place else f" [{key_name(place)}]"
        found[place] = f"a table{name}"
        found |= {(*place, name): key.expected for name, key in table.keys.items()}
        if table.free:
            found[*place, ANY] = table.free
    return found


def _worst(cls: type[Settings], faults: Sequence[ErrorDetails], content: Any) -> Unfit:
    """What is wrong first of all: an unknown key, as it may stand for one that is missing."""
    unknown = [fault["loc"] for fault in faults if fault["type"] == "extra_forbidden"]
    if unknown:
        return Unfit(unknown[0], _unknown(cls, unknown[0]), named=False)
    fault, expectations = faults[0], _expectations(cls)
    place = fault["loc"]
    pattern = max((each for each in expectations if _matches(each, place)), key=len)
    words = expectations[pattern]
    if fault["type"] == "missing":
        others = [each["loc"] for each in faults if each["type"] == "missing"]
        names = [str(each[-1]) for each in others if each[:-1] == place[:-1]]
        keys = f"no key '{names[0]}', expected {words}; add it"
        if len(names) > 1:
            keys = f"no keys {', '.join(names)}; add them"
        return Unfit(place[:-1], keys)
    place = place[: len(pattern)]
    for part in place:
        content = content[part]
    hint = _hint(fault, content, words)
    return Unfit(place, f"got {_described(content)}, expected {words}{hint}")


def _matches(pattern: tuple[str, ...], place: Place) -> bool:
    """Whether a place begins as a pattern says."""
    pairs = zip(pattern, place, strict=False)
    return len(pattern) <= len(place) and all(part in (ANY, own) for part, own in pairs)


def _hint(fault: ErrorDetails, value: Any, words: str) -> str:
    """What may help with a value that does not fit."""
    if fault["type"] == "value_error":
        return str(fault["ctx"]["error"])
    if not isinstance(value, str):
        return ""
    if words.startswith("one of "):
        return nearest(value, words.removeprefix("one of ").split(", "))
    try:
        number = "number" in words and math.isfinite(float(value))
    except ValueError:
        number = False
    truth = words == "true or false" and value.lower() in ("true", "false")
    return "; without quotes" if number or truth else ""


def _unknown(cls: type[Settings], place: Place) -> str:
    """What is said of a key that no table has at this place."""
    name = str(place[-1])
    names = [
        key[-1]
        for key in _expectations(cls)
        if len(key) == len(place) and _matches(key[:-1], place[:-1])
    ]
    hint = nearest(name, names)
    elsewhere = [(*table.place, name) for table in tables(cls) if name in table.keys]
    if not hint and elsewhere:
        hint = f" (did you mean '{key_name(elsewhere[0])}'?)"
    of = f" of [{key_name(place[:-1])}]" if place[:-1] else ""
    return f"unknown key '{key_name(place)}'{hint}; keys{of}: {', '.join(names)}"


def _described(value: Any) -> str:
    """A value as a message repeats it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, int) and abs(value) >= 10**LONGEST:
        return "a very large number"
    shown = repr(value) if isinstance(value, str | int | float | list) else str(value)
    return shown if len(shown) <= LONGEST else f"{shown[: LONGEST - 1]}…"
