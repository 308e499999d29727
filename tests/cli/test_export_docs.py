"""The page about robots is true: its commands run, and so does its Python."""

from __future__ import annotations

import contextlib
import functools
import io
import re
import shlex
from pathlib import Path

import pytest

import planner

PAGE = Path(__file__).parent.parent.parent / "docs" / "export.md"

NEEDED = {
    "yaml": "yaml",
    "bag": "rosbags",
    "mcap": "rosbags",
    "lerobot": "pyarrow",
    "view": "meshcat",
}
"""What a command with this word in it cannot do without."""


def _blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder in which the page's commands run, one after another."""
    return tmp_path_factory.mktemp("page")


@pytest.mark.parametrize("command", "".join(_blocks("sh")).splitlines())
def test_the_commands_of_the_page_run(run, written, monkeypatch, command):
    monkeypatch.chdir(written)
    program, *arguments = shlex.split(command)
    assert program == "request-planner"
    for word, package in NEEDED.items():
        if word in arguments:
            pytest.importorskip(package, reason="needs an extra")
    result = run(*arguments)
    assert result.exit_code == 0, result.stderr
    option = "--html" if "--html" in arguments else "-o"
    assert (written / arguments[arguments.index(option) + 1]).exists()


def test_the_python_of_the_page_runs(monkeypatch):
    time = [0.0]

    def sleep(duration):
        time[0] += duration

    monkeypatch.setattr(
        planner, "play", functools.partial(planner.play, now=lambda: time[0], sleep=sleep)
    )
    printed, names = io.StringIO(), {}
    with contextlib.redirect_stdout(printed):
        for code in _blocks("python"):
            exec(compile(code, str(PAGE), "exec"), names)
    assert re.fullmatch(
        r"finished after \d+ requests: 0.00 ms late on average, 0.00 ms at most, 0 overruns, 0 "
        r"skipped\n",
        printed.getvalue(),
    )
