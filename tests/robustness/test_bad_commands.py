"""Every bad input is one exact line on standard error and exit status 2, and nothing is written."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from planner.cli import cli
from tests.robustness.bad_commands import BAD, FILES


def test_the_table_is_long_enough():
    assert len(BAD) >= 60


@pytest.mark.parametrize(("arguments", "message"), BAD.values(), ids=BAD)
def test_bad_input_is_one_exact_line_and_nothing_is_written(
    arguments, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    result = CliRunner().invoke(cli, arguments)
    assert result.stderr == f"request-planner: {message}\n"
    assert result.stdout == ""
    assert result.exit_code == 2
    held = {file.name: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}
    assert held == FILES
    assert list((tmp_path / "folder").iterdir()) == []
