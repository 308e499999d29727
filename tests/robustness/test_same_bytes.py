"""The same question has the same answer, to the last byte, whatever runs beside it."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from planner.cli import cli
from tests.robustness.forks import Forks
from tests.robustness.test_only_named_outputs import LOG, PATH

COMMANDS = {
    "plan optimal": ["plan", "desired.csv"],
    "identify": ["identify", "log.csv", "--hold", "1"],
    "compare": ["compare", "desired.csv", "--joint", "knee", "--segments", "4"],
}
"""Plans, bounds and pages that the commands make, in a file."""


@pytest.fixture(scope="module")
def other_world():
    """A process with more threads for its linear algebra, and a seed of its own for its sets."""
    other = Forks(threads=4, seed=77)
    yield other
    other.close()


@pytest.mark.parametrize("name", COMMANDS)
def test_threads_and_seeds_change_no_byte(name, tmp_path, monkeypatch, other_world):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "desired.csv").write_text(PATH)
    (tmp_path / "log.csv").write_text(LOG)
    arguments = [*COMMANDS[name], "--report" if name == "compare" else "-o", "out"]
    here = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    first = (tmp_path / "out").read_bytes()
    there = other_world.run(tmp_path, *arguments)
    assert (here.exit_code, here.stdout) == (there.returncode, there.stdout), there.stderr
    assert first == (tmp_path / "out").read_bytes() != b""
