"""Tests that other processes can import."""

import os
from pathlib import Path

import pytest

from planner.files.results import Results


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results", {"power": 2})


@pytest.fixture(scope="module")
def importable(tmp_path_factory):
    """Let other processes import the tests; the package they import is the one tested here."""
    folder = tmp_path_factory.mktemp("path")
    (folder / "tests").symlink_to(Path(__file__).resolve().parents[1], target_is_directory=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)  # for spawned processes, which take over this list
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)  # for commands
        yield
