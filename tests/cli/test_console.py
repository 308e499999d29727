"""What the command line says besides its data: warnings, failures, progress on terminals."""

from __future__ import annotations

import io
import os
import sys

import click
import pytest

from planner.cli.console import (
    BAR,
    KEY,
    Progress,
    complain,
    detail,
    remark,
    summarise,
    warn,
)

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


LONG = (
    "the knee's model was made from a log of little motion: use --amplitude-deg, --sensor-delay-ms "
    "and /a/place/that/is/longer/than/forty-characters/of/a/line.csv"
)


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
            assert max(len(line) for line in lines if "/" not in line) <= 40
            assert all(line.startswith("  ") for line in lines[1:])
        else:
            assert len(lines) == 1
        text = " ".join(" ".join(lines).split())
        assert text == f"request-planner: warning: {LONG}"


def test_the_first_line_of_a_summary_and_the_label_of_a_notice_stand_out(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    summarise("first\nsec\x1bond\nthird")  # which a terminal would obey
    warn("a warning:\nof warning: \x1b")
    remark("a remark\n\x1b")
    complain("an\n  error \x1b")
    assert capsys.readouterr().err == (
        "\x1b[1mfirst\x1b[0m\nsec\\x1bond\nthird\n"
        "request-planner: \x1b[33mwarning:\x1b[0m a warning: of warning: \\x1b\n"
        "request-planner: a remark \\x1b\n"
        "\x1b[31m\x1b[1mrequest-planner:\x1b[0m an error \\x1b\n"
    )
    with click.Context(click.Command("plan")) as context:
        context.meta[KEY] = "quiet"
        summarise("first")
        remark("a remark")
        detail("a detail")
        assert capsys.readouterr().err == ""
        warn("a warning")
        complain("an error")
        assert capsys.readouterr().err.count("\n") == 2
