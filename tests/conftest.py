"""What every test shares: hypothesis tries the same examples at every run, without a clock."""

from __future__ import annotations

import fcntl
import functools
import inspect
import os
import pickle
import shutil
import subprocess
from collections import Counter, defaultdict
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from click.testing import CliRunner
from hypothesis import settings

from tests.browser import Browser
from tests.snapshots import Snapshot

settings.register_profile("suite", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("suite")


SLOWEST = (
    "tests/docs/test_pages.py",
    "tests/virtual/test_experiment.py",
    "tests/corpus/test_corpus.py",
    "tests/cli/test_compare.py",
    "tests/inversion/foot/test_bound.py",
    "tests/identification/test_recordings.py",
    "tests/evaluation/test_cross_check.py",
    "tests/robustness/test_same_bytes.py",
    "tests/robustness/test_killed.py",
)
"""Files that begin first, so that no process is left alone with one of them at the end."""


def pytest_addoption(parser):
    """Say what is to become of snapshots."""
    parser.addoption(
        "--rewrite-snapshots",
        action="store_true",
        help="write what tests get into their snapshots instead of comparing it with them",
    )
    parser.addoption(
        "--keep-outputs",
        type=Path,
        metavar="FOLDER",
        help="keep what the commands of tests/corpus write, byte by byte, to compare with diff -r",
    )


@pytest.fixture
def snapshot(request):
    """The snapshots beside a test's file."""
    rewrite = request.config.getoption("rewrite_snapshots")
    return Snapshot(request.path.parent / "snapshots", rewrite=rewrite)


def pytest_collection_modifyitems(items):
    """Put the slowest files first: whole files go to the processes, in the order of the items."""
    slow = {name: place for place, name in enumerate(SLOWEST)}
    items.sort(key=lambda item: slow.get(item.nodeid.partition("::")[0], len(slow)))


@pytest.hookimpl(wrapper=True)
def pytest_terminal_summary(terminalreporter):
    """Say at the very end what was not tested here: each reason once, with its files."""
    summary = yield
    skipped = defaultdict(Counter)
    for report in terminalreporter.stats.get("skipped", []):
        if isinstance(report.longrepr, tuple):  # an expected failure has none
            reason = report.longrepr[2].removeprefix("Skipped: ")
            skipped[reason][report.nodeid.partition("::")[0]] += 1
    if skipped:
        terminalreporter.section("not tested here", blue=True)
    for reason, files in sorted(skipped.items()):
        terminalreporter.line(f"{reason}: {files.total()} skipped")
        for file, count in files.most_common():
            terminalreporter.line(f"  {count:4d} of {file}")
    return summary


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder with recordings of real servos; a test that asks for it is skipped without."""
    named = os.environ.get("REQUEST_PLANNER_RECORDINGS", "")
    if not named:
        pytest.skip("no recordings: REQUEST_PLANNER_RECORDINGS is not set")
    folder = Path(named)
    if not folder.is_dir():
        pytest.skip(f"no recordings: REQUEST_PLANNER_RECORDINGS names no folder ({folder})")
    return folder


@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """Make a folder once, by whichever of several processes comes first: its name to its path."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def once(name, make):
        folder, unfinished = base / name, base / f"{name} unfinished"
        with (base / f"{name} lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.exists():
                shutil.rmtree(unfinished, ignore_errors=True)
                unfinished.mkdir()
                make(unfinished)
                unfinished.rename(folder)
        return folder

    return once


class Reproduced(NamedTuple):
    """An experiment: its answer, what it told of its progress, its folder, and what was printed."""

    answer: Any
    told: list[str]
    folder: Path
    printed: str


def _reproduced(folder, robot, module, name):
    """Fill a folder with an experiment, as the library and as the command make it."""
    from planner.cli import cli

    told = []
    answer = inspect.unwrap(getattr(module, name))(progress=told.append)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, name, lambda **_: answer)
        out = str(folder / "out")
        result = CliRunner().invoke(cli, ["reproduce", "--robot", robot, "--out", out])
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    (folder / "rest").write_bytes(pickle.dumps((answer, told, result.stdout)))


def _read(folder):
    answer, told, printed = pickle.loads((folder / "rest").read_bytes())
    return Reproduced(answer, told, folder / "out", printed)


@pytest.fixture(scope="session")
def reproduced(once):
    """The paper's experiment, made once."""
    from planner.evaluation import reproduction

    return _read(once("reproduced", lambda at: _reproduced(at, "model", reproduction, "reproduce")))


@pytest.fixture(scope="session")
def virtually_reproduced(once):
    """The experiment on the virtual robot, made once."""
    pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")
    from planner.evaluation import virtual_experiment as module

    return _read(once("virtual", lambda at: _reproduced(at, "virtual", module, "play_experiment")))


@pytest.fixture
def ready_experiments(request, monkeypatch):
    """Let `reproduce` take the experiments that were made once."""
    from planner.evaluation import reproduction, virtual_experiment

    for module, name, fixture in (
        (reproduction, "reproduce", "reproduced"),
        (virtual_experiment, "play_experiment", "virtually_reproduced"),
    ):

        def ready(*, fixture=fixture, **_):
            return request.getfixturevalue(fixture).answer

        monkeypatch.setattr(module, name, functools.wraps(getattr(module, name))(ready))


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """A browser for pages that live: one for all tests, each of which opens its page anew."""
    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        pytest.skip("Chromium is not installed")
    browser = Browser(executable, tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def robots() -> Path:
    """The folder of example-robot-data; a test that asks for it is skipped without."""
    try:
        found = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("needs the extra robots")
    return Path(str(found.locate_file("cmeel.prefix/share/example-robot-data/robots")))


@pytest.fixture
def opened(tmp_path):
    """A page opened by Chromium: its path to what the browser made of it and complained of."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("Chromium is not installed")

    def opened(page):
        return subprocess.run(
            [
                browser,
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-quic",
                "--no-first-run",
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
                "--enable-logging=stderr",
                f"--user-data-dir={tmp_path / 'profile'}",
                "--window-size=400,800",
                "--dump-dom",
                page.as_uri(),
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )

    return opened
