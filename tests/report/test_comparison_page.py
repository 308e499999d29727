"""The page about a comparison: its verdict, shades and tables, and what a browser makes of it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.evaluation.checks import Check, Tolerance
from planner.planning.bounds import foot_bound
from planner.report.comparison_page import SHOWN, comparison_page, foot_table
from tests.corpus.page_text import text_of

WALK = planner.reference_walk()


@pytest.fixture(scope="module")
def check():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(foot_bound, "EFFORT", 100)  # weaker, as valid
        return planner.cross_check(planner.JointModel.ers210a(), WALK.desired[::4], leg=WALK.leg)


@pytest.fixture
def failed(check):
    wrong = Check("knee", "optimised", "holds <always>", 2.0, Tolerance(1.0, "rad", "rounding"))
    joint = replace(check.joints[2], checks=(*check.joints[2].checks, wrong))
    return replace(check, joints=(*check.joints[:2], joint))


def test_the_largest_difference_of_the_requests_is_told_whichever_its_sign(check):
    for joint in check.joints:
        largest = np.degrees(np.abs(joint.difference(SHOWN)).max())
        one = replace(check, joints=(joint,), foot=None)
        assert f"up to {largest:.3g} degrees" in text_of(comparison_page(one).html())


def test_what_does_not_hold_is_said_first(failed):
    page = comparison_page(failed).html()
    said = text_of(page)
    assert f"1 of {len(failed.checks)} checks do not hold. Gaps" in said
    assert "\nknee, optimised: holds <always>: got 2 rad" in said
    assert 'class="verdict no"' in page
    assert "holds &lt;always&gt;" in page
    assert re.search(r'<tr class="broken">.*holds &lt;always&gt;.*<td>NO</td>', page)


@pytest.mark.parametrize(("norm", "place"), [("rms", 0), ("max", 1)])
def test_the_bound_on_the_foot_stands_below_its_error(check, norm, place):
    best = check.foot.best
    plan = replace(best, task=replace(best.task, norm=norm))
    plan.__dict__["lower_bounds"] = 0.8 * plan.error
    plans = {"optimal": check.foot.plans["optimal"], "foot_optimal": plan}
    *_, bound = foot_table(replace(check.foot, plans=plans)).rows
    assert bound.kind == "bound"
    assert [bool(cell) for cell in bound.cells] == [k == place for k in range(5)]
    assert bound.cells[place] == f"{80.0 * plan.error[0]:.3f}"
