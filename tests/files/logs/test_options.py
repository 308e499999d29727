"""What may be said about a log is checked before any log is opened."""

from __future__ import annotations

import re
from pathlib import Path

from planner import LogOptions
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


PAGE = (Path(__file__).parents[3] / "docs" / "logs.md").read_text(encoding="utf-8")


def test_the_page_has_a_command_for_every_format():
    commands = re.findall(r"^    request-planner identify (\S+)", PAGE, re.MULTILINE)
    for ending in ("csv", "parquet", "json", "mcap", "bag", "my_dataset", "my_bag"):
        assert any(path.endswith(ending) for path in commands)


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
