"""What every test shares: hypothesis tries the same examples at every run, without a clock."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("suite", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("suite")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder with recordings of real servos; a test that asks for it is skipped without."""
    named = os.environ.get("REQUEST_PLANNER_RECORDINGS", "")
    if not named:
        pytest.skip("no recordings: REQUEST_PLANNER_RECORDINGS is not set")
    folder = Path(named)
    if not folder.is_dir():
        pytest.skip(f"no recordings: REQUEST_PLANNER_RECORDINGS names no folder ({folder})")
    return folder
