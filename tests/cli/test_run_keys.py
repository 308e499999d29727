"""The keys of a run file, its template, its page and the options of the commands are one."""

from __future__ import annotations

import inspect
import re
import shlex
import tomllib
from importlib import import_module
from pathlib import Path

import click
import pytest

import planner
from planner.cli import cli
from planner.cli.run_keys import RUN
from planner.cli.run_words import EXPORT_KEYS, KEYS
from planner.files.schema import key_name, understand
from planner.files.schema_text import markdown, template
from planner.files.toml import Toml, read_toml

PAGE = (Path(__file__).parents[2] / "docs" / "run.md").read_text(encoding="utf-8")

DECLARED = [(table, key) for table in RUN for key in table.keys]
NAMES = [key_name((*table.name, key.name)) for table, key in DECLARED]


def test_the_page_has_every_key_as_it_is_declared():
    assert PAGE.endswith(markdown(RUN)), "write the tables anew from schema_text.markdown(RUN)"


@pytest.mark.parametrize("content", re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL))
def test_the_files_of_the_page_are_run_files(content):
    understand(Toml("page", content, tomllib.loads(content)), RUN)


def test_the_commands_of_the_page_run(run):
    (commands,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    for command in commands.splitlines():
        program, *arguments = shlex.split(command.replace("> ", "-o "))
        assert program == "request-planner"
        if "--template" in arguments:
            written = run(*arguments[:2]).stdout
            Path(arguments[-1]).write_text(written, encoding="utf-8")
        else:
            assert run(*arguments).exit_code == 0
    first = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[0]
    result = run("run", "-", "--out", "first", stdin=first)
    assert result.exit_code == 0, result.stderr


def test_the_template_sets_what_it_sets_to_the_default_or_says_so():
    text = template(RUN, ["A run."])
    settings = understand(Toml("template", text, tomllib.loads(text)), RUN)
    for (table, key), name in zip(DECLARED, NAMES, strict=True):
        if table.named:
            continue
        value = settings["export"][0][key.name] if table.repeated else settings[name]
        expected = key.default if key.set_to is None else key.set_to
        assert value in (expected, tuple(expected) if isinstance(expected, list) else expected), (
            name
        )


@pytest.mark.parametrize(("table", "key"), DECLARED, ids=NAMES)
def test_every_key_is_in_the_template_and_its_example_is_of_its_kind(table, key):
    lines = template([table], []).splitlines()
    (line,) = (line for line in lines if re.match(rf"(# )?{key.name} = ", line))
    ((_, value),) = tomllib.loads(line.removeprefix("# ")).items()
    key.kind.take(value)
    assert key.about.endswith(".")


def option_of(command, name):
    found = getattr(import_module(f"planner.cli.{command}"), command)
    return next(p for p in found.params if p.name == name)


SAME = {
    **{f"plan.{key}": ("plan", key) for key in ("method", "cyclic", "norm", "segments", "rule")},
    "leg.name": ("plan", "leg"),
    "leg.unreachable": ("plan", "unreachable"),
    "model.file": ("plan", "model"),
    "output.level": ("compare", "level"),
    "path.half_ellipse.samples": ("gait", "samples"),
    "path.half_ellipse.ground_fraction": ("gait", "ground_fraction"),
    "path.half_ellipse.heading_deg": ("gait", "heading_deg"),
    **{f"export.{key}": ("export", key) for key in ("format", "cycles", "between", "unit")},
}
"""Keys that are options too: command and option."""


@pytest.mark.parametrize("name", SAME)
def test_a_key_that_is_an_option_too_has_its_choices_and_its_default(name):
    key = DECLARED[NAMES.index(name)][1]
    option = option_of(*SAME[name])
    if isinstance(option.type, click.Choice):
        assert key.kind.expected == f"one of {', '.join(option.type.choices)}"
    default = option.to_info_dict()["default"]
    if key.default is not None:
        assert key.default == default
    elif default is not None:
        assert key.otherwise == f'"{default}"'


def test_the_half_ellipse_has_the_parameters_of_the_library():
    keys = {k.name: k.default for t, k in DECLARED if t.name == ("path", "half_ellipse")}
    parameters = inspect.signature(planner.half_ellipse).parameters.values()
    assert keys.pop("for_leg") is False
    keys["heading"] = keys.pop("heading_deg")  # 0 is 0 in either unit
    assert keys == {each.name: each.default for each in parameters}


def test_every_option_of_plan_and_export_has_a_key():
    for command, keys, others in (
        ("plan", KEYS, {"path", "output", "as_json", "quiet", "verbose"}),
        ("export", EXPORT_KEYS, {"requests", "joints", "period_s", "as_json", "quiet", "verbose"}),
    ):
        context = click.Context(cli)
        for option in cli.get_command(context, command).params:
            spelt = max(option.opts, key=len)
            name = spelt.lstrip("-")
            plain = command == "export" and f"export.{name}" in NAMES
            assert option.name in others or plain or {*option.opts} & {*keys, "--cyclic"}, spelt
    assert {name for name in KEYS.values() if re.fullmatch(r"[\w.]+", name)} <= {*NAMES}
    assert {f"export.{name}" for name in EXPORT_KEYS.values()} <= {*NAMES}


def test_lines_are_found_in_tables_that_repeat(tmp_path):
    file = tmp_path / "it.toml"
    file.write_text('[[a]]\nx = 1\n[[a]]\n"x" = 2\n[b."c d"]\ne.f = 3\n')
    read = read_toml(file, example="")
    assert [read.line_of(place) for place in (("a", 0, "x"), ("a", 1, "x"), ("a", 1))] == [2, 4, 3]
    assert read.line_of(("b", "c d", "e", "f")) == 6
    assert read.line_of(("b", "nothing")) is None
