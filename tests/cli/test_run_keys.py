"""The keys of a run file, its template, its page and the options of the commands are one."""

from __future__ import annotations

import inspect
import math
import re
import tomllib
from contextlib import suppress
from pathlib import Path

import click
import pytest

import planner
from planner.cli import cli
from planner.cli.declared import NUMBER, tables, template, toml_value, understand
from planner.cli.options import SETTINGS
from planner.cli.program import COMMANDS
from planner.cli.settings import HalfEllipse, Replay, Run
from planner.files.text import Toml

PAGE = (Path(__file__).parents[2] / "docs" / "run.md").read_text(encoding="utf-8")

DECLARED = [
    ((*table.place, name), key) for table in tables(Run) for name, key in table.keys.items()
]
NAMES = [".".join(part for part in place if part != NUMBER) for place, _ in DECLARED]


def markdown(cls) -> str:
    """A section and a table of keys for every table of a file, as docs/run.md has them."""

    def cell(text: str) -> str:
        return text.replace("|", "\\|").replace("<", "\\<")

    sections = []
    for table in tables(cls):
        title = f"`{table.header}`" if table.place else "Above all tables"
        lines = [f"### {title}", "", cell(table.about)]
        if table.keys:
            lines += ["", "| key | expected | default | what it is for |", "|---|---|---|---|"]
        for name, key in table.keys.items():
            given = key.otherwise or ("" if key.default is None else toml_value(key.default))
            default = "must be there" if key.required else cell(given) or "–"
            lines.append(f"| `{name}` | {cell(key.kind.expected)} | {default} | {cell(key.help)} |")
        if table.free:
            lines += ["", f"Any joint of the path, set to {table.free}."]
        sections.append("\n".join(lines))
    return "\n\n".join(sections) + "\n"


def test_the_page_has_every_key_as_it_is_declared():
    assert PAGE.endswith(markdown(Run)), "write the tables anew from markdown(Run)"


@pytest.mark.parametrize("content", re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL))
def test_the_files_of_the_page_are_run_files(content):
    understand(Toml("page", content, tomllib.loads(content)), Run)


def test_the_first_file_of_the_page_runs(run):
    first = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[0]
    result = run("run", "-", "--out", "first", stdin=first)
    assert result.exit_code == 0, result.stderr


def test_the_template_sets_what_it_sets_to_the_default_or_says_so():
    text = template(Run, ["A run."])
    settings = understand(Toml("template", text, tomllib.loads(text)), Run)
    for place, key in DECLARED:
        value = settings
        for part in place:
            value = value[0] if part == NUMBER else getattr(value, part)
        expected = key.default if key.set_to is None else key.set_to
        assert value == expected, place


@pytest.mark.parametrize(("place", "key"), DECLARED, ids=NAMES)
def test_every_key_is_in_the_template_and_its_example_is_of_its_kind(place, key):
    lines = template(Run, []).splitlines()
    shown = [line for line in lines if re.match(rf"(# )?{place[-1]} = ", line)]
    assert shown
    for line in shown:
        ((_, value),) = tomllib.loads(line.removeprefix("# ")).items()
        assert value is not None
    assert key.help.endswith(".")
    example = key.example
    if example is not None:
        key.kind.fitted(example)


KEYS = {**dict(zip(NAMES, (key for _, key in DECLARED), strict=True)), **Replay.keys}


@pytest.mark.parametrize("key", KEYS.values(), ids=KEYS)
def test_a_number_at_an_end_of_its_range_is_taken_where_the_words_say_so(key):
    def takes(number):
        with suppress(ValueError):
            return key.kind.fitted(number) == number
        return False

    if whole := re.fullmatch(r"a whole number from (-?\d+) to (\d+)", key.kind.expected):
        low, high = map(int, whole.groups())
        assert [*map(takes, (low - 1, low, high, high + 1))] == [False, True, True, False]
        assert not takes(low + 0.5)
    elif key.kind.expected.startswith("a number"):
        for words, end in re.findall(r"(above|of at least|below) ([\d.]+)", key.kind.expected):
            at, inside = float(end), math.inf if words != "below" else -math.inf
            assert takes(at) is (words == "of at least")
            assert takes(math.nextafter(at, inside))
            assert not takes(math.nextafter(at, -inside))
        assert not takes(math.inf)
        assert not takes(math.nan)
        assert not takes(True)


def test_every_option_that_is_a_setting_is_one_of_a_command():
    context, names = click.Context(cli), set()
    for command in COMMANDS:
        for parameter in cli.get_command(context, command).params:
            names.update(parameter.opts)
    for setting in SETTINGS.values():
        assert setting.option.partition("/")[0] in names


def test_the_half_ellipse_has_the_parameters_of_the_library():
    keys = {name: key.default for name, key in HalfEllipse.keys.items()}
    parameters = inspect.signature(planner.half_ellipse).parameters.values()
    assert keys.pop("for_leg") is False
    keys["heading"] = keys.pop("heading_deg")  # 0 is 0 in either unit
    assert keys == {each.name: each.default for each in parameters}
