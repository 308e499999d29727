"""From a plan to a robot's file, at the command line."""

from __future__ import annotations

import numpy as np
import pytest

from planner.files.paths import write_joint_path
from tests.cli.test_servos import ARM


@pytest.fixture
def requests(tmp_path):
    rows = np.radians(np.column_stack([np.arange(10.0), 20.0 - np.arange(10.0)]))
    write_joint_path(tmp_path / "requests.csv", ["hip", "knee"], rows, period=0.008)
    return tmp_path / "requests.csv"


def test_the_servos_of_a_model_file_have_the_zeros_and_directions_of_their_own_joints(
    run, requests, tmp_path
):
    blocks = [
        ARM.replace("joint_1", name)
        .replace("direction = 1", f"direction = {way}")
        .replace("zero_tick = 2048", f"zero_tick = {zero}")
        for name, way, zero in (("wrist", 1, 1), ("knee", -1, 1000), ("hip", 1, 2000))
    ]
    (tmp_path / "arm.toml").write_text("".join(blocks))
    shared = ("export", requests, "--format", "csv", "--unit", "ticks", "--model", "arm.toml")
    rows = run(*shared).stdout.splitlines()
    assert rows[:3] == ["t_s,hip_ticks,knee_ticks", "0.0,2000,772", "0.008,2011,784"]
    named = run(*shared, "--joint-names", "a,b").stdout.splitlines()
    assert named == ["t_s,a_ticks,b_ticks", *rows[1:]]
    (tmp_path / "arm.toml").write_text("".join(blocks).replace("4096", "8192"))
    finer = [line.split(",") for line in run(*shared).stdout.splitlines()[1:3]]
    assert [row[1:] for row in finer] == [["2000", "545"], ["2023", "568"]]
    (tmp_path / "arm.toml").write_text("".join([blocks[1].replace("4096", "4000"), blocks[2]]))
    assert "servos of 4000, 4096 ticks a turn, expected one" in run(*shared).stderr
