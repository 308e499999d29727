"""The page about logs tells the truth: its commands parse, its names and numbers are the code's."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from planner import LogOptions
from planner.cli.identify import identify, to_log_options
from planner.files import columns
from planner.files.logs import make_log
from planner.files.logs.bag import ACTUAL_TYPES, REQUEST_TYPES
from planner.trajectory import MOST_TURNS

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
    for unit in columns.ANGLE_UNITS:
        assert f"| `{unit}` |" in PAGE
    for kind in {*ACTUAL_TYPES, *REQUEST_TYPES}:
        assert f"| `{kind.replace('/msg/', '/')}` |" in PAGE


def test_every_word_that_the_page_says_is_guessed_is_known():
    bullets = dict(re.findall(r"^- (\S+ \S+)(.*?)(?:;|\.)$", PAGE, re.MULTILINE | re.DOTALL))
    known = {
        "the time": columns.WORDS | {f"_{unit}" for unit in columns.SECONDS},
        "requested angles": columns.REQUESTED,
        "actual angles": columns.ACTUAL | columns.PLAIN,
        "the torque,": columns.TORQUES,
    }
    for bullet, words in known.items():
        told = re.findall(r"`(\w+)`", bullets[bullet])
        assert told
        assert set(told) <= words


def test_the_numbers_of_the_page_are_the_codes():
    assert f"more than {MOST_TURNS:.0f} turns in radians" in PAGE
    assert f"less than {make_log.LEAST_DEG:.0f} degrees" in PAGE
    assert (
        f"more than {make_log.SLOWEST:.0f} s or less than {make_log.FASTEST * 1e6:.0f} µs" in PAGE
    )
    assert f"beyond {make_log.MOST_SHARE:.0f} either way" in PAGE
