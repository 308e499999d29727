"""Run the command line in this process, and a desired joint path to run it on."""

import numpy as np
import pytest

from planner.files.paths import write_foot_path, write_joint_path


@pytest.fixture
def run(tmp_path, monkeypatch, command_line):
    """The command line in an empty folder: arguments and standard input to a click result."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments, stdin=None, **settings):
        return command_line(*arguments, input=stdin, **settings)

    return run


@pytest.fixture
def desired(tmp_path):
    """A smooth cycle of two joints that the joint can follow, as a file."""
    phase = 2.0 * np.pi * np.arange(88) / 88
    angles = np.column_stack([0.4 * np.sin(phase), 0.3 + 0.2 * np.cos(2.0 * phase)])
    file = tmp_path / "desired.csv"
    write_joint_path(file, ["hip", "knee"], angles, period=0.008)
    return file


@pytest.fixture
def brief(tmp_path):
    """The same in fewer samples, for what takes long."""
    phase = 2.0 * np.pi * np.arange(32) / 32
    angles = np.column_stack([0.1 * np.sin(phase), 0.1 + 0.05 * np.cos(2.0 * phase)])
    file = tmp_path / "brief.csv"
    write_joint_path(file, ["hip", "knee"], angles, period=0.008)
    return file


@pytest.fixture
def foot(tmp_path):
    """A small circle of the front left foot in the body's frame, as a file."""
    phase = 2.0 * np.pi * np.arange(88) / 88
    circle = np.column_stack([np.cos(phase), np.zeros(88), np.sin(phase)])
    file = tmp_path / "foot.csv"
    write_foot_path(file, np.array([0.09, 0.075, -0.09]) + 0.012 * circle, period=0.008)
    return file
