"""Every block of every page runs, in the page's order and one folder, and prints what it says."""

import contextlib
import functools
import io
import pickle
import re
from pathlib import Path

import pytest

import planner
from planner.evaluation import cross_check
from planner.planning.bounds import foot_bound
from tests.docs import shell
from tests.docs.blocks import PAGES, ROOT, blocks, prose
from tests.docs.logs import write_logs
from tests.docs.printed import difference, rewritten

RUN = [page for page in PAGES if blocks(page)]

BRIEF = {"README.md": {"calibrate": {"duration_s": 8.0}}}
"""Defaults with which commands of a page take less time, where it does not tell what they print."""

UNBOUNDED = ("any_leg.md",)  # pages that tell no bound of a foot: it is not computed

MEASURED = re.compile(r"(\d+\.\d+)(?:,? (?:and |to |instead of )?\d+\.\d+)* (?:deg(?:rees)?|cm)\b")
"""An error as programs print them: with decimals, in degrees or centimetres."""


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

    for module, name in ((foot_bound, "foot_bound"), (cross_check, "cross_check")):
        monkeypatch.setattr(module, name, once(getattr(module, name)))


@pytest.mark.usefixtures(
    "empty_folder", "asked_once", "ready_experiments", "undrawn", "in_this_process"
)
@pytest.mark.parametrize("page", RUN, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_blocks_of_the_page_run_and_print_what_it_says(page, request):
    """Run whole, as a reader runs it, but for pictures."""
    if page.name in UNBOUNDED:
        request.getfixturevalue("no_foot_bound")
    if page.name in ("logs.md", "replay.md"):
        write_logs(Path())
    names, not_installed, changed = {}, set(), []
    for block in blocks(page):
        where = f"{page}, line {block.line}"
        if block.language == "python":
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(block.code, where, "exec"), names)
            shown = printed.getvalue()
        else:
            shown = ""
            for command in shell.commands(block.code):
                absent = shell.missing(command)
                not_installed.update(absent)
                shown += "" if absent else shell.run(command, BRIEF.get(page.name))
        told = [each.text for each in block.printed]
        if request.config.getoption("--rewrite-snapshots"):
            told = rewritten(told, shown)
            changed += zip((each.place for each in block.printed), told, strict=True)
        differs = difference("".join(told), shown) if told else None
        assert differs is None, f"{where}: {differs}\nof:\n{shown}"
    text = page.read_text(encoding="utf-8")
    for (start, end), told in reversed(changed):
        text = text[:start] + told + text[end:]
    if changed:
        page.write_text(text, encoding="utf-8")
    if not_installed:
        pytest.skip(f"all but what needs {', '.join(sorted(not_installed))}")


@pytest.mark.parametrize(
    "page",
    [page for page in RUN if page.parent.name == "how_to" or page.name == "tutorial.md"],
    ids=lambda page: page.stem,
)
def test_errors_that_the_text_of_a_page_names_are_printed_by_one_of_its_blocks(page):
    printed = " ".join(each.text for block in blocks(page) for each in block.printed)
    told = set(re.findall(r"\d+\.\d+", printed))
    named = {
        number
        for match in MEASURED.finditer(prose(page))
        for number in re.findall(r"\d+\.\d+", match[0])
    }
    assert named <= told
