"""The experiment on the virtual robot and its folder of results, made once for all tests."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from planner.cli import cli


@pytest.fixture
def cli_run():
    """The command line in this process: arguments to a click result."""
    return lambda *arguments: CliRunner().invoke(cli, list(arguments))


@pytest.fixture(scope="session")
def played(virtually_reproduced):
    """What the experiment gave."""
    return virtually_reproduced.answer


@pytest.fixture(scope="session")
def printed(virtually_reproduced):
    """The folder that `reproduce --robot virtual` wrote, and what it printed."""
    return virtually_reproduced.folder, virtually_reproduced.printed


@pytest.fixture(scope="session")
def folder(printed):
    return printed[0]


@pytest.fixture(scope="session")
def results(folder):
    return json.loads((folder / "results.json").read_text())
