"""The experiment on the virtual robot and its folder of results, made once for this folder."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from planner.cli import cli
from planner.evaluation import virtual_experiment


@pytest.fixture
def cli_run():
    """The command line in this process: arguments to a click result."""
    return lambda *arguments: CliRunner().invoke(cli, list(arguments))


@pytest.fixture(scope="session")
def played():
    """What the experiment gave."""
    pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")
    return virtual_experiment.play_experiment()


@pytest.fixture(scope="session")
def printed(tmp_path_factory, played):
    """The folder that `reproduce --robot virtual` wrote, and what it printed."""
    out = tmp_path_factory.mktemp("run") / "virtual"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(virtual_experiment, "play_experiment", lambda **_: played)
        result = CliRunner().invoke(cli, ["reproduce", "--robot", "virtual", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return out, result.stdout


@pytest.fixture(scope="session")
def folder(printed):
    return printed[0]


@pytest.fixture(scope="session")
def results(folder):
    return json.loads((folder / "results.json").read_text())
