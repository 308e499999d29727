"""The same question has the same answer, to the last byte, whatever runs beside it."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tests.robustness.test_only_where_told import LOG, PATH, ROOT, WATCHED, steps
from tests.robustness.watched import DEATH

RUN = [sys.executable, "-P", "-c", "from planner.cli import main; main()"]

WORLDS = {
    "one thread": {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"},
    "four threads": {"OMP_NUM_THREADS": "4", "OPENBLAS_NUM_THREADS": "4", "PYTHONHASHSEED": "77"},
}
"""Threads of the linear algebra, and the order of sets and dictionaries of strings."""

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


@pytest.mark.parametrize("name", COMMANDS)
def test_threads_and_seeds_change_no_byte(name, folder):
    answers = {}
    for world, environment in WORLDS.items():
        done = subprocess.run(
            [*RUN, *COMMANDS[name]],
            cwd=folder,
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (folder / "out").is_file(), done.stderr
        answers[world] = (done.returncode, done.stdout, (folder / "out").read_bytes())
        (folder / "out").unlink()
    assert len(set(answers.values())) == 1, answers


def _files(folder):
    """What a run of ``reproduce`` wrote, without what its clock said."""
    held = {file.name: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    results = json.loads(held.pop("results.json"))
    assert results.pop("seconds")
    held.pop("report.html")  # shows the same, with the clock's figures in it
    return held, results


def test_a_reproduction_is_the_same_and_outlives_a_kill(tmp_path):
    def reproduce(world, *death):
        return subprocess.run(
            [sys.executable, str(WATCHED), *death, "--", "reproduce", "-q", "--out", "out"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT), **WORLDS[world]},
            capture_output=True,
            text=True,
            check=False,
        )

    done = reproduce("one thread")
    assert done.returncode == 0, done.stderr[-500:]
    changes = len(json.loads(done.stderr.splitlines()[-1])["changes"])
    before = _files(tmp_path / "out")
    assert reproduce("four threads", "--die-at", str(changes - 2)).returncode == DEATH
    assert _files(tmp_path / "out") == before
    done = reproduce("four threads")
    assert done.returncode == 0, done.stderr[-500:]
    assert _files(tmp_path / "out") == before
    made = json.loads(done.stderr.splitlines()[-1])["changes"]
    assert steps(made, tmp_path, "out") == ["ctypes.dlsym"]  # whichever is the one killed before
