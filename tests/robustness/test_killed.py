"""Whenever a command is killed, its output is the last good one or the new one, whole."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.files.joint_path import write_joint_path
from tests.robustness.watched import DEATH

ROOT = Path(__file__).parents[2]
KILLED = Path(__file__).with_name("killed.py")

PLAN = ["plan", "desired.csv", "--method", "closed-form", "--segments", "5"]
FIT = ["fit", "desired.csv", "--joint", "knee", "--segments"]
IDENTIFY = ["identify", "log.csv", "--no-hold-out", "--hold"]
EXCITE = ["excite", "--limits-deg", "-10", "10", "--duration-s", "4", "--expected-log", "log2.csv"]
RUN = ["run", "run.toml", "--out", "out"]
EXPORT = ["export", "desired.csv", "--cycles"]

COMMANDS = {
    "plan": ([*PLAN, "-o", "a.csv"], [*PLAN, "--rule", "exact", "-o", "a.csv"]),
    "fit": ([*FIT, "4", "-o", "a.csv"], [*FIT, "6", "-o", "a.csv"]),
    "identify": ([*IDENTIFY, "1", "-o", "a.toml"], [*IDENTIFY, "2", "-o", "a.toml"]),
    "excite": ([*EXCITE, "-o", "a.csv"], [*EXCITE, "--seed", "3", "-o", "a.csv"]),
    "run": (RUN, ["run", "other.toml", "--out", "out"]),
    "export csv": (
        [*EXPORT, "1", "--format", "csv", "-o", "a.csv"],
        [*EXPORT, "2", "--format", "csv", "-o", "a.csv"],
    ),
    "export mcap": (
        [*EXPORT, "1", "--format", "mcap", "-o", "a.mcap"],
        [*EXPORT, "2", "--format", "mcap", "-o", "a.mcap"],
    ),
    "export bag": (
        [*EXPORT, "1", "--format", "bag", "-o", "a"],
        [*EXPORT, "2", "--format", "bag", "-o", "a"],
    ),
    "export lerobot": (
        [*EXPORT, "1", "--format", "lerobot", "-o", "a"],
        [*EXPORT, "2", "--format", "lerobot", "-o", "a"],
    ),
}
"""Two commands with the same output and other content; ``reproduce`` writes as ``run`` does."""

OWN = {"a.csv", "a.toml", "a.mcap", "a", "out", "log2.csv"}
"""Files and folders that the commands are told to write."""


@pytest.fixture
def folder(tmp_path):
    """All inputs."""
    phase = 2.0 * np.pi * np.arange(24) / 24
    angles = np.column_stack([0.2 * np.sin(phase), 0.3 + 0.1 * np.cos(phase)])
    write_joint_path(tmp_path / "desired.csv", ["hip", "knee"], angles, period=0.008)
    for name, method in (("run.toml", "closed-form"), ("other.toml", "optimal")):
        (tmp_path / name).write_text(
            f'[path]\nfile = "desired.csv"\n[plan]\nmethod = "{method}"\n[output]\nreport = ""\n'
        )
    model = planner.JointModel.ers210a()
    requests = np.tile(planner.step_test(0.5, samples=60), 3)
    rows = np.column_stack([0.008 * np.arange(180), requests, planner.simulate(model, requests)])
    header = "t_s,requested_rad,actual_rad"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=header, comments="")
    return tmp_path


def _own(files):
    return {name: held for name, held in files.items() if name.split("/")[0] in OWN}


@pytest.mark.parametrize("name", COMMANDS)
def test_an_output_is_the_last_good_one_or_the_new_one_whenever_the_run_is_killed(name, folder):
    if name.startswith("export"):
        pytest.importorskip({"lerobot": "pyarrow"}.get(name.split()[1], "rosbags"))
    first, second = COMMANDS[name]
    done = subprocess.run(
        [sys.executable, str(KILLED), json.dumps(first), json.dumps(second)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    answer = json.loads(done.stdout)
    old, new = _own(answer["old"]), _own(answer["new"])
    assert len(answer["told"]) >= 4, "nothing was changed, so nothing was tested"
    assert old.keys() == new.keys() != set()
    seen = set()
    for told in answer["told"]:
        assert told["again"] == 0, "a killed run is in the way of the next one"
        assert _own(told["restored"]) == old
        assert told["status"] == DEATH
        after = _own(told["after"])
        if name in ("run", "export bag", "export lerobot"):
            assert after in (old, new)
        else:  # each file by itself
            assert after.keys() == old.keys()
            assert all(after[file] in (old[file], new[file]) for file in old)
        seen.add(after == new)
        assert told["after"].items() >= answer["inputs"].items()
    assert answer["last"][0] == 0
    assert _own(answer["last"][1]) == new
