"""Every block of every page runs, in the page's order and one folder, and prints what it says."""

from __future__ import annotations

import contextlib
import functools
import io
import pickle
from pathlib import Path

import pytest

import planner
from planner.inversion.foot import result as foot_result
from planner.run import comparison
from tests.docs import shell
from tests.docs.blocks import PAGES, ROOT, blocks
from tests.docs.logs import write_logs
from tests.docs.printed import missing

RUN = [page for page in PAGES if blocks(page)]


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    """An empty folder, in which time does not pass while requests are played."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    time = [0.0]

    def sleep(duration):
        time[0] += duration

    clocked = functools.partial(planner.play, now=lambda: time[0], sleep=sleep)
    monkeypatch.setattr(planner, "play", clocked)


@pytest.fixture(scope="module")
def answered_before():
    """What was answered to the questions that several pages ask."""
    return {}


@pytest.fixture
def asked_once(answered_before, monkeypatch):
    """Let the longest searches answer once to the same arguments."""

    def once(honest):
        def kept(*arguments, **options):
            asked = {option: value for option, value in options.items() if option != "progress"}
            question = pickle.dumps((honest.__name__, arguments, asked))
            if question not in answered_before:
                answered_before[question] = honest(*arguments, **options)
            return answered_before[question]

        return kept

    for module, name in ((foot_result, "foot_bound"), (comparison, "cross_check")):
        monkeypatch.setattr(module, name, once(getattr(module, name)))


@pytest.mark.usefixtures(
    "empty_folder", "asked_once", "ready_experiments", "brief_search", "undrawn", "in_this_process"
)
@pytest.mark.parametrize("page", RUN, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_blocks_of_the_page_run_and_print_what_it_says(page):
    """Run whole, as a reader runs it, but for a long search and pictures."""
    if page.name in ("logs.md", "replay.md"):
        write_logs(Path())
    names, not_installed = {}, set()
    for block in blocks(page):
        place = f"{page}, line {block.line}"
        if block.language == "python":
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(block.code, place, "exec"), names)
            shown = printed.getvalue()
        else:
            shown = ""
            for command in shell.commands(block.code):
                absent = shell.missing(command)
                not_installed.update(absent)
                shown += "" if absent else shell.run(command)
        line = missing(block.printed, shown)
        assert line is None, f"{place}: not printed: {line}\nbut:\n{shown}"
    if not_installed:
        pytest.skip(f"all but what needs {', '.join(sorted(not_installed))}")
