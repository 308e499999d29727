"""The page about a replay: the promise, the slider, the joints, and how fast it can be."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from planner import replay
from planner.report.replay import replay_page
from tests.report.test_made_up_pages import SERVO, logs


@pytest.mark.parametrize(("size", "speed"), [(2.0, 1.5), (4.0, 2.0), (3.0, 3.0)])
def test_the_error_that_joints_stay_within_is_not_rounded_down(size, speed):
    made = replay(logs("elbow", size=size), SERVO, speed=speed)
    page = replay_page(made, title="demo.csv", words="follows the state")
    (promised,) = re.findall(r"stays within (\S+) degrees", page)
    largest = np.degrees(np.max(np.abs(made.planned[0].errors["planned"])))
    assert largest <= float(promised) <= 1.1 * largest


def test_the_error_of_a_hand_is_a_share_of_its_range():
    hand = [replace(each, unit="1") for each in logs("hand")]
    for recorded, unit in (
        (hand, "% of the range"),
        ([*hand, *logs("elbow")], "degrees or % of the range"),
    ):
        joints = [each.joint for each in recorded]
        page = replay_page(
            replay(recorded, SERVO, joints=joints), title="demo.csv", words="follows"
        )
        promised, off = re.findall(rf"([\d.]+) {unit} o", page)[:2]
        assert 0.0 < float(promised) < float(off)
