"""The paper's experiment and its folder of results, made once for all tests of this folder."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from planner.cli import cli


@pytest.fixture(scope="session")
def printed(tmp_path_factory):
    """The folder that `reproduce` wrote, and what it printed."""
    out = tmp_path_factory.mktemp("run") / "paper"
    result = CliRunner().invoke(cli, ["reproduce", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return out, result.stdout


@pytest.fixture(scope="session")
def folder(printed):
    return printed[0]


@pytest.fixture(scope="session")
def results(folder):
    return json.loads((folder / "results.json").read_text())
