"""Progress: for terminals only, with a bar and the time left once steps have taken their time."""

from __future__ import annotations

import sys

import pytest

from planner.cli.durations import DURATIONS
from planner.cli.progress import BAR, Progress


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
