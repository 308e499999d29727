"""Options and arguments of commands: settings and others, made of their declarations.

A file or a folder that is to be written is checked here, before anything is computed; so is that no
output overwrites an input.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import click
from click.shell_completion import CompletionItem

from planner.cli.console import MARKED, Answer, BadSetting, marked, warn
from planner.cli.declared import NUMBER, SOURCE, Count, Declared, Source, option, tables
from planner.cli.settings import ReplayRun, Run
from planner.files.staging import cannot_write, check_folder, check_writable
from planner.files.text import Kind, place_of

if TYPE_CHECKING:
    from planner.files.logs.rows import LogOptions


class Parsed(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.5 on
    """A value that a function parses; of other texts it returns None or raises ValueError.

    Its ``form``, such as JOINT=DEG, is shown in help, the ``expected`` text in messages.
    """

    def __init__(
        self, parse: Callable[[str], Any], form: str, expected: str, choices: Sequence[str] = ()
    ) -> None:
        self.parse, self.name, self.expected, self.choices = parse, form, expected, choices

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value of a text."""
        with suppress(ValueError, OverflowError):
            if (parsed := self.parse(value)) is not None:
                return parsed
        option = "" if param is None else f"{param.opts[0]}: "
        raise click.UsageError(f"{option}got '{value}', expected {self.expected}.", ctx)

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[CompletionItem]:  # noqa: ARG002
        """The choices that begin like this, or files if none does."""
        names = [CompletionItem(name) for name in self.choices if name.startswith(incomplete)]
        return names or [CompletionItem(incomplete, type="file")] * bool(self.choices)


def of_kind(annotation: Any, form: str, like: str = "") -> Parsed:
    """A value as of settings with this annotation, in a text of a form, for example ``like`` this.

    NAME=VALUE are a pair, as are [NAME=]VALUE, where the name may be "" for all; of a tuple the
    numbers have ":" between them, texts ",".
    """
    kind = annotation if isinstance(annotation, Kind) else Kind(annotation)

    def parse(text: str) -> Any:
        named = "=" in form
        name, equals, text = text.rpartition("=") if named else ("", "", text)
        if named and not name and (equals or not form.startswith("[")):
            raise ValueError
        if kind.origin is tuple:
            parts = text.split(":" if ":" in form else ",")
            value = kind.fitted([kind.inner[0].type(part.strip()) for part in parts])
        else:
            value = kind.fitted(kind.type(text))
        return (name, value) if named else value

    expected = f"{form} such as {like}, {kind.expected}" if like else kind.expected
    if kind.origin is tuple:
        expected = f"{form} in degrees with LOW below HIGH, such as {like}"
        expected = expected if like else f"{kind.expected}, such as {form}"
    return Parsed(parse, form, expected)


USES = f"{__name__}.uses"  # key of the uses of places, by parameter, in the command's context


