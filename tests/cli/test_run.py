"""A run file does what the single commands do, inside its folder, whole or not at all."""

import inspect
import json
import math
import re
import tomllib
from contextlib import suppress
from pathlib import Path

import click
import numpy as np
import pytest

import planner
from planner.cli import cli
from planner.cli.declared import NUMBER, tables, template, toml_value, understand
from planner.cli.options import SETTINGS
from planner.cli.program import COMMANDS
from planner.cli.settings import HalfEllipse, Replay, Run
from planner.files.paths import read_joint_path
from planner.files.text import Toml

ROUNDED = 1e-6
"""A foot path in a file carries 12 decimals of a metre, which the search magnifies [rad]."""

JOINTS = '[path]\nfile = "desired.csv"\n'  # the least that makes a run, on the file of two joints


@pytest.fixture
def write(tmp_path, desired):  # noqa: ARG001
    """Write a run file beside a path of two joints, and say what it is called."""

    def write(content, name="it.toml"):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(content, encoding="utf-8")
        return str(file.relative_to(tmp_path))

    return write


def results(folder):
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


@pytest.mark.usefixtures("no_foot_bound")
def test_the_template_runs_as_it_is_and_plans_what_plan_does(run, write, tmp_path):
    result = run("run", write(run("run", "--template").stdout, "walk.toml"))
    assert result.exit_code == 0, result.stderr
    run("gait", "-o", "foot.csv")
    leg = ("--leg", "reference", "--unreachable", "clamp", "--method", "foot-optimal")
    run("plan", "foot.csv", *leg, "-o", "plan.csv")
    folder = tmp_path / "walk"
    written, other = map(read_joint_path, (folder / "requests.csv", tmp_path / "plan.csv"))
    assert np.max(np.abs(written.values - other.values)) <= ROUNDED
    document = results(folder)
    files = "angles.csv controller.csv desired.csv foot.csv report.html requests.csv"
    assert document["files"] == files.split()
    assert document["within_tolerance"] is True
    angles = read_joint_path(folder / "angles.csv").values
    for j, joint in enumerate(document["joints"].values()):
        assert np.degrees(angles[:, j]) == pytest.approx(joint["predicted_deg"], abs=1e-9)


def test_places_are_relative_to_the_file(run, write, desired, tmp_path, monkeypatch):
    write("v_max = 4.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.04\n", "runs/a.toml")
    content = 'out = "results"\n[path]\nfile = "own.csv"\n[model]\nfile = "a.toml"\n'
    content += '[output]\nreport = "page.html"\n'
    file = write(content, "runs/it.toml")
    desired.rename(tmp_path / "runs" / "own.csv")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    result = run("run", tmp_path / file)
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / "runs" / "results" / "results.json").is_file()
    assert list(elsewhere.iterdir()) == []
    page = (tmp_path / "runs" / "results" / "page.html").read_text("utf-8")
    assert all(f'href="../{name}"' in page for name in ("own.csv", "a.toml"))


@pytest.mark.usefixtures("desired")
def test_standard_input_is_a_run_file_too(run, tmp_path):
    assert run("run", "-", "--out", "out", stdin=JOINTS).exit_code == 0
    assert (tmp_path / "out" / "requests.csv").is_file()


def test_joints_rest_where_the_file_says(run, write, tmp_path):
    start = "[plan]\ncyclic = false\n[start]\ndeg = 2\n[start.joints]\nknee = 20\n"
    assert run("run", write(JOINTS + start)).exit_code == 0
    angles = np.degrees(read_joint_path(tmp_path / "it" / "angles.csv").values)
    assert angles[0] == pytest.approx([2.0, 20.0], abs=1e-9)


def test_a_missed_tolerance_is_status_1_and_all_files(run, write, tmp_path):
    result = run("run", write(JOINTS + '[plan]\nmethod = "closed-form"\n[tolerance]\ndeg = 1e-6\n'))
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1].startswith("request-planner: hip is off by ")
    assert result.stderr.endswith("; the files are written all the same\n")
    assert results(tmp_path / "it")["within_tolerance"] is False
    assert (tmp_path / "it" / "requests.csv").is_file()
    assert run("run", "it.toml", "--json").exit_code == 1


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
            default = "must be there" if key.default is ... else cell(given) or "–"
            lines.append(f"| `{name}` | {cell(key.kind.expected)} | {default} | {cell(key.help)} |")
        if table.free:
            lines += ["", f"Any joint of the path, set to {table.free.kind.inner[1].expected}."]
        sections.append("\n".join(lines))
    return "\n\n".join(sections) + "\n"


def test_the_page_has_every_key_as_it_is_declared():
    assert PAGE.endswith(markdown(Run)), "write the tables anew from markdown(Run)"


def test_the_files_of_the_page_are_run_files_of_which_the_first_runs(run):
    first, *others = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    for content in others:
        understand(Toml("page", content, tomllib.loads(content)), Run)
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
