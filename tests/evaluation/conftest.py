"""The paper's experiment, which all tests share."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def reproduction(reproduced):
    return reproduced.answer
