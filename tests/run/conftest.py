"""The command line in this process."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from planner.cli import cli


@pytest.fixture
def cli_run():
    """Arguments to a click result."""
    return lambda *arguments: CliRunner().invoke(cli, [*arguments])
