"""Three joints for half a second, at the rate of the paper's robot."""

from __future__ import annotations

import numpy as np
import pytest

from planner.robot.schedule import Schedule


@pytest.fixture
def schedule():
    phase = 2.0 * np.pi * np.arange(64) / 64
    rows = np.column_stack([0.4 * np.sin(phase), 0.3 * np.cos(phase), 1.0 + 0.2 * np.sin(phase)])
    return Schedule(("hip", "on", "knee"), rows, 0.008)