class Place(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.5 on
    """The name of a file or a folder, which a shell completes; one to write is checked at once.

    A written place must not have another use in the same command; a ``use`` of None is of a file
    that may be both input and output.
    """

    def __init__(
        self,
        name: Literal["file", "dir"],
        use: Literal["read", "written"] | None,
        check: Callable[[str], None] = lambda _: None,
        expected: str = "the name of a file",
    ) -> None:
        self.name, self.use, self.check, self.expected = name, use, check, expected

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The same text, where it passes the check, and has no other use."""
        text = name = str(value)
        if self.use == "written" and text != "-" and text.startswith("-") and param is not None:
            message = f"{param.opts[0]}: got '{text}', expected a file, ./{text} for one so called."
            raise click.UsageError(message, ctx)
        if self.use == "read" and not text and param is not None and ctx is not None:
            where = param.opts[0] if param.param_type_name == "option" else param.make_metavar(ctx)
            raise click.UsageError(f"{where}: got '', expected {self.expected}.", ctx)
        self.check(value)
        place = Path(os.path.realpath(text))  # of a link to itself, too
        if text == "-" and self.use == "written":
            place, name = Path(text), "standard output"
        elif text == "-" or (place.exists() and not (place.is_file() or place.is_dir())):
            return text  # standard input, or a device
        if self.use is not None and param is not None and ctx is not None:
            uses = ctx.meta.setdefault(USES, {}).setdefault(place, {})
            uses[param.name] = self.use
            if len(uses) > 1 and "written" in uses.values():
                other = "an input" if "read" in uses.values() else "another output"
                raise cannot_write(name, ValueError(f"it is {other} too"))
        return text

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[CompletionItem]:  # noqa: ARG002
        """Leave it to the shell, which lists files and folders."""
        return [CompletionItem(incomplete, type=self.name)]


OUTPUT = Place("file", "written", check_writable)

PARAMETER = of_kind(float, "NAME=VALUE", "length=0.04")

Output = Annotated[str, OUTPUT]
Folder = Annotated[str, Place("dir", "written", check_folder)]


def _option(name: str, declared: Declared, about: str = "") -> click.Parameter:
    """What is declared as an option, or argument, of click, with a help of its own if there is one.

    By default its form is N or the unit that ends its name, LOW:HIGH, or NAME=VALUE for joints.
    """
    kind, text = declared.kind, about or declared.help
    more: dict[str, Any] = {"required": declared.default is ...}
    several = kind.origin is tuple and kind.count is None and "," not in declared.form
    more["multiple"] = several or kind.origin is dict or bool(declared.by_joint)
    each = kind.inner[1] if kind.origin is dict else kind.inner[0] if several else kind
    joint, unit = "", name.rpartition("_")[2]
    if kind.origin is dict or declared.by_joint:
        joint, unit = "JOINT=" if kind.origin is dict else "[JOINT=]", "deg"
    form = unit.upper() if unit in ("hz", "s", "ms", "deg", "cm") else "FLOAT"
    if each.type is str:
        form = "NAME" if several or joint else "TEXT"
    elif each.origin is tuple or each.type is int:
        form = "LOW:HIGH" if each.origin is tuple else "N"
    form = declared.form or joint + form
    if kind.parser is not None:
        click_type = kind.parser
        if isinstance(declared.default, str):  # which is checked like any other
            more |= {"default": declared.default, "show_default": False}
    elif SOURCE in each.notes:
        click_type = Place("file", "read", expected=each.expected)
    elif each.origin is Literal:
        click_type = click.Choice(each.inner)
    elif kind.type is bool:
        click_type, more["default"] = bool, None
        more["is_flag"] = "/" not in declared.option or None
    elif each.type is str and not joint:
        click_type = Parsed(str, form, "", each.choices)
    elif " " in form:
        click_type, more["nargs"] = of_kind(kind.inner[0], form), kind.count
    else:
        like = _like(joint, declared.example) if joint or ":" in form else ""
        click_type = of_kind(each, form, like)
    if declared.form:
        more["metavar"] = form
    if not declared.option:
        own: dict[str, Any] = {"nargs": -1 if several else 1, "metavar": more.get("metavar")}
        return click.Argument([name], type=click_type, required=not kind.optional, **own)
    if kind.type is str and kind.choices and not about:
        text += f" {kind.expected.capitalize()}."
    if more["multiple"] and not (declared.by_joint or about or "epeat" in text):
        text += " Repeat the option for several."
    default = declared.default_in_words.strip('"[]{}')
    default = default.replace(".0,", "").removesuffix(".0") if "nargs" in more else default
    if default and "  [" not in text and (kind.type is not bool or "/" in declared.option):
        text += f"  [default: {default}]"
    return click.Option([*declared.option.split(), name], help=text, type=click_type, **more)


def _like(joint: str, example: Any) -> str:
    """An example as the text of an option, of a ``joint`` or of a span."""
    name, value = next(iter(example.items())) if isinstance(example, dict) else ("knee", example)
    values = value if isinstance(value, list) else [value]
    text = ":".join(each if isinstance(each, str) else f"{each:g}" for each in values)
    return f"{name}={text}" if joint else text


class Group(NamedTuple):
    """A parameter of a command that is made of several options: these, and its value by theirs."""

    options: list[click.Parameter]
    value: Callable[[dict[str, Any]], Any]  # takes its options out of all by name


def group(make: Callable[..., Any] = dict, /, **options: tuple[Any, Declared]) -> Any:
    """Options by name, with type and declaration; together what ``make`` makes of their values."""
    groups = {name: _single(name, *each) for name, each in options.items()}
    return Group(
        [each.options[0] for each in groups.values()],
        lambda values: make(**{name: each.value(values) for name, each in groups.items()}),
    )


def _single(name: str, annotation: Any, declared: Declared) -> Group:
    """The only option, or argument, of a parameter."""
    declared.bind(name, annotation)

    def value(values: dict[str, Any]) -> Any:
        own = values.pop(name)
        return declared.default if own in (None, ()) else own

    return Group([_option(name, declared)], value)


output: Any = _single(
    "output",
    Output,
    option("Where to write the CSV; '-' is standard output.", option="-o --output", default="-"),
)
output_or_folder: Any = _single(
    "output",
    Annotated[str, Place("file", "written")],  # checked once the format is known
    option(
        "The file, or folder, to write; '-' is standard output.",
        option="-o --output",
        default="-",
        form="OUT",
    ),
)


def command(
    page: str = "", *, answers: bool = True
) -> Callable[[Callable[..., Answer | None]], click.Command]:
    """Make a function a command, by its parameters: the default of each declares its options.

    With ``answers`` what it returns is written and printed, with ``--json`` for machines, and with
    the help of a ``page`` there is ``--report``, which writes it.
    """

    def decorate(function: Callable[..., Answer | None]) -> click.Command:
        groups = dict[str, Group]()
        for name, each in signature(function, eval_str=True).parameters.items():
            is_group = isinstance(each.default, Group)
            groups[name] = (
                each.default if is_group else _single(name, each.annotation, each.default)
            )

        def run(*, as_json: bool = False, report: str | None = None, **values: Any) -> None:
            printed = click.get_current_context().meta.get(USES, {}).get(Path("-"), {})
            for name in printed.keys() - {"output"} if as_json else ():
                place = f"--{name.replace('_', '-')}"
                raise click.UsageError(f"{place}: standard output takes the JSON; name a file.")
            own = {name: each.value(values) for name, each in groups.items()}
            if answer := function(**own):
                answer.deliver(own.get("output", "-"), report, as_json=as_json)

        options = [option for each in groups.values() for option in each.options]
        if page:
            options.append(click.Option(["--report"], help=page, type=OUTPUT))
        if answers:
            about = "Print JSON for machines."
            options.append(click.Option(["--json", "as_json"], is_flag=True, help=about))
        name = function.__name__.replace("_", "-")
        return click.Command(name, params=options, callback=run, help=function.__doc__)

    return decorate


def _checked_work(**work: Any) -> dict[str, Any]:
    """Refuse two places for the tasks."""
    if work["workers"] is not None and work["scheduler"] is not None:
        raise click.UsageError("--workers are of this machine: leave out --workers or --scheduler.")
    return work


parallel = group(
    _checked_work,
    workers=(
        Count | None,
        option("Processes on this machine.", otherwise="one for each usable processor"),
    ),
    scheduler=(
        str | None,
        option(
            "A Dask scheduler, whose workers are used instead (extra 'cluster').",
            form="tcp://HOST:PORT",
        ),
    ),
    resume=(
        bool,
        option("Go on with what a killed command has left, and compute only what is missing."),
    ),
)
"""The options of commands that carry out many tasks."""

_RECORDING = {
    "time": "CSV: the column of times; clock:ms says its unit.",
    "requested": "CSV: the column of requested angles.",
    "actual": "CSV: the column of actual angles.",
    "torque": "CSV: the column that is 1 while the torque is on.",
    "unit": "Unit of the angles where the log does not say: rad, deg, ticks, turns, us (pulses of "
    "a hobby servo), counts (of a sensor whose scale is fitted), range (0..1), percent or "
    "range_m100_100; 'rad,Jaw=range' where joints differ, 'requested=us,actual=counts' where "
    "columns do.",
    "ticks_per_turn": "Ticks of one turn, such as 4096, for angles in ticks; for pulses the us of "
    "one turn, by default 4000.",
    "topic": "Bags: the topic of actual angles.",
    "command_topic": "Bags: the topic of requested angles.",
    "episodes": "LeRobot: the episodes to read, such as 0-3,7.",
}


def log_options(**first: tuple[Any, Declared]) -> Any:
    """Options of logs, and others before them, such as the joint; by default all are read."""
    forms = {"unit": "UNIT", "ticks_per_turn": "N", "episodes": "LIST"}
    for name, about in _RECORDING.items():
        form = forms.get(name, "TOPIC" if "topic" in name else "COLUMN")
        kind = float if name == "ticks_per_turn" else str
        first[name] = kind | None, option(about, form=form)

    def make(**choices: Any) -> LogOptions:
        from planner.files.logs.rows import LogOptions  # imports NumPy

        return LogOptions(**{"joint": "all", **choices})

    return group(make, **first)


SETTINGS = {
    ".".join(part for part in (*table.place, name) if part != NUMBER): key
    for table in tables(ReplayRun)
    for name, key in table.keys.items()
    if key.option
}
"""The settings that are options, by their keys in a run file."""

BY_JOINT = {
    f"{key.rpartition('.')[0]}.{each.by_joint}": key
    for key, each in SETTINGS.items()
    if each.by_joint
}
"""By key for values of single joints: the setting with the option."""

LEG = "name base foot lock lock_m near"  # the keys of a leg, for `settings`


def settings(*groups: str, path: Declared | None = None, **helps: str) -> Any:
    """Options that are settings, whose value is a typed Run.

    A group is a table of a run file, a colon, and those of its keys that become options, with
    spaces between them: ``"plan: method cyclic"``; a table alone has all of them. ``path`` declares
    the argument or option of the path's file. A help in ``helps`` takes the place of a setting's
    own, by the last part of its key, or by the key with underscores.
    """
    keys = list[str]()
    for table, colon, names in (group.partition(":") for group in groups):
        of_table = [key for key in SETTINGS if key.rpartition(".")[0] == table]
        keys += [f"{table}.{name}" for name in names.split()] if colon else of_table
    whole = ReplayRun if any(key.startswith("replay.") for key in keys) else Run

    def value(values: dict[str, Any]) -> Run:
        content: dict[str, Any] = {}
        if path:
            content["path"] = {"file": values.pop("path")}
        for key in keys:
            if (own := values.pop(key.replace(".", "_"))) not in (None, ()):
                put(content, key, own)
        if "export" in content:
            content["export"] = [{"file": "rows", **content["export"]}]
        return whole.of(content, standard_input=True)

    options = [] if path is None else _single("path", Source, path).options
    for key in keys:
        name = key.replace(".", "_")
        own = helps.get(name) or helps.get(key.rpartition(".")[2], "")
        if key.startswith("plan.") and "plan.method" not in keys:  # no choice of methods
            own = own or SETTINGS[key].purpose
        options.append(_option(name, SETTINGS[key], own))
    return Group(options, value)


def in_options(text: str) -> str:
    """A message with its settings as options: ``--no-cyclic``, ``--limits-deg knee``."""
    return MARKED.sub(lambda mark: _as_option(mark[1]), text)


def warn_of(remarks: Iterable[str], spelt: Callable[[str], str] = in_options) -> None:
    """Print remarks on a path or an answer, with settings as options."""
    for remark in filter(None, remarks):
        warn(spelt(remark))


def _as_option(text: str) -> str:
    name, _, value = text.partition(" = ")
    *above, last = names = [part for part in place_of(name) if isinstance(part, str)]
    if (joints := ".".join(above)) in BY_JOINT:
        return f"{_as_option(BY_JOINT[joints])} {last}"
    while names and ".".join(names) not in SETTINGS.keys() | BY_JOINT.keys():
        names.pop()
    if not names:
        return ".".join([*above, last])
    key = ".".join(names)
    first, _, second = SETTINGS[BY_JOINT.get(key, key)].option.partition("/")
    option = second if value == "false" else first
    return option if value in ("", "true", "false") else f"{option} {json.loads(value)}"


def put(content: dict[str, Any], key: str, value: Any) -> None:
    """Put the value of an option at its place in the content of a run file."""
    *place, name = key.split(".")
    table, declared = content, SETTINGS[key]
    for part in place:
        table = table.setdefault(part, {})
    if declared.by_joint:
        by_joint = by_name(marked(key), value)
        if "" in by_joint:
            table[name] = by_joint.pop("")
        if by_joint:
            table[declared.by_joint] = by_joint
    else:
        is_free = declared.kind.origin is dict
        table[name] = by_name(marked(key), value) if is_free else value


def by_name(option: str, pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
    """Values of an option that is repeated, by name; of each name one."""
    values = dict[Any, Any]()
    for name, value in pairs:
        if name in values:
            which = "all joints" if name == "" else name
            raise BadSetting(f"{option}: got two values for {which}, expected one")
        values[name] = value
    return values
