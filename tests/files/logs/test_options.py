"""What may be said about a log is checked before any log is opened."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from planner import LogOptions
from planner.cli.identify import identify
from planner.cli.options import log_options, to_log_options
from planner.files import columns
from planner.files.logs import csv_log, rows
from planner.files.logs.bag import ACTUAL_TYPES, REQUEST_TYPES
from planner.identification.log import SLOWEST
from planner.trajectory import MOST_TURNS

BAD = {
    "an unknown unit": {"unit": "radd"},
    "an unknown unit of one joint": {"unit": "rad,Jaw=inch"},
    "no ticks": {"ticks_per_turn": 0},
    "ticks in words": {"ticks_per_turn": "4096"},
    "a joint by its place": {"joint": 3},
    "episodes backwards": {"episodes": "3-1"},
    "episodes in words": {"episodes": "first"},
    "more episodes than there can be": {"episodes": "0-999999999"},
}


def test_options_that_fit_no_log_are_refused(snapshot):
    snapshot.refusals("log_options", lambda options: LogOptions(**options), BAD)


def test_the_command_lines_options_become_log_options():
    told = []

    @click.command()
    @log_options
    def command(**choices):
        told.append(to_log_options(choices))

    arguments = {
        "joint": "Jaw",
        "time": "clock:ms",
        "requested": "a",
        "actual": "b",
        "torque": "c",
        "unit": "ticks",
        "ticks_per_turn": 4096.0,
        "topic": "/a",
        "command_topic": "/b",
        "episodes": "0-3",
    }
    words = [f"--{name.replace('_', '-')}={value}" for name, value in arguments.items()]
    assert CliRunner().invoke(command, words).exit_code == 0
    assert told == [LogOptions(**arguments)]
    assert CliRunner().invoke(command, []).exit_code == 0
    assert told[1] == LogOptions()


PAGE = (Path(__file__).parents[3] / "docs" / "logs.md").read_text(encoding="utf-8")


COMMANDS = re.findall(r"^    request-planner identify (.*)$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_page_is_one(command):
    with identify.make_context("identify", shlex.split(command)) as context:
        assert isinstance(to_log_options(context.params), LogOptions)


def test_the_page_has_a_command_for_every_format():
    paths = " ".join(shlex.split(command)[0] for command in COMMANDS)
    for ending in ("csv", "parquet", "json", "mcap", "bag", "my_dataset", "my_bag"):
        assert ending in paths


def test_the_page_names_every_unit_and_type():
    for unit in sorted(set(columns.ANGLE_NAMES.values())):
        assert f"| `{unit}` |" in PAGE
    for kind in {*ACTUAL_TYPES, *REQUEST_TYPES}:
        assert f"| `{kind.replace('/msg/', '/')}` |" in PAGE


def test_every_word_that_the_page_says_is_guessed_is_known():
    bullets = dict(re.findall(r"^- (\S+ \S+)(.*?)(?:;|\.)$", PAGE, re.MULTILINE | re.DOTALL))
    known = {
        "the time": columns.WORDS | {f"_{unit}" for unit in columns.SECONDS},
        "requested angles": columns.ROLE_WORDS["requested"],
        "actual angles": columns.ROLE_WORDS["actual"] | columns.ROLE_WORDS["position"],
        "the torque,": {*csv_log.TORQUES},
    }
    for bullet, words in known.items():
        told = re.findall(r"`(\w+)`", bullets[bullet])
        assert told
        assert set(told) <= words


def test_the_numbers_of_the_page_are_the_codes():
    assert f"more than {MOST_TURNS:.0f} turns in radians" in PAGE
    assert f"less than {rows.LEAST_DEG:.0f} degrees" in PAGE
    assert f"more than {SLOWEST:.0f} s or less than {rows.FASTEST * 1e6:.0f} µs" in PAGE
    assert f"asks from {rows.SPARSE:g} s on" in PAGE
    assert f"beyond {rows.MOST_SHARE:.0f} either way" in PAGE
