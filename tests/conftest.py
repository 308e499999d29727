"""What every test shares: hypothesis tries the same examples at every run, without a clock."""

import fcntl
import functools
import gc
import importlib
import inspect
import json
import os
import pickle
import shutil
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from click.testing import CliRunner
from hypothesis import settings

import planner
from planner.planning.bounds import foot_bound
from tests.browser import Browser
from tests.snapshots import Snapshot

# The joints and servos of the benchmark are those of the tests, too.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))

settings.register_profile("suite", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("suite")
# Hypothesis also draws numbers that it reads in the imported modules of a project, and offers no
# setting against it: examples would differ with the files that are tested in one process.
with suppress(ImportError):  # versions without such numbers
    from hypothesis.internal.conjecture import providers

    providers.is_local_module_file = lambda _: False


# Readline, which pytest imports, sets it for the processes that run the tests; tables heed it.
os.environ.pop("COLUMNS", None)

SLOWEST = (
    "tests/docs/test_pages.py",
    "tests/approximation/test_fit.py",
    "tests/identification/test_terms.py",
    "tests/planning/test_stream.py",
    "tests/identification/test_recordings.py",
    "tests/corpus/test_corpus.py",
    "tests/report/test_in_a_browser.py",
    "tests/cli/test_servos.py",
    "tests/planning/foot/test_bound.py",
    "tests/identification/test_verdict.py",
    "tests/cli/test_replay.py",
    "tests/planning/bounds/test_certify.py",
    "tests/planning/test_friction.py",
    "tests/identification/test_answers.py",
    "tests/identification/test_residual_patterns.py",
    "tests/robustness/test_public_functions.py",
)
"""Files that begin first, so that no process is left alone with one of them at the end.

In a fresh clone the first file compiles the functions of plans, and at the same time the next three
compile those of piecewise-linear fits, identification and streams. No test file may call such a
function at import: every process would compile it.
"""

NO_PICTURE = '<svg viewBox="0 0 1 1">\n</svg>\n'  # an SVG file in which nothing is drawn

EXPERIMENTS = {"model": "reproduction.reproduce", "virtual": "virtual_experiment.play_experiment"}
"""The function of planner.evaluation behind ``reproduce --robot``."""


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


def pytest_configure():
    """Lock the package, as what compiles it does, so that no command announces compilation."""
    with suppress(BlockingIOError):  # the process that started this one has done it
        package = os.open(Path(planner.__file__).parent, os.O_RDONLY)
        fcntl.flock(package, fcntl.LOCK_EX | fcntl.LOCK_NB)


def pytest_collection_finish():
    """Spare the garbage collection what is imported and collected, which no test frees."""
    gc.freeze()
    gc.set_threshold(100_000, 50)


def pytest_collection_modifyitems(items):
    """Put the slowest files first: whole files go to the processes, in the order of the items."""
    slow = {name: place for place, name in enumerate(SLOWEST)}
    items.sort(key=lambda item: slow.get(item.nodeid.partition("::")[0], len(slow)))


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


def _experiment(robot):
    """The module of an experiment and its function's name there."""
    module, _, name = EXPERIMENTS[robot].partition(".")
    return importlib.import_module(f"planner.evaluation.{module}"), name


@pytest.fixture(scope="session")
def answered(once):
    """An experiment's answer and what it told of its progress: by its robot, computed once."""

    @functools.cache
    def answered(robot):
        if robot == "virtual":
            pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")

        def make(folder):
            told = []
            answer = inspect.unwrap(getattr(*_experiment(robot)))(progress=told.append)
            (folder / "answer").write_bytes(pickle.dumps((answer, told)))

        return pickle.loads((once(f"answer {robot}", make) / "answer").read_bytes())

    return answered


class Reproduced(NamedTuple):
    """An experiment: its answer, what it told of its progress, its folder, and what was printed."""

    answer: Any
    told: list[str]
    folder: Path
    printed: str

    @property
    def results(self) -> dict[str, Any]:
        """The figures that it wrote."""
        return json.loads((self.folder / "results.json").read_text())


@pytest.fixture(scope="session", autouse=True)
def no_reports_by_the_clock():
    """Let long work print no line every half minute: how much it prints is then the same always."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planner.cli.console.REPEATED", 1e6)
        yield


@pytest.fixture(scope="session")
def command_line():
    """The command line in this process and in the present folder: arguments to a click result."""
    from planner.cli import cli

    def command_line(*arguments, **settings):
        return CliRunner().invoke(cli, [str(each) for each in arguments], **settings)

    return command_line


@pytest.fixture(scope="session")
def reproduction_of(once, answered, command_line):
    """An experiment with what the command makes of it: by its robot, made once."""

    def reproduction_of(robot):
        answer, told = answered(robot)

        def make(folder):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(*_experiment(robot), lambda **_: answer)
                result = command_line("reproduce", "--robot", robot, "--out", folder / "out")
            assert result.exit_code == 0, result.output
            assert result.stderr == ""
            (folder / "printed").write_bytes(result.stdout.encode())

        made = once(f"reproduction {robot}", make)
        return Reproduced(answer, told, made / "out", (made / "printed").read_bytes().decode())

    return reproduction_of


@pytest.fixture(scope="session")
def reproduced(reproduction_of):
    """The paper's experiment, made once."""
    return reproduction_of("model")


@pytest.fixture(scope="session")
def virtually_reproduced(reproduction_of):
    """The experiment on the virtual robot, made once."""
    return reproduction_of("virtual")


@pytest.fixture
def ready_experiments(answered, monkeypatch):
    """Let `reproduce` take the answers that were computed once."""
    for robot in EXPERIMENTS:

        def ready(*, robot=robot, **_):
            return answered(robot)[0]

        module, name = _experiment(robot)
        monkeypatch.setattr(module, name, functools.wraps(getattr(module, name))(ready))


@pytest.fixture
def brief_search(monkeypatch):
    """Let the search for the bound of a foot end after its first rounds: weaker, and as valid."""
    monkeypatch.setattr(foot_bound, "EFFORT", 100)  # of 1000


@pytest.fixture
def no_foot_bound(monkeypatch):
    """Replace the lower bound of a foot by 0, which is valid; its search takes most of a plan.

    Not beside ``ready_experiments``, whose plans keep their bounds for other tests.
    """
    monkeypatch.setattr(foot_bound, "foot_bound", lambda *_: 0.0)


@pytest.fixture
def in_this_process(monkeypatch):
    """Let tasks run here, not in processes that import all first; tests/parallel holds those."""
    from tests.parallel.work import in_this_process

    monkeypatch.setattr("planner.parallel.executor_of", in_this_process)


@pytest.fixture
def undrawn(monkeypatch):
    """Leave pictures in files empty: the commands' own tests draw them."""
    monkeypatch.setattr("planner.report.paper_figures.pictures_of", lambda _: (NO_PICTURE, b""))


@pytest.fixture(scope="session")
def one_browser(tmp_path_factory):
    """A browser for pages that live: one for all tests."""
    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        pytest.skip("Chromium is not installed")
    browser = Browser(executable, tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


@pytest.fixture
def browser(one_browser):
    """The browser, in which each test opens its page anew; none goes on living after its test."""
    yield one_browser
    one_browser.leave()


@pytest.fixture(scope="session")
def robots() -> Path:
    """The folder of example-robot-data; a test that asks for it is skipped without."""
    try:
        found = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("needs the extra robots")
    return Path(str(found.locate_file("cmeel.prefix/share/example-robot-data/robots")))
