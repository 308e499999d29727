"""The same question has the same answer, to the last byte, whatever runs beside it."""

from __future__ import annotations

import json
import shutil

import pytest

from tests.robustness.forks import Forks
from tests.robustness.test_only_where_told import LOG, PATH, steps

COMMANDS = {
    "plan optimal": ["plan", "desired.csv", "-o", "out"],
    "plan closed form": ["plan", "desired.csv", "--method", "closed-form", "-o", "out"],
    "plan for the foot": [
        *("plan", "foot.csv", "--leg", "reference", "--unreachable", "clamp"),
        *("--method", "foot-optimal", "-o", "out"),
    ],
    "fit": ["fit", "desired.csv", "--max-rms", "2", "-o", "out"],
    "identify": ["identify", "log.csv", "--hold", "1", "-o", "out"],
    "excite": ["excite", "--limits-deg", "-9", "9", "--duration-s", "4", "-o", "out"],
}


@pytest.fixture
def folder(tmp_path):
    from planner.files.foot_path import write_foot_path
    from planner.gait import half_ellipse

    (tmp_path / "desired.csv").write_text(PATH)
    (tmp_path / "log.csv").write_text(LOG)
    write_foot_path(tmp_path / "foot.csv", half_ellipse(samples=24), period=0.008)
    return tmp_path


@pytest.fixture(scope="module")
def worlds(forks):
    """Other threads of the linear algebra, and another order of sets and dictionaries."""
    other = Forks(threads=4, seed=77)
    yield forks, other
    other.close()


@pytest.mark.parametrize("name", COMMANDS)
def test_threads_and_seeds_change_no_byte(name, folder, worlds):
    answers = []
    for world in worlds:
        done = world.run(folder, *COMMANDS[name])
        assert (folder / "out").is_file(), done.stderr
        answers.append((done.returncode, done.stdout, (folder / "out").read_bytes()))
        (folder / "out").unlink()
    assert answers[0] == answers[1]


def _files(folder):
    """What a run of ``reproduce`` wrote, without what its clock said."""
    held = {file.name: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    results = json.loads(held.pop("results.json"))
    assert results.pop("seconds")
    held.pop("report.html")  # shows the same, with the clock's figures in it
    return held, results


def test_a_reproduction_is_the_same_and_replaces_the_last_one_in_one_step(
    reproduced, tmp_path, worlds
):
    """The slowest command, whole: some ten seconds for the only run with four threads."""
    shutil.copytree(reproduced.folder, tmp_path / "out")
    done = worlds[1].run(tmp_path, "reproduce", "-q", "--out", "out", watch=True)
    assert done.returncode == 0, done.stderr[-500:]
    assert _files(tmp_path / "out") == _files(reproduced.folder)
    assert steps(done.report["changes"], tmp_path, "out") == ["ctypes.dlsym"]
