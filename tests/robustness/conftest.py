"""The program's forks, which the tests of a process share."""

import numpy as np
import pytest

from planner.files.paths import write_joint_path
from tests.robustness.forks import Forks


@pytest.fixture(scope="session")
def forks():
    """Runs of the program, each in a process of its own."""
    forks = Forks()
    yield forks
    forks.close()


@pytest.fixture
def folder(tmp_path):
    """A folder with ``desired.csv``."""
    phase = 2.0 * np.pi * np.arange(24) / 24
    angles = np.column_stack([0.2 * np.sin(phase), 0.3 + 0.1 * np.cos(phase)])
    write_joint_path(tmp_path / "desired.csv", ["hip", "knee"], angles, period=0.008)
    return tmp_path
