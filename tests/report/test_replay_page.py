"""The page about a replay: the promise, the slider, the joints, and how fast it can be."""

from __future__ import annotations

import re

import numpy as np
import pytest

from planner import replay
from planner.report.replay_page import replay_page
from tests.report.test_made_up_pages import SERVO, logs


@pytest.mark.parametrize(("size", "speed"), [(2.0, 1.5), (4.0, 2.0), (3.0, 3.0)])
def test_the_error_that_joints_stay_within_is_not_rounded_down(size, speed):
    made = replay(logs("elbow", size=size), SERVO, speed=speed)
    page = replay_page(made, title="demo.csv", models="model: arm.toml").html()
    (promised,) = re.findall(r"stays within\s(\S+) degrees", page)
    largest = np.degrees(np.max(np.abs(made.planned[0].errors["planned"])))
    assert largest <= float(promised) <= 1.1 * largest
