"""A joint of which only the top speed is known."""

from __future__ import annotations

import pytest

from planner.exceptions import InvalidModel
from planner.model.joint import JointModel
from planner.model.stand_in import stand_in


def test_it_is_the_papers_joint_made_as_fast():
    paper = JointModel.ers210a()
    assert stand_in(paper.v_max) == paper
    fast = stand_in(3.0 * paper.v_max)
    assert fast.v_max / fast.theta_0 == pytest.approx(paper.v_max / paper.theta_0)
    assert (fast.lag, fast.acceleration_time, fast.tick) == (
        paper.lag,
        paper.acceleration_time,
        paper.tick,
    )


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_that_is_none_is_refused(speed):
    with pytest.raises(InvalidModel):
        stand_in(speed)
