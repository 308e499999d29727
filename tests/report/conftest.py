"""The folder of results of the paper's experiment, which all tests share."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def printed(reproduced):
    """The folder that `reproduce` wrote, and what it printed."""
    return reproduced.folder, reproduced.printed


@pytest.fixture(scope="session")
def folder(printed):
    return printed[0]


@pytest.fixture(scope="session")
def results(reproduced):
    return reproduced.results
