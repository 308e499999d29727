"""Time limits that mean as much work on a slow or busy machine as on a quick one."""

from itertools import count

import pytest

from planner.inversion import certify
from planner.inversion.bounds import branch_and_bound, tightening

LOOK = 0.02  # seconds that pass for a search whenever it looks at the clock, about as on a laptop


@pytest.fixture
def counted_seconds(monkeypatch):
    """A clock for the search that counts how often it is read, and so is the same everywhere."""
    looks = count()
    for module in (branch_and_bound, tightening, certify):
        monkeypatch.setattr(module, "perf_counter", lambda: LOOK * next(looks))
