"""What people expect of any command line: help, quiet, colours, completion, a quick start."""

import re
import subprocess
import sys

import click
import pytest

from planner.cli import cli
from planner.cli.program import COMMANDS

HEAVY = (
    "casadi cvxpy jinja2 kinematics.leg matplotlib meshcat mujoco numba numpy osqp pinocchio "
    "pyarrow rosbags scipy scipy.optimize yaml"
)
"""Modules that take long to import."""


def command(name):
    return cli.get_command(click.Context(cli), name)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_short_help_an_example_and_help_for_every_option(name):
    told = command(name)
    assert re.fullmatch(r"[A-Z].{10,60}\.", told.short_help)
    assert "Example" in told.help
    options = [each for each in told.params if isinstance(each, click.Option)]
    assert [each.name for each in options if not each.help and each.name != "seed"] == []
    for letter in "qv":
        assert any(f"-{letter}" in each.opts for each in options)


def imported(*arguments):
    """What is heavy and imported by a command in a process of its own."""
    code = (
        "import sys\nfrom planner.cli import cli\n"
        "try:\n    cli.main(sys.argv[1:])\nexcept SystemExit as end:\n    assert not end.code\n"
        "print('imported', *sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    head, *modules = done.stdout.splitlines()[-1].split()
    assert head == "imported"
    return {*modules} & {*HEAVY.split()}


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["run", "--help"], []])
def test_help_and_version_import_nothing_heavy(arguments):
    assert imported(*arguments) == set()


def test_a_plan_of_joints_imports_what_it_needs_only(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("\n".join(["t_s,hip_deg", *(f"{0.008 * k},{k % 20}" for k in range(40))]))
    needed = {"numba", "numpy", "scipy", "yaml"}  # with which Numba reads its configuration
    assert imported("plan", str(path)) == needed


@pytest.mark.parametrize("arguments", [["-q", "plan"], ["plan", "--quiet"]])
def test_quiet_leaves_the_data_alone(run, desired, arguments):
    result = run(*arguments, desired)
    assert result.stdout == run("plan", desired).stdout
    assert result.stderr == ""


@pytest.mark.parametrize("asked", ["NO_COLOR", "FORCE_COLOR"])
def test_colours_are_for_those_who_ask_and_not_in_data(run, monkeypatch, asked):
    for name in ("NO_COLOR", "FORCE_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(asked, "1")
    coloured = asked == "FORCE_COLOR"
    assert ("\x1b[31m" in run("bogus").stderr) is coloured
    assert ("\x1b[1m" in run("gait", "-o", "foot.csv").stderr) is coloured
    assert "\x1b" not in run("gait").stdout


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("pl", ["plain,plan", "plain,play"]),
        ("plan --meth", ["plain,--method"]),
        ("plan --method op", ["plain,optimal"]),
        ("plan fo", ["file,fo"]),
        ("gait -o fo", ["file,fo"]),
        ("run wal", ["file,wal"]),
        ("reproduce --out ou", ["dir,ou"]),
        ("plan --leg fr", ["plain,front-left", "plain,front-right"]),
        ("plan --leg left", ["file,left"]),
        ("completion z", ["plain,zsh"]),
    ],
)
def test_a_shell_completes_what_may_come_next(run, typed, offered):
    words = f"request-planner {typed}"
    environment = {
        "_REQUEST_PLANNER_COMPLETE": "bash_complete",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    done = run(prog_name="request-planner", env=environment)
    assert done.exit_code == 0
    assert done.stdout.splitlines() == offered
