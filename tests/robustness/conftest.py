"""The program's forks, which the tests of a process share."""

from __future__ import annotations

import pytest

from tests.robustness.forks import Forks


@pytest.fixture(scope="session")
def forks():
    """Runs of the program, each in a process of its own."""
    forks = Forks()
    yield forks
    forks.close()
