"""Where MuJoCo is missing, the command says which extra brings it."""

from __future__ import annotations

import sys

import pytest

from planner.exceptions import MissingExtra
from planner.virtual.robot import VirtualRobot


@pytest.fixture(autouse=True)
def _without_mujoco(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)


def test_the_robot_names_the_extra():
    with pytest.raises(MissingExtra, match="the virtual robot needs the extra 'mujoco'"):
        VirtualRobot()


def test_the_command_ends_with_status_2_and_one_line(cli_run, tmp_path):
    out = tmp_path / "out"
    result = cli_run("reproduce", "--robot", "virtual", "--out", str(out))
    assert result.exit_code == 2
    assert "request-planner[mujoco]" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not out.exists()
