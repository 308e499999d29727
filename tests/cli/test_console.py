"""What the command line says besides its data: warnings, failures, progress on terminals."""

from __future__ import annotations

import io
import json
import sys

import numpy as np
import pytest

from planner.cli.console import BAR, Progress, terminal_width, warn
from planner.cli.reproduce import DURATIONS
from planner.files.text import to_json


def test_a_rule_outside_its_domain_is_a_warning_in_one_line(run, desired, tmp_path):
    model = tmp_path / "model.toml"
    model.write_text("v_max = 5.0\ntheta_0 = 0.03\nlag = 0.03\nacceleration_time = 0.08\n")
    result = run("plan", desired, "--model", model, "--method", "closed-form", "--json")
    assert result.exit_code == 0
    json.loads(result.stdout)
    assert result.stderr.startswith("request-planner: warning: the paper's rule assumes")
    assert result.stderr.count("\n") == 1


def test_a_plan_below_its_own_bound_is_a_failed_check(run, desired, monkeypatch):
    from planner.planning.plan import Plan

    monkeypatch.setattr(Plan, "lower_bounds", np.ones(1))
    result = run("plan", desired)
    assert result.exit_code == 1
    assert "is below its own lower bound of 57.2958 deg" in result.stderr


def test_json_has_no_numbers_that_are_none():
    text = to_json({"gap": float("inf"), "list": [float("nan"), 1.5], "name": "Δ"})
    assert json.loads(text) == {"gap": None, "list": [None, 1.5], "name": "Δ"}


@pytest.mark.parametrize("watched", [True, False], ids=["terminal", "file"])
def test_progress_is_for_terminals(monkeypatch, capsys, watched):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: watched, raising=False)
    progress = Progress()
    progress("the walk")
    progress.done()
    said = capsys.readouterr()
    assert said.out == ""
    assert ("the walk" in said.err) is watched


@pytest.fixture
def clock():
    """A clock that a test sets: a list of one time [s]."""
    return [0.0]


def at(clock, expected):
    return Progress(expected, clock=lambda: clock[0])


def test_the_time_left_follows_the_pace_of_the_steps_that_are_done(clock):
    progress = at(clock, {"hip": 1.0, "knee": 3.0})
    progress("hip")
    assert progress.line() == f"hip …  {'░' * BAR}"
    clock[0] = 10.0
    progress("knee")
    assert progress.line() == f"knee …  {'█' * (BAR // 4)}{'░' * (BAR - BAR // 4)}  30 s left"
    clock[0] = 30.0
    assert progress.line() == f"knee …  {'█' * (3 * BAR // 4)}{'░' * (BAR // 4)}  10 s left"


def test_a_step_that_takes_longer_than_expected_is_not_said_to_end(clock):
    progress = at(clock, ["hip", "knee"])
    progress("hip")
    clock[0] = 5.0
    progress("knee")
    clock[0] = 60.0
    assert progress.line() == f"knee …  {'█' * BAR}  60 s"


@pytest.mark.parametrize(
    ("spent", "said"), [(1.0, ""), (50.0, "  50 s"), (600.0, "  10 min"), (9000.0, "  2.5 h")]
)
def test_work_of_unknown_length_says_how_long_it_has_been_going_on(clock, spent, said):
    progress = at(clock, [])
    progress("the walk")
    clock[0] = spent
    assert progress.line() == f"the walk …{said}"


def test_steps_in_parallel_are_counted_and_the_time_left_is_that_at_their_pace(clock):
    with Progress(count=8, clock=lambda: clock[0]) as progress:
        assert progress.line() == f"0 of 8 …  {'░' * BAR}"
        progress("episode 3")
        progress("episode 1")
        assert progress.line() == f"2 of 8 …  {'█' * (BAR // 4)}{'░' * (BAR - BAR // 4)}"
        clock[0] = 10.0
        assert progress.line().endswith("  30 s left")


def test_a_pace_that_differs_from_what_was_expected_counts_for_the_steps_that_are_left(clock):
    progress = at(clock, {"hip": 2.0, "knee": 3.0, "ankle": 4.0})
    for step in ("hip", "knee"):
        progress(step)
        clock[0] += 10.0
    progress("ankle")
    assert progress.line().endswith("  16 s left")  # 20 s for 5 parts of 9


def test_work_inside_other_work_has_the_line_and_gives_it_back(clock, monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with at(clock, ["outer"]) as outer:
        outer("outer")
        with at(clock, ["inner"]) as inner:
            inner("inner")
            assert Progress.shown is inner
        assert Progress.shown is outer
    assert Progress.shown is None
    assert capsys.readouterr().err.count("inner …") >= 1


def test_the_steps_of_the_experiment_are_those_that_are_expected(reproduced):
    assert [*reproduced.told, "the report"] == list(DURATIONS["model"])


LONG = "the model of the knee was identified from a log in which the joint hardly moved: record it"


def test_a_warning_is_wrapped_on_a_terminal_and_one_line_elsewhere(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("NO_COLOR", "1")
    for watched in (True, False):
        stream = io.StringIO()
        monkeypatch.setattr(stream, "isatty", lambda watched=watched: watched)
        monkeypatch.setattr(sys, "stderr", stream)
        warn(LONG)
        lines = stream.getvalue().splitlines()
        if watched:
            assert max(map(len, lines)) <= 40
        else:
            assert len(lines) == 1
        text = " ".join(" ".join(lines).split())
        assert text == f"request-planner: warning: {LONG}"


@pytest.mark.parametrize(
    ("columns", "width"), [("60", 60), ("0", None), ("wide", None), (None, None)]
)
def test_columns_set_the_width_of_tables_that_are_piped(monkeypatch, columns, width):
    if columns is None:
        monkeypatch.delenv("COLUMNS", raising=False)
    else:
        monkeypatch.setenv("COLUMNS", columns)
    assert terminal_width(io.StringIO()) == width
