"""What the command line says besides its data: warnings, failures, progress on terminals."""

import os
import sys
import threading

import click
import pytest

from planner.cli.console import BAR, KEY, Progress

ERASE = "\r\x1b[K"

SHOWN = {
    ("normal", True): f"{ERASE}the walk …{ERASE}the abducto{ERASE}",
    ("verbose", True): f"{ERASE}the walk …{ERASE}request-planner: the walk: 1.25 s\n"
    f"{ERASE}the abducto{ERASE}request-planner: the abductor of the leg: 2 s\n{ERASE}",
    ("quiet", True): "",
    ("normal", False): "",
    ("verbose", False): "request-planner: the walk: 1.25 s\n"
    "request-planner: the abductor of the leg: 2 s\n",
}
"""What is said of two steps, by what is asked for, on a terminal of 12 columns and elsewhere."""


@pytest.mark.parametrize(("asked", "watched"), SHOWN)
def test_progress_is_for_terminals_and_the_time_of_each_step_for_who_asks(
    monkeypatch, capsys, clock, asked, watched
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: watched, raising=False)
    monkeypatch.setattr("shutil.get_terminal_size", lambda **_: os.terminal_size((12, 24)))
    monkeypatch.setattr("planner.cli.console.REDRAWN", 1e6)
    monkeypatch.setenv("NO_COLOR", "1")
    with click.Context(click.Command("plan")) as context:
        context.meta[KEY] = asked
        with at(clock) as progress:
            progress("the walk")
            clock[0] = 1.25
            progress("the abductor of the leg")
            clock[0] = 3.25
    assert capsys.readouterr() == ("", SHOWN[asked, watched])


@pytest.fixture
def clock():
    """A clock that a test sets: a list of one time [s]."""
    return [0.0]


def at(clock, count=0):
    return Progress(count, clock=lambda: clock[0])


def test_the_time_left_follows_the_pace_of_the_steps_that_are_done(clock):
    progress = at(clock, 4)
    progress("hip")
    assert progress.line() == f"hip …  {'░' * BAR}"
    clock[0] = 10.0
    assert progress.line() == f"hip …  {'░' * BAR}  10 s"
    progress("knee")
    assert progress.line() == f"knee …  {'█' * (BAR // 4)}{'░' * (BAR - BAR // 4)}  30 s left"
    clock[0] = 30.0
    assert progress.line().endswith("  10 s left")
    progress("ankle")
    assert progress.line().endswith("  30 s left")
    clock[0] = 100.0  # a step that takes longer than the others
    assert progress.line() == f"ankle …  {'█' * (BAR // 2)}{'░' * (BAR // 2)}  1 s left"
    quick = at(clock, 2)  # there is no pace to tell within the first moments
    quick("hip")
    quick("knee")
    assert quick.line() == f"knee …  {'█' * (BAR // 2)}{'░' * (BAR // 2)}"


def test_where_there_is_no_terminal_long_work_says_now_and_then_how_far_it_is(
    monkeypatch, capsys, clock
):
    monkeypatch.setattr("planner.cli.console.REPEATED", 1e-3)
    said = threading.Event()
    monkeypatch.setattr("planner.cli.console.print_line", lambda text: said.set() or print(text))
    progress = at(clock, 2)
    clock[0] = 40.0
    with progress:
        progress("the hip")
        assert said.wait(10.0)
        progress("the knee")
        assert progress.line(bar=False) == "the knee …  1 of 2  40 s left"
    assert "request-planner: the hip …  0 of 2  40 s" in capsys.readouterr().out.splitlines()
