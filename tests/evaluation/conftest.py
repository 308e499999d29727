"""The paper's experiment, run once for all tests of this folder."""

from __future__ import annotations

import pytest

from planner.evaluation.reproduction import reproduce


@pytest.fixture(scope="session")
def reproduction():
    return reproduce()
