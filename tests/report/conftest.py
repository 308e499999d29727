"""The folder of results of the paper's experiment, which all tests share."""

import pytest


@pytest.fixture(scope="session")
def folder(reproduced):
    return reproduced.folder


@pytest.fixture(scope="session")
def results(reproduced):
    return reproduced.results
